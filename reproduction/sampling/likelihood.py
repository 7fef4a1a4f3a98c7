"""Propagation by sampling: what the paper's method is measured against.

Outcomes at the samples of a law, the densities that are made of them, and the log-densities of the
measured outcomes with their scatter over replicates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws.inputs import Inputs
from aleator.laws.quadrature import Cubature, MonteCarloPoints, SobolPoints
from aleator.moments.densities import Density, FittedDensity
from aleator.moments.moments import NodeOutcomes
from aleator.simulators.response_functions import ResponseFunction
from reproduction.sampling.histogram import FittedHistogram, HistogramSpline

Choice = Density | HistogramSpline


@dataclass(frozen=True)
class Sampling:
    """Outcomes of a response at the nodes of a cubature: Monte Carlo, grids, Gauss rules.

    `response` is the simulator itself (`DirectResponse`), surfaces, or anything that evaluates.

    >>> from aleator.laws import Normal
    >>> class Square:
    ...     def evaluate(self, x):
    ...         return x.T ** 2
    >>> inputs = Inputs({"x": Normal(0.0, 1.0)})
    >>> way = Sampling(Square(), inputs, SobolPoints(4096))
    >>> way.outcomes(np.array([0.0, 1.0])).moments(2).mean.round(2).tolist()  # E x^2 = 1
    [1.0]
    """

    response: ResponseFunction
    inputs: Inputs
    cubature: Cubature

    def outcomes(self, alpha: Array) -> NodeOutcomes:
        """Outcomes (N, S) at the samples of the law alpha (K,), with their weights.

        Cost: S runs of every experiment.
        """
        nodes = self.cubature.nodes(self.inputs, alpha)
        return NodeOutcomes(self.response.evaluate(nodes.x), nodes.weights)

    def replicate(self, number: int) -> Sampling:
        """The same with the seed of its samples moved by `number`.

        Raises InputsError for a cubature without a seed: it has one answer.

        >>> way = Sampling(None, None, MonteCarloPoints(10, seed=3))
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


def density_of(
    outcomes: NodeOutcomes, density: Choice, lower: ArrayLike = -np.inf, upper: ArrayLike = np.inf
) -> FittedDensity:
    """The density of sampled outcomes: a histogram, or one fitted to their moments.

    `lower` and `upper` are the range of the outcome, a number or (N,).

    >>> from aleator.moments.densities import Gaussian
    >>> two = NodeOutcomes(np.array([[-1.0, 1.0]]), np.array([0.5, 0.5]))
    >>> float(density_of(two, Gaussian()).pdf([0.0])[0])  # 1/sqrt(2 pi)
    0.398942
    """
    if isinstance(density, HistogramSpline):
        return density.fit_sample(outcomes)
    return density.fit(outcomes.moments(density.order), lower, upper)


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
        count = self.floored.size
        return float(self.floored.std(ddof=1) / np.sqrt(count)) if count > 1 else float("nan")


def log_likelihoods(
    sampling: Sampling,
    alpha: Array,
    densities: Sequence[Choice],
    measured: Array,
    *,
    replicates: int = 1,
    lower: ArrayLike = -np.inf,
    upper: ArrayLike = np.inf,
) -> tuple[SampledLikelihood, ...]:
    """log f_l(y_l | alpha) of measured outcomes (N,), by replicates of the samples.

    One value for each of the densities, which share the samples. A density of S random samples is
    biased: its logarithm by about -1/2 of its relative variance, a histogram also by its bins. The
    scatter of the replicates does not show that. Raises InputsError for no replicate, or several of
    a cubature without a seed. Cost: replicates times the runs of `sampling.outcomes`.

    >>> from aleator.moments.densities import Gaussian
    >>> from aleator.laws import Normal
    >>> class Itself:
    ...     def evaluate(self, x):
    ...         return x.T
    >>> way = Sampling(Itself(), Inputs({"x": Normal(0.0, 1.0)}), SobolPoints(4096))
    >>> law = np.array([0.0, 1.0])
    >>> (found,) = log_likelihoods(way, law, [Gaussian()], np.array([0.0]), replicates=4)
    >>> round(float(found.each.mean()), 3)  # -log(2 pi)/2
    -0.919
    """
    if replicates < 1:
        raise InputsError(f"{replicates} replicates", "ask for at least one")
    rows: list[list[tuple[Array, Array]]] = [[] for _ in densities]
    for number in range(replicates):
        outcomes = sampling.replicate(number).outcomes(alpha)
        for row, density in zip(rows, densities, strict=True):
            fitted = density_of(outcomes, density, lower, upper)
            row.append((fitted.log_pdf(measured), _floor(fitted, outcomes)))
    found = []
    for row in rows:
        each, floor = zip(*row, strict=True)
        found.append(SampledLikelihood(np.stack(each), np.stack(floor), outcomes.weights.size))
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


def _floor(fitted: FittedDensity, outcomes: NodeOutcomes) -> Array:
    count, samples = outcomes.y.shape
    if not isinstance(fitted, FittedHistogram):
        return np.full(count, -np.inf)
    width = (fitted.high - fitted.low) / (fitted.cumulated.shape[1] - 1)
    spread = ~fitted.degenerate
    return np.where(spread, -np.log(samples * np.where(spread, width, 1.0)), -np.inf)
