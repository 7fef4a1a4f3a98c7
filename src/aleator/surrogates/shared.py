"""One Gaussian process over conditions and parameters for all experiments.

Each experiment is run at points of its own, and one Gaussian process over conditions and parameters
is fitted to the runs of all experiments. For the conditions of one experiment the process is a
function of the parameters alone, to which a polynomial is fitted. The result is a `Surface`.

An outcome is y = f(u) + g_l(z) with u = (c_l, z), the conditions of experiment l and the
parameters, each scaled to [-1, 1]. The covariance is

    k(|A'(u - u')|) + a^2 [l = l'] k(|s (z - z')|) + 30 + 10 u . u' + noise^2 [same run]

times one variance, where k is Matern's correlation of smoothness 5/2 as a function of distance.
The matrix A rotates and stretches the inputs, so that a steep front whose place changes with the
conditions is the same function for all experiments (Vivarelli and Williams 1999, "Discovering
hidden features with Gaussian process regression"). The second term is the individual part g_l of an
experiment. A, s, a and the noise maximize the likelihood of the runs under a weak normal prior on A
(Rasmussen and Williams 2006, section 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from aleator.core.threads import single_threaded
from aleator.core.types import Array, Flags, Indices
from aleator.simulators.response_functions import Run
from aleator.surrogates.emulator import Emulator, pairs
from aleator.surrogates.fit import clustered, fixed_shift, low_discrepancy
from aleator.surrogates.samples import Samples
from aleator.surrogates.surface import Axes, Surface, ball, products


@dataclass(frozen=True)
class ProcessSettings:
    """Settings of the covariance of the Gaussian process of a shared surface.

    The covariance is given in the module's description. The values are chosen by judgement.
    """

    constant: float = 30.0
    """Variance of the constant term, relative to the common part; so large that it is almost free.
    """
    linear: float = 10.0
    """Variance of the linear terms, relative to the common part; so large that they are almost
    free."""
    ridge: float = 0.01
    """Precision (inverse variance) of the normal prior on the entries of the matrix A."""
    rank: int = 8
    """The largest number of columns of A, the directions in which the outcome may vary."""
    individual: tuple[float, float] = (1e-4, 3.0)
    """Limits of the standard deviation a of the part that each experiment has of its own."""
    scale: tuple[float, float] = (0.05, 10.0)
    """Limits of the scales s of the parameters in the part that each experiment has of its own."""
    noise: tuple[float, float] = (3e-4, 0.3)
    """Limits of the standard deviation of the noise of a run."""
    largest_mix: float = 20.0
    """The largest size of an entry of A."""
    first_mix: float = 0.5
    """The entry of A for each input from which the fit starts."""
    first_noise: float = 0.01
    """The standard deviation of the noise from which the fit starts."""
    none: float = 1e-200
    """A standard deviation a that means no individual part, for a single experiment; its square is
    zero."""
    failed: float = 1e10
    """Minus the log-posterior that is returned for a covariance that is not positive definite."""


PROCESS = ProcessSettings()


@dataclass(frozen=True)
class Covariance:
    """The parameters of the covariance in the module's description, all without unit.

    `mix` is the matrix A (D, r), `individual` the standard deviation a of an experiment's own part,
    `scale` the scales s (n,) of the parameters in that part, and `noise` a standard deviation.
    """

    mix: Array
    individual: float
    scale: Array
    noise: float
    settings: ProcessSettings = PROCESS

    @classmethod
    def first(
        cls,
        inputs: int,
        parameters: int,
        individual: float = 0.1,
        settings: ProcessSettings = PROCESS,
    ) -> Covariance:
        """The covariance from which the fit starts, in which all inputs have the same effect."""
        mix = settings.first_mix * np.eye(inputs, min(inputs, settings.rank))
        mix[settings.rank :] = settings.first_mix / np.sqrt(settings.rank)
        return cls(mix, individual, np.ones(parameters), settings.first_noise, settings)

    @property
    def vector(self) -> Array:
        """The parameters as one vector: A, then the logarithms of a, s and the noise."""
        rest = np.log([max(self.individual, self.settings.none), *self.scale, self.noise])
        return np.concatenate([self.mix.ravel(), rest])

    def moved(self, vector: Array) -> Covariance:
        """The covariance whose parameters are given by a vector in the order of `vector`."""
        size = self.mix.size
        own, *scale, noise = np.exp(vector[size:])
        mix = vector[:size].reshape(self.mix.shape)
        return Covariance(mix, own, np.array(scale), noise, self.settings)

    def likeness(self, u: Array) -> Array:
        """Squared correlations (N, N) of the common part f between the inputs u (N, D)."""
        mixed = u @ self.mix
        return _matern(_squared(mixed, mixed))[0] ** 2


def _matern(squared: Array) -> tuple[Array, Array]:
    """Matern's correlation of smoothness 5/2 at squared distances, and its derivative by them."""
    r = np.sqrt(5.0 * np.maximum(squared, 0.0))
    decay = np.exp(-r)
    slope = (-5.0 / 6.0) * (1.0 + r) * decay
    return (1.0 + r + r * r / 3.0) * decay, slope


def _squared(a: Array, b: Array) -> Array:
    """Squared distances (A, B) between the rows of two arrays."""
    return np.asarray((a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * (a @ b.T))


def _loss(
    covariance: Covariance, index: Indices, u: Array, y: Array, settings: ProcessSettings = PROCESS
) -> tuple[float, Array]:
    """Minus the log-posterior of a covariance, up to a constant, and its gradient by `vector`."""
    mix, own, scale = covariance.mix, covariance.individual, covariance.scale
    settings = covariance.settings
    z = u[:, -len(scale) :]
    mixed, stretched = u @ mix, z * scale
    value, slope = _matern(_squared(mixed, mixed))
    alike = index[:, None] == index
    mine, mine_slope = (alike * part for part in _matern(_squared(stretched, stretched)))
    matrix = value + own**2 * mine + settings.constant + settings.linear * (u @ u.T)
    matrix[np.diag_indices(len(y))] += covariance.noise**2
    try:
        factor = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return settings.failed, np.zeros(covariance.vector.size)
    dual = cho_solve((factor, True), y, check_finite=False)
    variance = float(y @ dual) / len(y)
    loss = 0.5 * len(y) * np.log(variance) + np.log(np.diag(factor)).sum()
    gap = 0.5 * (_inverse(factor) - np.outer(dual, dual) / variance)
    by_mix = 4.0 * _moved(gap * slope, u, u) @ mix
    by_own = 2.0 * own**2 * float((gap * mine).sum())
    by_scale = 4.0 * own**2 * scale**2 * np.diag(_moved(gap * mine_slope, z, z))
    by_noise = 2.0 * covariance.noise**2 * np.trace(gap)
    gradient = np.concatenate(
        [(by_mix + settings.ridge * mix).ravel(), [by_own, *by_scale, by_noise]]
    )
    return float(loss + 0.5 * settings.ridge * (mix**2).sum()), gradient


def _moved(gap: Array, a: Array, b: Array) -> Array:
    """Half the sum over all i, j of gap_ij (a_i - a_j)(b_i - b_j)', for a symmetric gap."""
    return np.asarray(a.T @ (gap.sum(axis=1)[:, None] * b) - a.T @ gap @ b)


def _inverse(factor: Array) -> Array:
    """The inverse (M, M) of a matrix from its lower Cholesky factor."""
    lower = np.tril(dpotri(factor, lower=1)[0])
    return np.asarray(lower + np.tril(lower, -1).T)


@single_threaded
def learned(start: Covariance, index: Indices, u: Array, y: Array, iterations: int) -> Covariance:
    """The covariance with the largest posterior density, given runs, by at most `iterations` steps.

    The runs are outcomes y (M,) of the experiments `index` (M,) at inputs u (M, D).
    """
    n, level, unit = len(start.scale), y.mean(), y.std() or 1.0
    settings = start.settings

    def loss(vector: Array) -> tuple[float, Array]:
        return _loss(start.moved(vector), index, u, (y - level) / unit)

    own, noise = (
        (settings.individual, settings.noise)
        if start.individual > settings.none
        else ((settings.none, settings.none), (settings.noise[0], settings.noise[0]))
    )
    positive = [np.log(own), *[np.log(settings.scale)] * n, np.log(noise)]
    bounds = [(-settings.largest_mix, settings.largest_mix)] * start.mix.size + [
        (low, high) for low, high in positive
    ]
    found = minimize(
        loss, start.vector, jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": iterations},
    )  # fmt: skip
    return start.moved(found.x)


@dataclass(frozen=True)
class ProcessPosterior:
    """The Gaussian process conditioned on M runs.

    The outcomes are standardized by their mean `level` and standard deviation `unit`. `factor` is
    the Cholesky factor of the covariance of the runs, `dual` its inverse times the outcomes, and
    `variance` the common variance.
    """

    covariance: Covariance
    index: Indices
    u: Array
    level: float
    unit: float
    factor: Array
    dual: Array
    variance: float
    surprise: Array  # Leave-one-out residuals over their expected standard deviations (M,).

    @classmethod
    @single_threaded
    def of(cls, covariance: Covariance, index: Indices, u: Array, y: Array) -> ProcessPosterior:
        """The process conditioned on runs y (M,) of experiments `index` at u (M, D); O(M^3)."""
        level, unit = float(y.mean()), float(y.std()) or 1.0
        matrix = _between(covariance, index, u, index, u)
        matrix[np.diag_indices(len(y))] += covariance.noise**2
        factor = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
        dual = cho_solve((factor, True), (y - level) / unit)
        precision = np.diag(_inverse(factor))
        variance = float(np.mean(dual**2 / precision))
        surprise = dual / np.sqrt(precision * variance)
        return cls(covariance, index, u, level, unit, factor, dual, variance, surprise)

    @single_threaded
    def mean(self, index: Indices, u: Array) -> Array:
        """Expected outcomes (R,) of the experiments `index` (R,) at inputs u (R, D)."""
        return self.level + self.unit * (self._between(index, u) @ self.dual)

    @single_threaded
    def deviation(self, index: Indices, u: Array) -> Array:
        """Posterior standard deviations (R,) of the outcomes at inputs u (R, D); O(M^2 R)."""
        known = solve_triangular(
            self.factor, self._between(index, u).T, lower=True, check_finite=False
        )
        own, settings = self.covariance.individual, self.covariance.settings
        prior = 1.0 + own**2 + settings.constant + settings.linear * (u**2).sum(axis=1)
        left = np.maximum(prior - (known**2).sum(axis=0), 0.0)
        return np.asarray(self.unit * np.sqrt(self.variance * left))

    @property
    def noise(self) -> float:
        """The variance of outcomes of runs about the smooth function, in squared units."""
        return self.unit**2 * self.variance * self.covariance.noise**2

    @single_threaded
    def joint(self, index: Indices, u: Array) -> Array:
        """Posterior covariances (R, R) of the outcomes at a small number R of inputs u (R, D)."""
        known = solve_triangular(
            self.factor, self._between(index, u).T, lower=True, check_finite=False
        )
        prior = _between(self.covariance, index, u, index, u)
        return np.asarray(self.unit**2 * self.variance * (prior - known.T @ known))

    def _between(self, index: Indices, u: Array) -> Array:
        return _between(self.covariance, index, u, self.index, self.u)


def _between(covariance: Covariance, index: Indices, u: Array, other: Indices, v: Array) -> Array:
    """Covariances (R, M) between two lists of runs, without noise, relative to the variance."""
    n = len(covariance.scale)
    out = _matern(_squared(u @ covariance.mix, v @ covariance.mix))[0]
    settings = covariance.settings
    out += settings.constant + settings.linear * (u @ v.T)
    if covariance.individual**2 == 0.0:
        return np.asarray(out)
    row, column = np.nonzero(index[:, None] == other)
    gap = (u[row, -n:] - v[column, -n:]) * covariance.scale
    out[row, column] += covariance.individual**2 * _matern((gap**2).sum(axis=1))[0]
    return np.asarray(out)


@dataclass(frozen=True)
class SharingSettings:
    """Settings of the runs and points of a shared surface.

    The values are chosen by judgement, but for `caution`.
    """

    first: int = 800
    """The number of runs of all experiments together in the first round; every experiment gets at
    least two runs."""
    most: int = 4000
    """The largest number of runs of one fit, whose cost grows with the cube of this number."""
    learned: int = 500
    """The number of runs to which the parameters of the covariance are fitted."""
    steps: tuple[int, int] = (60, 20)
    """The number of steps of the fit of the covariance, in the first round and in later rounds."""
    terms: tuple[int, ...] = (40, 136, 220, 250)
    """The number of terms of the polynomials for 1, 2, 3 and more parameters."""
    points: float = 2.5
    """The number of points for each term, to which a polynomial is fitted."""
    ridge: float = 0.01
    """Weight of the penalty on the size of a polynomial's terms, relative to one point of the fit.
    """
    judged: int = 16
    """The number of points per experiment at which the expected error is computed."""
    compared: int = 64
    """The number of points per experiment at which polynomial and process are compared."""
    caution: float = 1.5
    """Factor of the estimated errors. It was set on the wet clutch: with it the true errors stay
    below the estimate as often as the tests assert."""
    elsewhere: float = 0.1
    """The share of runs spread over the whole box when the others follow a law."""
    least_seen: float = 1e-9
    """The least number of runs by which the mean of squared standardized residuals is divided."""


SHARING = SharingSettings()


class SharedSurface(Emulator):
    """One Gaussian process for all experiments; the methods are those of `Emulator`.

    `conditions` (N, d) are the conditions of the experiments as inputs in [-1, 1] (see `features`).

    Cost besides the runs: M^3 operations for M runs of all experiments together, and a few hundred
    times N M for the polynomials. A round with 108 experiments of 20 runs takes some ten seconds.
    """

    def __init__(
        self, run: Run, box: Array, conditions: Array, settings: SharingSettings = SHARING
    ) -> None:
        experiments, n = len(conditions), len(box)
        super().__init__(run, box, Samples.none(experiments, n))
        self.conditions, self.settings = conditions, settings
        self.shift = np.random.default_rng(0).random((experiments, n))
        self.covariance = Covariance.first(conditions.shape[1] + n, n)
        self.where = self.axes.outward(low_discrepancy(self.settings.compared, n, fixed_shift(n)))
        self._place(
            np.arange(experiments), first_shared_runs(experiments, n, settings), settings.most, None
        )
        self.posterior = self._learned(self.settings.steps[0])
        self.stale = False

    @staticmethod
    def fits(experiments: int, n: int, settings: SharingSettings = SHARING) -> bool:
        """Whether one fit can take twice the runs of the first round of so many experiments."""
        return 2 * experiments * first_shared_runs(experiments, n, settings) <= settings.most

    def move(self, box: Array) -> None:
        """Change the region to another box; runs outside it are still used in the fit."""
        self.axes, self.stale = Axes.plain(box), True

    def round(self, members: Indices, growth: float) -> int:
        """The largest number of runs that `sharpen` makes for one of the experiments `members`."""
        return int(np.ceil(growth * self.runs[members].max(initial=0)))

    def sharpen(self, members: Indices, draws: Array | None, growth: float, most: int) -> None:
        """Run the experiments `members` (A,) at points of their own, spread as the draws are."""
        room = max((self.settings.most - int(self.runs.sum())) // len(members), 1)
        more = int(np.ceil(growth * self.runs[members].mean()))
        self._place(members, min(more, room), most, draws)
        self.stale = True

    def judge(self, where: Array | None) -> None:
        """Estimate each error as the posterior standard deviation times a factor.

        The factor says how much larger the leave-one-out residuals are than the process expects.
        """
        if self.stale:
            self.posterior, self.stale = self._learned(self.settings.steps[1]), False
        factor = self.settings.caution * self._surprise()
        everywhere = low_discrepancy(
            self.settings.compared, len(self.box), fixed_shift(len(self.box))
        )
        points = self.axes.outward(everywhere) if where is None else where
        self.where = points[: self.settings.compared]
        self.error = factor * self._left(self.axes.inward(points[: self.settings.judged]))
        self.reach = np.maximum(factor * self._left(everywhere[: self.settings.judged]), self.error)
        self.scatter = self._expected().std(axis=1)
        index, _, y = self.samples.listed
        self.level = np.zeros(len(self.conditions))
        np.maximum.at(self.level, index, np.abs(y))
        self.error[~self.samples.worked.any(axis=1)] = np.inf

    def surface(self, converged: Flags) -> Surface:
        """The polynomials fitted to the process, with the errors of the last call of `judge`."""
        indices, coefficients = self._polynomials()
        basis = products(indices, self.axes.inward(self.where))
        missed = coefficients.T @ basis - self._expected()
        error = np.hypot(self.error, np.sqrt((missed**2).mean(axis=1)))
        everyone = np.arange(len(error))
        nothing = np.full((len(error), 1), np.nan)
        plain = np.zeros(len(error), dtype=np.bool_)
        return self._surface([(everyone, indices, coefficients)], error, converged, nothing, plain)

    def _place(self, members: Indices, count: int, most: int, draws: Array | None) -> None:
        """Run each of the members at the next `count` points of its own sequence of points."""
        index, place = pairs(members, count)
        n, before = len(self.box), self.runs
        even = 0.5 * (low_discrepancy(int(before[members].max()) + count, n, np.zeros(n)) + 1.0)
        even = (even[before[index] + place] + self.shift[index]) % 1.0
        x = self._over_box(even) if draws is None else self._over_law(even, draws)
        allowed = np.flatnonzero(place < most - before[index])
        self.run_at(x[allowed], index[allowed], np.arange(len(allowed)))

    def _over_box(self, even: Array) -> Array:
        """Points x (R, n) in the box, denser at its faces, from evenly spread ones in [0, 1]."""
        return self.axes.outward(clustered(2.0 * even - 1.0))

    def _over_law(self, even: Array, draws: Array) -> Array:
        """Points x (R, n) spread as the draws (D, n) are, some over the box, from even ones."""
        low, high = self.box.T
        others = np.linspace(low, high, int(self.settings.elsewhere * len(draws)))
        pool = np.vstack([np.clip(draws, low, high), others])
        return np.column_stack([np.quantile(pool[:, i], even[:, i]) for i in range(len(low))])

    def _learned(self, steps: int) -> ProcessPosterior:
        """The process conditioned on all runs; the fit of its covariance starts from the last."""
        index, x, y = self.samples.listed
        u = np.hstack([self.conditions[index], self.axes.inward(x)])
        some = np.sort(np.random.default_rng(len(u)).permutation(len(u))[: self.settings.learned])
        self.covariance = learned(self.covariance, index[some], u[some], y[some], steps)
        return ProcessPosterior.of(self.covariance, index, u, y)

    def _surprise(self) -> Array:
        """How much larger the leave-one-out residuals are than the process expects, (N,).

        It is the larger of two ratios: that of the experiment's own residuals, and that of the
        residuals of experiments that correlate with it.
        """
        experiments, n = len(self.conditions), len(self.box)
        known = self.posterior
        seen = np.bincount(known.index, minlength=experiments)
        squares = np.bincount(known.index, known.surprise**2, minlength=experiments)
        alike = self.covariance.likeness(np.hstack([self.conditions, np.zeros((experiments, n))]))
        pooled = (alike @ squares) / np.maximum(alike @ seen, self.settings.least_seen)
        return np.asarray(np.sqrt(np.maximum((1.0 + squares) / (1.0 + seen), pooled)))

    def _expected(self) -> Array:
        """Expected outcomes (N, J) at the points of the last call of `judge`."""
        return self._mean(self.axes.inward(self.where))

    def _mean(self, z: Array) -> Array:
        """Expected outcomes (N, J) of all experiments at points z (J, n)."""
        parts = []
        for one, condition in enumerate(self.conditions):
            u = np.hstack([np.tile(condition, (len(z), 1)), z])
            parts.append(self.posterior.mean(np.full(len(z), one), u))
        return np.array(parts)

    def _left(self, z: Array) -> Array:
        """The posterior standard deviation of each outcome (N,), rms over points z (J, n)."""
        experiments = len(self.conditions)
        index = np.repeat(np.arange(experiments), len(z))
        u = np.hstack([self.conditions[index], np.tile(z, (experiments, 1))])
        left = self.posterior.deviation(index, u).reshape(experiments, -1)
        return np.asarray(np.sqrt((left**2).mean(axis=1)))

    def _polynomials(self) -> tuple[Indices, Array]:
        """Multi-indices (P, n) and coefficients (P, N) of the polynomials fitted to the process.

        They are fitted by least squares, at points over the box and at points of the last call of
        `judge`.
        """
        n = len(self.box)
        indices, size = ball(
            (1.0,) * n, 2.0, self.settings.terms[min(n, len(self.settings.terms)) - 1]
        )
        even = 0.5 * (
            low_discrepancy(int(self.settings.points * len(indices)), n, fixed_shift(n)) + 1.0
        )
        x = np.vstack([self._over_box(even), self._over_law(even, self.where)])
        z = self.axes.inward(x)
        y = self._mean(z).T - self.posterior.level
        # The penalty keeps coefficients small that the points hardly determine, as those that act
        # in the corners of a box of many parameters.
        ridge = np.diag(self.settings.ridge * (1.0 + size**2))
        matrix = np.vstack([products(indices, z).T, ridge])
        fitted = np.linalg.lstsq(matrix, np.vstack([y, np.zeros((len(size), y.shape[1]))]))[0]
        fitted[0] += self.posterior.level
        return indices, np.asarray(fitted)


def first_shared_runs(experiments: int, n: int, settings: SharingSettings = SHARING) -> int:
    """The number of first runs per experiment, fewer if many experiments share the surface.

    >>> first_shared_runs(108, 2), first_shared_runs(1000, 2)
    (8, 2)
    """
    return int(np.clip(settings.first // experiments + 1, 2, 2 * n + 4))
