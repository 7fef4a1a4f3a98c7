"""Propagation by sampling: what the method is measured against.

Outcomes at the samples of a law, from any response and by any cubature, and everything that the
literature makes of them: moments, densities, log-likelihoods with their scatter over replicates.
With an expansion in between it is what most of the literature does: sample the polynomial instead
of the simulator. For searches there is `propagation`, which has derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.densities import Density, FittedDensity, NodeDensity
from aleator.densities.moments import add_noise
from aleator.densities.outcomes import Outcomes
from aleator.errors import InputsError
from aleator.expansion import Basis, Expanding
from aleator.laws import Normal
from aleator.laws.inputs import Inputs
from aleator.observations.normal import NormalError
from aleator.quadrature import Cubature, MonteCarloPoints, Nodes, SobolPoints
from aleator.surrogates.responses import Response
from aleator.types import Array
from reproduction.sampling.histogram import FittedHistogram, HistogramSpline

Choice = Density | NodeDensity | HistogramSpline


@dataclass(frozen=True)
class Sampling:
    """Outcomes of a response at the nodes of a cubature: Monte Carlo, grids, Gauss rules.

    `response` is the simulator itself (`DirectResponse`), surfaces, or anything that evaluates.
    With `expansion`, a choice such as `Projection(TotalDegree(4))`, the response is run at the
    points of its design only, and the cubature samples the polynomial in the normal germ
    Y(theta) = sum_i c_i psi_i(theta) (paper, eq. (gPC)); x = T(theta | alpha) as ever. Its
    coefficients then carry an error that no number of samples removes.

    >>> from aleator.laws import Normal
    >>> class Square:
    ...     def evaluate(self, x):
    ...         return x.T ** 2
    >>> inputs = Inputs({"x": Normal(0.0, 1.0)})
    >>> way = Sampling(Square(), inputs, SobolPoints(4096))
    >>> way.outcomes(np.array([0.0, 1.0])).moments(2).mean.round(2).tolist()  # E x^2 = 1
    [1.0]
    """

    response: Response
    inputs: Inputs
    cubature: Cubature
    expansion: Expanding | None = None

    @property
    def runs(self) -> int:
        """Runs of every experiment for one alpha."""
        if self.expansion is None:
            return node_count(self.cubature, self.inputs)
        return len(self.expansion.design(self._basis))

    def outcomes(self, alpha: Array) -> Outcomes:
        """Noise-free outcomes (N, S) at the samples of the law alpha (K,), with their weights.

        Cost: `runs` of every experiment; with an expansion O(S P (n + N)) besides.
        """
        if self.expansion is None:
            nodes = self.cubature.nodes(self.inputs, alpha)
            return Outcomes(self.response.evaluate(nodes.x), nodes.weights)
        design = self.expansion.design(self._basis)
        x, _ = self.inputs.image(alpha, design.t)
        fitted = self.expansion.fit(self._basis, design, self.response.evaluate(x))
        samples = self._germ()
        return Outcomes(fitted.evaluate(samples.x), samples.weights)

    def replicate(self, number: int) -> Sampling:
        """The same with the seed of its samples moved by `number`.

        Raises InputsError for a cubature without a seed: it has one answer.

        >>> way = Sampling(None, Inputs({"x": Normal(0.0, 1.0)}), MonteCarloPoints(10, seed=3))
        >>> way.replicate(2).cubature
        MonteCarloPoints(points=10, seed=5)
        """
        if number == 0:
            return self
        if not isinstance(self.cubature, MonteCarloPoints | SobolPoints):
            raise InputsError(
                f"{type(self.cubature).__name__} has no seed: its replicates are equal",
                "ask for one replicate, or take MonteCarloPoints or SobolPoints",
            )
        return replace(self, cubature=replace(self.cubature, seed=self.cubature.seed + number))

    @property
    def _basis(self) -> Basis:
        return Basis.normal(self.inputs.scattering)

    def _germ(self) -> Nodes:
        """The cubature of the germ itself: its image under standard normal laws is the identity."""
        names = [f"theta_{i}" for i in range(self.inputs.scattering)]
        germ = Inputs({name: Normal(0.0, 1.0) for name in names})
        return self.cubature.nodes(germ, np.tile([0.0, 1.0], len(names)))


def node_count(cubature: Cubature, inputs: Inputs) -> int:
    """How many nodes a cubature has for these inputs."""
    start = np.array([h.start for h in inputs.hyperparameters])
    return cubature.nodes(inputs, start).weights.size


def density_of(
    outcomes: Outcomes,
    density: Choice,
    *,
    noise_sd: float = 0.0,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
) -> FittedDensity:
    """The density of sampled outcomes: a histogram, one fitted to their moments, a convolution.

    `lower` and `upper` are the range of the noise-free outcome, a number or (N,); `noise_sd` adds
    normal noise. Raises InputsError for a histogram with noise: it would have to be sampled too.

    >>> from aleator.densities import Gaussian
    >>> two = Outcomes(np.array([[-1.0, 1.0]]), np.array([0.5, 0.5]))
    >>> float(density_of(two, Gaussian()).pdf([0.0])[0])  # 1/sqrt(2 pi)
    0.398942
    """
    if isinstance(density, HistogramSpline):
        if noise_sd > 0.0:
            raise InputsError(
                "a histogram of noise-free outcomes says nothing of the noise",
                "take Convolution(), which is exact in the noise",
            )
        return density.fit_sample(outcomes)
    count = outcomes.y.shape[0]
    low, high = (np.broadcast_to(np.asarray(end, float), (count,)) for end in (lower, upper))
    if isinstance(density, NodeDensity):
        return density.fit_nodes(outcomes, noise_sd, low, high)
    moments = outcomes.moments(density.order)
    if noise_sd > 0.0:
        moments = add_noise(moments, noise_sd, NormalError().moments(density.order))
    margin = NormalError().reach * noise_sd
    return density.fit(moments, low - margin, high + margin)


@dataclass(frozen=True)
class SampledLikelihood:
    """Log-densities of N measured outcomes by R replicates of S samples.

    `each` (R, N) is minus infinity where no sample fell near the outcome. `floor` (R, N) is the
    log-density of one sample alone in a bin of the histogram, log(1/(S h)): below it a histogram of
    S samples knows nothing, and a spline through an empty bin can be arbitrarily small. Where the
    density comes from moments the floor is minus infinity. `runs` of every experiment in a
    replicate.
    """

    each: Array
    floor: Array
    runs: int

    @property
    def missed(self) -> NDArray[np.bool_]:
        """(R, N) whether the samples say nothing of the outcome: below the floor, or infinite."""
        return np.asarray((self.each < self.floor) | ~np.isfinite(self.each))

    @property
    def floored(self) -> Array:
        """Log-densities (R, N), those below the floor moved to it."""
        return np.maximum(self.each, self.floor)

    @property
    def mean(self) -> Array:
        """Mean (N,) of the log-densities over the replicates, floored."""
        return np.asarray(self.floored.mean(axis=0))

    @property
    def standard_error(self) -> Array:
        """Standard error (N,) of that mean from the scatter of the replicates; NaN for one."""
        return _standard_error(self.floored)

    @property
    def total(self) -> Array:
        """Log-likelihoods (R,): minus infinity where a replicate missed an outcome altogether."""
        return np.asarray(self.each.sum(axis=1))

    def error(self, reference: Array) -> SampledError:
        """The mean absolute error against reference log-densities (N,), replicate by replicate."""
        gap, missed = np.abs(self.floored - reference), self.missed
        hit = np.sum(~missed, axis=1)
        others = np.where(missed, 0.0, gap).sum(axis=1) / np.maximum(hit, 1)
        return SampledError(gap.mean(axis=1), np.where(hit > 0, others, np.nan), missed.sum(axis=1))


@dataclass(frozen=True)
class SampledError:
    """Mean absolute errors of R replicates.

    `floored` (R,) over all experiments with the floor in place of what was missed, `others` (R,)
    over the experiments that were not missed, `missed` (R,) how many were.
    """

    floored: Array
    others: Array
    missed: NDArray[np.intp]

    @property
    def standard_error(self) -> float:
        """Standard error of the mean of `floored`; NaN for one replicate."""
        return float(_standard_error(self.floored[:, None])[0])


def log_likelihood(
    sampling: Sampling,
    alpha: Array,
    density: Choice,
    measured: Array,
    *,
    replicates: int = 1,
    noise_sd: float = 0.0,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
) -> SampledLikelihood:
    """log f_l(y_l | alpha) of measured outcomes (N,), by independent replicates of the samples.

    A density of S random samples is biased: its logarithm by about -1/2 of its relative variance,
    a histogram also by its bins. The standard error over replicates does not see that.
    Raises InputsError for no replicate, or several of a cubature without a seed.
    Cost: replicates times `sampling.runs` of every experiment.

    >>> from aleator.densities import Gaussian
    >>> class Itself:
    ...     def evaluate(self, x):
    ...         return x.T
    >>> way = Sampling(Itself(), Inputs({"x": Normal(0.0, 1.0)}), MonteCarloPoints(4096))
    >>> law = np.array([0.0, 1.0])
    >>> found = log_likelihood(way, law, Gaussian(), np.array([0.0]), replicates=4)
    >>> bool(abs(found.mean[0] + 0.5 * np.log(2 * np.pi)) < 4 * found.standard_error[0])
    True
    """
    return log_likelihoods(
        sampling, alpha, [density], measured,
        replicates=replicates, noise_sd=noise_sd, lower=lower, upper=upper,
    )[0]  # fmt: skip


def log_likelihoods(
    sampling: Sampling,
    alpha: Array,
    densities: Sequence[Choice],
    measured: Array,
    *,
    replicates: int = 1,
    noise_sd: float = 0.0,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
) -> tuple[SampledLikelihood, ...]:
    """As `log_likelihood`, for several densities of the same samples: they share the runs."""
    if replicates < 1:
        raise InputsError(f"{replicates} replicates", "ask for at least one")
    rows: list[list[tuple[Array, Array]]] = [[] for _ in densities]
    for number in range(replicates):
        outcomes = sampling.replicate(number).outcomes(alpha)
        for row, density in zip(rows, densities, strict=True):
            fitted = density_of(outcomes, density, noise_sd=noise_sd, lower=lower, upper=upper)
            row.append((fitted.log_pdf(measured), _floor(fitted, outcomes)))
    found = []
    for row in rows:
        each, floor = zip(*row, strict=True)
        found.append(SampledLikelihood(np.stack(each), np.stack(floor), sampling.runs))
    return tuple(found)


def samples_needed(samples: ArrayLike, errors: ArrayLike, wanted: float) -> float:
    """Samples at which an error first falls to `wanted`, interpolated in logarithms.

    `samples` (Q,) ascending with their `errors` (Q,), all positive. NaN where it never falls so
    far, and the first of the samples where it is there from the start.

    >>> samples_needed([10, 1000], [1.0, 0.01], 0.1)
    100.0
    """
    s, e = np.asarray(samples, dtype=float), np.asarray(errors, dtype=float)
    below = np.flatnonzero(e <= wanted)
    if below.size == 0:
        return float("nan")
    k = int(below[0])
    if k == 0:
        return float(s[0])
    share = np.log(e[k - 1] / wanted) / np.log(e[k - 1] / e[k])
    return float(s[k - 1] * (s[k] / s[k - 1]) ** share)


def _floor(fitted: FittedDensity, outcomes: Outcomes) -> Array:
    count, samples = outcomes.y.shape
    if not isinstance(fitted, FittedHistogram):
        return np.full(count, -np.inf)
    width = (fitted.high - fitted.low) / (fitted.cumulated.shape[1] - 1)
    spread = ~fitted.degenerate
    return np.where(spread, -np.log(samples * np.where(spread, width, 1.0)), -np.inf)


def _standard_error(rows: Array) -> Array:
    count = rows.shape[0]
    if count < 2:
        return np.full(rows.shape[1], np.nan)
    return np.asarray(rows.std(axis=0, ddof=1) / np.sqrt(count))
