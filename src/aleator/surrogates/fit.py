"""From runs to a surface: the placement of runs, and the fit of a polynomial to them.

A surface y = sum_nu c_nu phi_nu has more coefficients than there are runs. Of all surfaces through
the runs, the one with the least sum of (c_nu / w_nu)^2 is taken. It is the mean of a Gaussian
process with independent coefficients Normal(0, w_nu^2) (Rasmussen and Williams 2006, section 2.7).
Plain interpolation in a fixed set of polynomials amplifies the terms that the set leaves out; this
method does not. The prior, that is the weights w, is chosen for the least leave-one-out error. Let
B = Q R be the QR decomposition of the (P + M) x M matrix that stacks w phi at the M runs on g I.
Then the covariance of the runs is K = R'R, and all results are in closed form. g is the standard
deviation of noise: with g > 0 the surface need not pass through the runs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.spatial import cKDTree
from scipy.stats import qmc

from aleator.core.threads import single_threaded
from aleator.core.types import Array, Flags, Indices
from aleator.surrogates.surface import SURFACES, Group, Surface, ball, outcomes, products


@dataclass(frozen=True)
class PlacementSettings:
    """Settings of the placement of runs. The values are chosen by judgement."""

    cluster: float = 0.4
    """How densely points lie near the faces of the box: evenly spread t become sin(c t) / sin(c)
    with c this times pi. 0 gives even spacing, with which polynomials oscillate at the faces; 1/2
    gives Chebyshev's spacing, which wastes runs there if outcomes have kinks."""
    candidates: int = 4096
    """The number of points from which the sequence of runs is chosen, and thus its greatest length.
    It is fixed, because otherwise a shorter sequence would not be the beginning of a longer one."""
    beside_draws: int = 2048
    """The number of candidates spread over the whole box, in addition to the draws of a law."""
    everywhere: int = 512
    """The number of points that represent the whole box in averages."""
    shares: int = 8192
    """The number of points by which the volumes of parts of the box are measured."""
    length: float = 6.0
    """The correlation length is the square root of (number of parameters / this), in coordinates of
    the box from -1 to 1."""
    least: float = 1e-10
    """The least relative variance that a point is assumed to have before it is run."""
    same: float = 1e-9
    """Points that differ by less than this, which rounding can cause, count as the same."""
    narrowest: float = 1e-6
    """The least standard deviation of draws, in coordinates of the box."""


PLACES = PlacementSettings()


def low_discrepancy(count: int, n: int, shift: Array) -> Array:
    """Return `count` points (count, n) of Sobol's sequence in [-1, 1]^n, moved by `shift` modulo 1.

    >>> low_discrepancy(2, 1, np.array([0.25]))
    array([[-0.5], [ 0.5]])
    """
    power = int(np.ceil(np.log2(max(count, 2))))
    base = qmc.Sobol(n, scramble=False).random_base2(power)[:count]
    return np.asarray(2.0 * ((base + shift) % 1.0) - 1.0, dtype=np.float64)


def fixed_shift(n: int) -> Array:
    """Return a fixed shift (n,) of a sequence of points, so that the points have no symmetry.

    With symmetric points two candidates could be equally good.
    """
    return np.asarray(np.sqrt(np.arange(2.0, 2.0 + n)) % 1.0)


def everywhere(n: int, settings: PlacementSettings = PLACES) -> Array:
    """Return evenly spread points (J, n) that represent all of [-1, 1]^n in averages."""
    return low_discrepancy(settings.everywhere, n, fixed_shift(n))


def spread(count: int, n: int, settings: PlacementSettings = PLACES) -> Array:
    """Return the first `count` points (count, n) in [-1, 1]^n of a nested, well separated sequence.

    Each point is the candidate with the largest posterior variance of a Gaussian process with a
    Matern-3/2 covariance (P-greedy; De Marchi, Schaback and Wendland 2005). The coordinates are
    then clustered at the faces of the box. Any first part of the sequence covers the box. `count`
    is at most 4096, the number of candidates. Cost: 4096 count^2 operations, once.

    >>> spread(3, 1).round(1).ravel() ** 2
    array([0., 1., 1.])
    """
    return _greedy(2 ** int(np.ceil(np.log2(count))), n, settings)[:count]


@lru_cache
def _greedy(count: int, n: int, settings: PlacementSettings = PLACES) -> Array:
    t = low_discrepancy(settings.candidates, n, fixed_shift(n))
    # At first all candidates have the same variance; the sequence begins in the middle.
    middle = int(np.argmin((t**2).sum(axis=1)))
    chosen = _least_known(t, np.ones(len(t)), [middle], count, settings)
    return clustered(t[chosen], settings)


def asymmetric(z: Array, count: int) -> Array:
    """Return points z (M, n) reordered, so that point number `count` lies off middle and faces.

    The first points of `spread` are nearly all in the middle or at a face. There z^3 equals z, so
    that a linear surface through them would hide a cubic term.

    >>> asymmetric(np.array([[0.0], [1.0], [-1.0], [0.6]]), 3).ravel().tolist()
    [0.0, 1.0, 0.6, -1.0]
    """
    away = np.minimum(np.abs(z), 1.0 - np.abs(z)).min(axis=1)
    order = np.arange(len(z))
    last = count - 1 + int(np.argmax(away[count - 1 :]))
    order = np.concatenate([order[: count - 1], [last], np.delete(order, last)[count - 1 :]])
    return np.asarray(z[order])


def evenly(z: Array, count: int, settings: PlacementSettings = PLACES) -> Array:
    """Return `count` further, evenly spread points (count, n) in [-1, 1]^n beside runs z (M, n).

    If z are the first points of the sequence of `spread`, its next points are returned; otherwise
    its greedy choice continues from z.

    >>> bool((evenly(spread(5, 2), 3) == spread(8, 2)[5:]).all())
    True
    """
    n = z.shape[1]
    sequence = spread(len(z) + count, n, settings)
    if np.allclose(z, sequence[: len(z)], rtol=0.0, atol=settings.same):
        return sequence[len(z) :]
    candidates = low_discrepancy(settings.candidates, n, fixed_shift(n))
    t = np.vstack([_even(z, settings), candidates])
    chosen = _least_known(t, np.ones(len(t)), list(range(len(z))), len(z) + count, settings)
    return clustered(candidates[chosen[len(z) :] - len(z)], settings)


def continued(z: Array, draws: Array, count: int, settings: PlacementSettings = PLACES) -> Array:
    """Return `count` further points (count, n) in [-1, 1]^n, placed where draws (D, n) are dense.

    The greedy choice of `spread` continues from the runs z (M, n). It multiplies the posterior
    variance at a point by the density of the draws there (a kernel estimate, Scott 1992). The
    candidates are the draws and evenly spread points. Cost: some 2500 (M + count)^2 operations.

    >>> continued(np.array([[0.0]]), np.array([[0.5], [0.6], [0.7]]), 1).round(1).tolist()
    [[0.7]]
    """
    n = z.shape[1]
    candidates = np.vstack(
        [
            np.clip(draws, -1.0, 1.0),
            clustered(low_discrepancy(settings.beside_draws, n, fixed_shift(n)), settings),
        ]
    )
    t = np.vstack([_even(z, settings), _even(candidates, settings)])
    weight = np.concatenate([np.zeros(len(z)), _kernel_density(draws, candidates, settings)])
    chosen = _least_known(t, weight, list(range(len(z))), len(z) + count, settings)
    return candidates[chosen[len(z) :] - len(z)]


def _least_known(
    t: Array, weight: Array, first: list[int], count: int, settings: PlacementSettings = PLACES
) -> Indices:
    """Return `count` row numbers of t (T, n): the `first`, then greedily those of most variance.

    The variance of a row is multiplied by its `weight` (T,).
    """
    length = np.sqrt(t.shape[1] / settings.length)
    factors = np.zeros((count, len(t)))
    variance = np.ones(len(t))
    chosen = np.empty(count, dtype=np.intp)
    free = np.ones(len(t), dtype=np.bool_)
    for k in range(count):
        new = (
            first[k] if k < len(first) else int(np.argmax(np.where(free, variance * weight, -1.0)))
        )
        chosen[k] = new
        free[new] = False
        r = np.sqrt(((t - t[new]) ** 2).sum(axis=1)) / length
        known = factors[:k].T @ factors[:k, new]
        # After a change of the region two points can be almost equal.
        factors[k] = ((1.0 + r) * np.exp(-r) - known) / np.sqrt(max(variance[new], settings.least))
        variance = np.maximum(variance - factors[k] ** 2, 0.0)
    return chosen


def _kernel_density(draws: Array, points: Array, settings: PlacementSettings = PLACES) -> Array:
    """Return a kernel estimate of the density of draws (D, n) at points (P, n), up to a factor."""
    count, n = draws.shape
    scale = np.maximum(draws.std(axis=0), settings.narrowest)
    width = scale * count ** (-1.0 / (n + 4))
    distance = (((points[:, None] - draws) / width) ** 2).sum(axis=2)
    return np.asarray(np.exp(-0.5 * distance).mean(axis=1))


def clustered(t: Array, settings: PlacementSettings = PLACES) -> Array:
    """Return evenly spread points of [-1, 1]^n, moved closer to the faces (inverse of `_even`)."""
    return np.asarray(np.sin(settings.cluster * np.pi * t) / np.sin(settings.cluster * np.pi))


def _even(z: Array, settings: PlacementSettings = PLACES) -> Array:
    return np.asarray(
        np.arcsin(np.clip(z * np.sin(settings.cluster * np.pi), -1.0, 1.0))
        / (settings.cluster * np.pi)
    )


def shares(z: Array, where: Array | None = None, settings: PlacementSettings = PLACES) -> Array:
    """Return the share (M,) of the box [-1, 1]^n that is nearest to each point z (M, n).

    If points `where` (J, n) are given, it is the share of these points.
    """
    n = z.shape[1]
    reference = low_discrepancy(settings.shares, n, fixed_shift(n)) if where is None else where
    nearest = cKDTree(z).query(reference)[1]
    return np.bincount(nearest, minlength=len(z)) / len(reference)


@dataclass(frozen=True)
class SurfaceFitSettings:
    """Settings of the fit of a polynomial to runs, the removal of small terms, and the search for
    the range of the outcome. The values are chosen by judgement."""

    smoothnesses: tuple[float, ...] = (1.5, 2.5, 4.0, 6.0, 9.0)
    """Values of the smoothness of a prior that are tried (see `SmoothnessPrior`)."""
    trends: tuple[float, ...] = (0.0, 0.25, 0.5)
    """Values of the trend of a prior that are tried (see `SmoothnessPrior`)."""
    norms: tuple[float, ...] = (2.0, 1.0, 0.5)
    """Values of the norm of a prior that are tried (see `SmoothnessPrior`)."""
    noises: tuple[float, ...] = (0.0, 0.03, 0.3)
    """Values of the noise of a prior that are tried (see `SmoothnessPrior`)."""
    first: tuple[tuple[float, float, float], ...] = (
        (2.0, 2.5, 0.0), (2.0, 2.5, 0.5), (2.0, 4.0, 0.0), (2.0, 4.0, 0.5),
        (1.0, 2.5, 0.0), (1.0, 4.0, 0.5), (0.5, 4.0, 0.5), (0.5, 2.5, 0.0),
    )  # fmt: skip
    """Norm, smoothness and trend of the priors that are tried first."""
    stretch: float = 1.6
    """Factor by which the scale of one parameter is changed in a step of the search for a prior."""
    scales: tuple[float, float] = (0.1, 12.0)
    """Limits of the scale of a parameter in a prior."""
    terms: int = 2
    """The number of terms of a polynomial is this times the number of runs, plus `more_terms`."""
    more_terms: int = 10
    """The number of terms of a polynomial that does not depend on the number of runs."""
    free: float = 1e6
    """Factor of the prior standard deviation of a term of the trend, which makes it almost free."""
    keep: tuple[int, int] = (5, 2)
    """How many of the priors that most experiments choose have their neighbors tried: first number
    with at most `keep_runs` runs, second number with more runs, where priors change little."""
    keep_runs: int = 200
    """The number of runs up to which the first number of `keep` applies."""
    sweeps: int = 2
    """The number of rounds of the search for a prior."""
    fall: float = 0.01
    """A polynomial of the logarithm is chosen only if it reduces the mean square error to this
    share. Otherwise surfaces could change between outcome and logarithm in every round, and would
    hardly become exact."""
    nearly: float = 1e-3
    """Below this share of a coefficient's prior variance, its posterior variance is not computed as
    a difference from one, which would lose digits."""
    nothing: float = 1e-24
    """Below this share of the prior variance, a posterior variance counts as rounding."""
    negligible: float = 0.1
    """The smallest terms of a polynomial are left out as long as the root of the sum of their
    squares is below this share of the error. The error grows by half a percent, as the root of
    1 + 0.1^2."""
    rounding: float = 1e-14
    """The smallest terms of a polynomial are left out in any case if the root of the sum of their
    squares is below this share of the largest term."""
    group: float = 16.0
    """The number of terms in the smallest group of experiments that are evaluated together."""
    group_growth: float = 1.4
    """Ratio of the number of terms in one group of experiments to that in the next smaller group.
    """
    groups: int = 40
    """The largest number of groups of experiments that are evaluated together."""
    range_points: int = 2048
    """The number of points of the box at which the range of an outcome is sought."""
    range_block: int = 256
    """The number of points that are evaluated together in the search for the range of an outcome.
    """
    corners: int = 10
    """The range of an outcome is also sought at all combinations of the limits of the parameters
    (corners of the box), for at most this many parameters."""
    range_step: float = 0.04
    """First step of the local search for the extremes of an outcome, as a share of the width of the
    box."""
    halvings: int = 10
    """How many times the local search for the extremes of an outcome halves its step."""


FITS = SurfaceFitSettings()
# Smaller errors are raised to this number before their logarithm is taken.
SMALLEST = np.finfo(np.float64).tiny


class SmoothnessPrior(NamedTuple):
    """The prior of the coefficients: standard deviations w_nu = (1 + size(nu)^2)^(-smoothness/2).

    `scale` and `norm` define the size of a multi-index nu (see `ball`). If `trend` is positive, the
    linear terms and the first `trend` M terms for M runs are almost free, otherwise only the
    constant is; polynomials of these terms are reproduced exactly. `noise` is the standard
    deviation g of a run, where w of the constant term is one. With `logarithm` the polynomial is
    that of the logarithm of the outcome, which must be positive in all runs.
    """

    scale: tuple[float, ...]
    norm: float
    smoothness: float
    trend: float
    noise: float = 0.0
    logarithm: bool = False

    def terms(self, y: Array) -> Array:
        """Outcomes y on the scale of the polynomial: their logarithms if `logarithm`."""
        return np.log(y) if self.logarithm else y

    def outcomes(self, t: Array) -> Array:
        """Outcomes (A, ...) from values t (A, ...) of the polynomials."""
        return outcomes(t, np.full(len(t), self.logarithm))


def first_priors(n: int, settings: SurfaceFitSettings = FITS) -> list[SmoothnessPrior]:
    """Return the priors that are tried first, in which all n parameters have the same scale."""
    even = (1.0,) * n
    return [SmoothnessPrior(even, *choice) for choice in settings.first]


def neighbors(prior: SmoothnessPrior, settings: SurfaceFitSettings = FITS) -> list[SmoothnessPrior]:
    """Return the priors that differ in one number: in a length scale or another setting."""
    out = []
    for i, one in enumerate(prior.scale):
        for changed in (one * settings.stretch, one / settings.stretch):
            if settings.scales[0] < changed < settings.scales[1]:
                scale = (*prior.scale[:i], float(f"{changed:.6g}"), *prior.scale[i + 1 :])
                out.append(prior._replace(scale=scale))
    out += [prior._replace(norm=value) for value in _beside(settings.norms, prior.norm)]
    out += [
        prior._replace(smoothness=value)
        for value in _beside(settings.smoothnesses, prior.smoothness)
    ]
    out += [prior._replace(trend=value) for value in _beside(settings.trends, prior.trend)]
    out += [prior._replace(noise=value) for value in _beside(settings.noises, prior.noise)]
    return out


def _beside(values: tuple[float, ...], one: float) -> tuple[float, ...]:
    """Return the one or two values next to `one` in a sequence that contains it."""
    k = values.index(one)
    return values[max(k - 1, 0) : k] + values[k + 1 : k + 2]


def weights(prior: SmoothnessPrior, runs: int) -> tuple[Indices, Array]:
    """Return multi-indices (P, n) and prior standard deviations w (P,) for a number of runs."""
    indices, size = ball(prior.scale, prior.norm, FITS.terms * runs + FITS.more_terms)
    weight = (1.0 + size**2) ** (-0.5 * prior.smoothness)
    free = indices.sum(axis=1) <= (prior.trend > 0.0)
    free[: int(prior.trend * runs)] = True
    return indices, np.where(free, FITS.free * weight, weight)


def _scaled(prior: SmoothnessPrior, z: Array) -> tuple[Indices, Array, Array]:
    """Return multi-indices (P, n), prior standard deviations (P,) and the matrix B of the module.

    B is (P, M) without noise, and (P + M, M) with noise.
    """
    indices, weight = weights(prior, len(z))
    matrix = weight[:, None] * products(indices, z)
    if prior.noise > 0.0:
        matrix = np.vstack([matrix, prior.noise * np.eye(len(z))])
    return indices, weight, matrix


def leave_one_out(prior: SmoothnessPrior, z: Array, t: Array) -> Array:
    """Return the leave-one-out residuals (M, A) of values t (M, A) at points z (M, n).

    The residual of run i is t_i minus the polynomial that is fitted without run i. It is
    r_i = [K^-1 t]_i / [K^-1]_ii (Dubrule 1983), which needs one factorization for all runs and
    experiments.
    """
    triangle = np.linalg.qr(_scaled(prior, z)[2], mode="r")
    inverse = solve_triangular(triangle, np.eye(len(z)))
    return np.asarray((inverse @ (inverse.T @ t)) / (inverse**2).sum(axis=1)[:, None])


@single_threaded
def fitted(prior: SmoothnessPrior, z: Array, y: Array) -> tuple[Indices, Array]:
    """Return multi-indices (P, n) and coefficients (P, A) of polynomials through y (M, A) at z."""
    indices, weight, matrix = _scaled(prior, z)
    q, r = np.linalg.qr(matrix)
    q = q[: len(weight)]
    return indices, weight[:, None] * (q @ solve_triangular(r, prior.terms(y), trans="T"))


class Judged(NamedTuple):
    """Surfaces of A experiments that have runs at the same points, with estimates of their errors.

    `coefficients` and `expected` are on the scale of the polynomials, which is that of the
    logarithm if the prior says so; all other numbers are in units of the outcome.
    """

    indices: Indices
    coefficients: Array  # The coefficients of the polynomials (P, A).
    expected: Array  # The rms error over the box that the prior expects (A,).
    there: Array  # The rms error that the prior expects at the given points, or over the box (A,).
    residual: Array  # The leave-one-out residuals (M, A).
    rate: Array  # The rms derivative of outcomes by polynomials at the given points (A,).


@single_threaded
def judged(prior: SmoothnessPrior, z: Array, y: Array, where: Array | None = None) -> Judged:
    """Return the surfaces with the errors that the prior expects over the box, or at some points.

    The posterior covariance of the coefficients is s^2 W (I - Q Q') W with W = diag(w). Its trace
    is the mean square error over the box, because the basis is orthonormal there. s^2 is the mean
    of the squared leave-one-out residuals divided by their variances 1 / [K^-1]_ii. At points
    `where` (J, n) the mean square error is the mean of s^2 (W phi)' (I - Q Q') W phi. For a
    polynomial of the logarithm it is multiplied by the square of the outcome.
    """
    indices, weight, matrix = _scaled(prior, z)
    q, r = np.linalg.qr(matrix)
    inverse = solve_triangular(r, np.eye(len(z)))
    precision = (inverse**2).sum(axis=1)[:, None]
    t = prior.terms(y)
    dual = inverse @ (inverse.T @ t)
    variance = (dual**2 / precision).mean(axis=0)
    trace = _over_box(q, weight)
    coefficients = weight[:, None] * (q[: len(weight)] @ solve_triangular(r, t, trans="T"))
    expected, residual = np.sqrt(variance * trace), dual / precision
    if not prior.logarithm:
        at = trace if where is None else _at(q, weight, products(indices, where)).mean()
        rate = np.ones_like(variance)
        return Judged(indices, coefficients, expected, np.sqrt(variance * at), residual, rate)
    basis = products(indices, everywhere(z.shape[1]) if where is None else where)
    found = prior.outcomes(coefficients.T @ basis)
    there = found**2 @ _at(q, weight, basis) / basis.shape[1]
    return Judged(
        indices, coefficients, expected, np.sqrt(variance * there),
        missed(y, residual), np.sqrt((found**2).mean(axis=1)),
    )  # fmt: skip


def missed(y: Array, residual: Array) -> Array:
    """Errors of outcomes y (M, A) whose logarithms are predicted with errors `residual` (M, A)."""
    return np.asarray(-y * np.expm1(np.clip(-residual, -SURFACES.largest, SURFACES.largest)))


def _over_box(q: Array, weight: Array, settings: SurfaceFitSettings = FITS) -> float:
    """Return the posterior variance of a surface, averaged over the box, in units of s^2."""
    unknown = 1.0 - (q[: len(weight)] ** 2).sum(axis=1)
    # 1 - |q|^2 loses all digits where a coefficient is almost known. There the small vector itself
    # is squared, and a result as small as rounding counts as zero.
    near = np.flatnonzero(unknown < settings.nearly)
    rest = -(q @ q[near].T)
    rest[near, np.arange(len(near))] += 1.0
    unknown[near] = (rest**2).sum(axis=0)
    unknown[unknown < settings.nothing] = 0.0
    return float(weight**2 @ np.maximum(unknown, 0.0))


def _at(q: Array, weight: Array, basis: Array) -> Array:
    """Return the posterior variance (J,) of a surface at J points, in units of s^2.

    `basis` (P, J) are the values of the polynomials there.
    """
    own = weight[:, None] * basis
    rest = -(q @ (q[: len(weight)].T @ own))
    rest[: len(weight)] += own
    return np.asarray((rest**2).sum(axis=0))


class PriorSearch(NamedTuple):
    """The result of a search for priors.

    `priors` are those that were tried, `best` (A,) is the place of the best for each experiment,
    `error` (A,) its mean square leave-one-out error, and `pool` are priors to begin the next search
    with.
    """

    priors: list[SmoothnessPrior]
    best: Indices
    error: Array
    pool: list[SmoothnessPrior]


@single_threaded
def search(
    pool: list[SmoothnessPrior],
    z: Array,
    y: Array,
    share: Array,
    sweeps: int = FITS.sweeps,
    settings: SurfaceFitSettings = FITS,
) -> PriorSearch:
    """Search the prior with the least leave-one-out error for each of A experiments.

    `y` (M, A) are outcomes at points z (M, n). The priors in `pool` are tried first; each further
    sweep tries the neighbors of those that most experiments chose. A prior takes one factorization
    for all experiments. An experiment with only positive outcomes takes the best prior for their
    logarithms instead, if that makes the error of the outcomes much smaller (`_fall`). In that
    comparison `share` (M,) is the weight of each run.
    """
    score: dict[SmoothnessPrior, Array] = {}
    error: dict[SmoothnessPrior, Array] = {}
    count, positive = y.shape[1], np.flatnonzero((y > 0.0).all(axis=0))
    terms = np.hstack([y, np.log(y[:, positive])])
    trial = list(pool)
    for _ in range(sweeps):
        for prior in trial:
            if prior not in score:
                residual = leave_one_out(prior, z, terms)
                score[prior] = (residual**2).mean(axis=0)
                residual[:, count:] = missed(y[:, positive], residual[:, count:])
                error[prior] = share @ residual**2
        known = sorted(score)
        best = np.argmin([score[prior] for prior in known], axis=0)
        errors = np.array([error[prior] for prior in known])[best, np.arange(best.size)]
        takes = _fall(errors[positive], errors[count:], settings)
        chosen = best[:count].copy()
        chosen[positive[takes]] = best[count:][takes]
        left = errors[:count].copy()
        left[positive[takes]] = errors[count:][takes]
        wins = Counter(known[k] for k in chosen)
        leaders = sorted(wins, key=lambda prior: (-wins[prior], prior))[
            : settings.keep[len(z) > settings.keep_runs]
        ]
        trial = [other for prior in leaders for other in neighbors(prior, settings)]
    chosen[positive[takes]] += len(known)
    known += [prior._replace(logarithm=True) for prior in known]
    pool = list(dict.fromkeys([*leaders, *first_priors(z.shape[1], settings)[:2]]))
    return PriorSearch(known, chosen, left, pool)


def _fall(before: Array, after: Array, settings: SurfaceFitSettings = FITS) -> Flags:
    """Whether the mean square errors (A,) of experiments fall enough from `before` to `after`.

    The fall of an experiment is averaged, in logarithms, with the median over all experiments. The
    experiments are similar, and a few runs of one experiment would leave the choice to chance,
    above all where neither fit is good, as with a kink.
    """
    change = np.log(np.maximum(after, SMALLEST)) - np.log(np.maximum(before, SMALLEST))
    return np.asarray(
        change + (np.median(change) if change.size else 0.0) < 2.0 * np.log(settings.fall)
    )


Piece = tuple[Indices, Indices, Array]


def merged(
    pieces: Iterable[Piece], error: Array, settings: SurfaceFitSettings = FITS
) -> tuple[Indices, tuple[Group, ...]]:
    """Merge polynomials into one common list of multi-indices (P, n), and groups of experiments.

    A piece holds experiments (A,), multi-indices (Q, n) and coefficients (Q, A). A group uses a
    first part of the common list. Terms that most experiments use come first, so that a few large
    polynomials do not slow down the evaluation of the others. Terms that are negligible beside the
    `error` (N,) are left out.
    """
    pieces = list(pieces)
    place: dict[tuple[int, ...], int] = {}
    thinned: list[Piece] = []
    for members, indices, coefficients in pieces:
        kept = _thinned(coefficients.T, error[members], settings)
        used = np.flatnonzero((kept != 0.0).any(axis=0) | ~indices.any(axis=1))
        names = [tuple(nu) for nu in indices[used].tolist()]
        column = np.array([place.setdefault(nu, len(place)) for nu in names])
        thinned.append((members, column, kept[:, used]))
    terms = np.zeros((len(error), len(place)))
    for members, column, kept in thinned:
        terms[np.ix_(members, column)] = kept
    listed = np.array(list(place), dtype=np.intp).reshape(len(place), -1)
    order = np.lexsort((*listed.T, listed.sum(axis=1), -(terms != 0.0).sum(axis=0)))
    listed, terms = listed[order], terms[:, order]
    return listed, _groups(terms, settings)


def _thinned(coefficients: Array, error: Array, settings: SurfaceFitSettings = FITS) -> Array:
    """Return coefficients (A, Q) with those set to zero that are negligible beside `error` (A,)."""
    level = np.abs(coefficients).max(axis=1)
    budget = np.maximum(settings.negligible * error, settings.rounding * level)
    order = np.argsort(np.abs(coefficients), axis=1)
    dropped = np.cumsum(np.take_along_axis(coefficients, order, axis=1) ** 2, axis=1)
    out = np.array(coefficients)
    small = np.take_along_axis(out, order, axis=1)
    small[dropped <= budget[:, None] ** 2] = 0.0
    np.put_along_axis(out, order, small, axis=1)
    return out


def _groups(terms: Array, settings: SurfaceFitSettings = FITS) -> tuple[Group, ...]:
    """Return groups of experiments, the rows of `terms`, that need similar numbers of terms."""
    count = terms.shape[1]
    needed = count - np.argmax((terms != 0.0)[:, ::-1], axis=1)
    needed[~terms.any(axis=1)] = 1
    sizes = np.ceil(settings.group * settings.group_growth ** np.arange(settings.groups))
    steps = np.unique(np.minimum(sizes, count)).astype(np.intp)
    size = steps[np.searchsorted(steps, needed)]
    members = [np.flatnonzero(size == step) for step in steps]
    return tuple(
        Group(rows, np.ascontiguousarray(terms[rows, :step]))
        for rows, step in zip(members, steps, strict=True)
        if len(rows)
    )


def outcome_range(
    surface: Surface, outcomes: Array, settings: SurfaceFitSettings = FITS
) -> tuple[Array, Array]:
    """Return the least and the largest outcome (N,) of each experiment over the box.

    They are the extremes of the outcomes of the runs (N, M), NaN where there is none, and of the
    surface at many points and corners of the box. The extremes of the surface are refined by a
    local search that halves its step.
    """
    n = len(surface.box)
    low, high = surface.box.T
    z = low_discrepancy(settings.range_points, n, fixed_shift(n))
    corners = 2.0 * (np.arange(2 ** min(n, settings.corners))[:, None] >> np.arange(n) & 1) - 1.0
    x = low + 0.5 * (np.vstack([corners, z]) + 1.0) * (high - low)
    best = [np.fmin.reduce(outcomes, axis=1), -np.fmax.reduce(outcomes, axis=1)]
    start = [np.zeros((len(outcomes), n)), np.zeros((len(outcomes), n))]
    found = [np.full(len(outcomes), np.inf), np.full(len(outcomes), np.inf)]
    for part in range(0, len(x), settings.range_block):
        y = surface.evaluate(x[part : part + settings.range_block])
        for side, sign in enumerate((1.0, -1.0)):
            least = (sign * y).argmin(axis=1)
            value = sign * y[np.arange(len(y)), least]
            better = value < found[side]
            found[side][better], start[side][better] = value[better], x[part + least[better]]
    for side, sign in enumerate((1.0, -1.0)):
        polished = _polished(surface, start[side], found[side], sign, settings)
        best[side] = np.fmin(best[side], polished)
    return best[0], -best[1]


def _polished(
    surface: Surface, x: Array, value: Array, sign: float, settings: SurfaceFitSettings = FITS
) -> Array:
    """Return the least sign * outcome (N,) that a compass search from points x (N, n) finds.

    A compass search tries a step along each parameter and takes the best.
    """
    count, n = x.shape
    low, high = surface.box.T
    moves = np.vstack([np.eye(n), -np.eye(n)]) * (high - low)
    step = settings.range_step
    index = np.repeat(np.arange(count), len(moves))
    for _ in range(settings.halvings):
        trial = np.clip(x[:, None] + step * moves, low, high)
        y = sign * surface.at(index, trial.reshape(-1, n)).reshape(count, -1)
        least = y.argmin(axis=1)
        rows = np.flatnonzero(y[np.arange(count), least] < value)
        value[rows], x[rows] = y[rows, least[rows]], trial[rows, least[rows]]
        step *= 0.5
    return value
