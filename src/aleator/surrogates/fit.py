"""From runs to a surface: where runs are placed, the prior of least leave-one-out error.

A surface y = sum_nu c_nu phi_nu has more coefficients than there are runs. Of all that pass through
the runs, the one with the least sum (c_nu / w_nu)^2 is taken: the mean of a Gaussian process whose
coefficients are independent Normal(0, w_nu^2) (Rasmussen and Williams 2006, section 2.7). Plain
interpolation in a fixed set of polynomials amplifies what the set leaves out; this does not. With
B = (w phi; g I), (P + M) x M, = Q R, the covariance of the runs is K = R'R and everything is closed
form; g > 0 lets the surface pass beside noisy runs.
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
    """Where runs are placed; by judgement."""

    cluster: float = 0.4
    """Points gather at the faces of the box, as sin(c t) / sin(c) of evenly spread t does, with c
    this times pi: between even spacing (0), where polynomials oscillate at the faces, and
    Chebyshev's (1/2), which wastes runs there on outcomes with kinks."""
    candidates: int = 4096
    """The sequence is chosen from so many points, hence no longer. Fixed, or it would not be
    nested."""
    beside_draws: int = 2048
    """Candidates all over the box, beside the draws of a law."""
    everywhere: int = 512
    """Points that stand for all the box."""
    shares: int = 8192
    """Points by which parts of the box are measured."""
    length: float = 6.0
    """The length of the covariance is the root of n over this, in coordinates of the box."""
    least: float = 1e-10
    """The least variance, of one, that a point is taken to have before it is run."""
    same: float = 1e-9
    """Points that differ by less are the same: rounding between the box and [-1, 1]^n."""
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
    """Return one shift (n,) without symmetry, so that no two candidates are equally good."""
    return np.asarray(np.sqrt(np.arange(2.0, 2.0 + n)) % 1.0)


def everywhere(n: int, settings: PlacementSettings = PLACES) -> Array:
    """Return points (J, n) that stand for all of [-1, 1]^n."""
    return low_discrepancy(settings.everywhere, n, fixed_shift(n))


def spread(count: int, n: int, settings: PlacementSettings = PLACES) -> Array:
    """Return the first `count` points (count, n) in [-1, 1]^n of a nested, well separated sequence.

    Greedy choice of the point at which a Gaussian process with a Matern-3/2 covariance knows least
    (P-greedy; De Marchi, Schaback and Wendland 2005), in coordinates that gather at the faces.
    Every prefix covers the box; at most as many points as there are candidates. Cost: 4096 count^2
    operations, once.

    >>> spread(3, 1).round(1).ravel() ** 2
    array([0., 1., 1.])
    """
    return _greedy(2 ** int(np.ceil(np.log2(count))), n, settings)[:count]


@lru_cache
def _greedy(count: int, n: int, settings: PlacementSettings = PLACES) -> Array:
    t = low_discrepancy(settings.candidates, n, fixed_shift(n))
    # every candidate is equally unknown at first: begin in the middle
    middle = int(np.argmin((t**2).sum(axis=1)))
    chosen = _least_known(t, np.ones(len(t)), [middle], count, settings)
    return clustered(t[chosen], settings)


def asymmetric(z: Array, count: int) -> Array:
    """Return points z (M, n) in another order: the last of `count` is neither mid nor at a face.

    The first ones of `spread` are nearly all: at these a cube is as good as a line.

    >>> asymmetric(np.array([[0.0], [1.0], [-1.0], [0.6]]), 3).ravel().tolist()
    [0.0, 1.0, 0.6, -1.0]
    """
    away = np.minimum(np.abs(z), 1.0 - np.abs(z)).min(axis=1)
    order = np.arange(len(z))
    last = count - 1 + int(np.argmax(away[count - 1 :]))
    order = np.concatenate([order[: count - 1], [last], np.delete(order, last)[count - 1 :]])
    return np.asarray(z[order])


def evenly(z: Array, count: int, settings: PlacementSettings = PLACES) -> Array:
    """Return `count` more points (count, n) in [-1, 1]^n than z (M, n), evenly spread.

    Those of `spread` where z are its first; else its greedy choice goes on from z.

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
    """Return `count` more points (count, n) in [-1, 1]^n than z (M, n), where draws (D, n) lie.

    The greedy choice of `spread` goes on from the points that there are, and weighs what is not
    known at a point by the density of the draws there (a kernel estimate, Scott 1992). Candidates
    are the draws and low-discrepancy points. Cost: some 2500 (M + count)^2 operations.

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
    """Return `count` rows of t (T, n), the `first` and then greedily those of most variance."""
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
        # points that a region's move brings together can be all but equal
        factors[k] = ((1.0 + r) * np.exp(-r) - known) / np.sqrt(max(variance[new], settings.least))
        variance = np.maximum(variance - factors[k] ** 2, 0.0)
    return chosen


def _kernel_density(draws: Array, points: Array, settings: PlacementSettings = PLACES) -> Array:
    """Return the density (P,) of draws (D, n) at points (P, n), up to a factor."""
    count, n = draws.shape
    scale = np.maximum(draws.std(axis=0), settings.narrowest)
    width = scale * count ** (-1.0 / (n + 4))
    distance = (((points[:, None] - draws) / width) ** 2).sum(axis=2)
    return np.asarray(np.exp(-0.5 * distance).mean(axis=1))


def clustered(t: Array, settings: PlacementSettings = PLACES) -> Array:
    """Return evenly spread points of [-1, 1]^n gathered at the faces; `_even` turns that round."""
    return np.asarray(np.sin(settings.cluster * np.pi * t) / np.sin(settings.cluster * np.pi))


def _even(z: Array, settings: PlacementSettings = PLACES) -> Array:
    return np.asarray(
        np.arcsin(np.clip(z * np.sin(settings.cluster * np.pi), -1.0, 1.0))
        / (settings.cluster * np.pi)
    )


def shares(z: Array, where: Array | None = None, settings: PlacementSettings = PLACES) -> Array:
    """Return the part (M,) of the box [-1, 1]^n, or of points `where`, nearest to each z (M, n)."""
    n = z.shape[1]
    reference = low_discrepancy(settings.shares, n, fixed_shift(n)) if where is None else where
    nearest = cKDTree(z).query(reference)[1]
    return np.bincount(nearest, minlength=len(z)) / len(reference)


@dataclass(frozen=True)
class SurfaceFitSettings:
    """How a polynomial is fitted to runs, thinned and searched for its range; by judgement."""

    smoothnesses: tuple[float, ...] = (1.5, 2.5, 4.0, 6.0, 9.0)
    """Values of the smoothness of a prior that are tried (see `SmoothnessPrior`)."""
    trends: tuple[float, ...] = (0.0, 0.25, 0.5)
    """Values of the trend that are tried."""
    norms: tuple[float, ...] = (2.0, 1.0, 0.5)
    """Values of the norm that are tried."""
    noises: tuple[float, ...] = (0.0, 0.03, 0.3)
    """Values of the noise that are tried (see `SmoothnessPrior`)."""
    first: tuple[tuple[float, float, float], ...] = (
        (2.0, 2.5, 0.0), (2.0, 2.5, 0.5), (2.0, 4.0, 0.0), (2.0, 4.0, 0.5),
        (1.0, 2.5, 0.0), (1.0, 4.0, 0.5), (0.5, 4.0, 0.5), (0.5, 2.5, 0.0),
    )  # fmt: skip
    """Norm, smoothness and trend of the priors to begin with."""
    stretch: float = 1.6
    """Factor by which one parameter is stretched."""
    scales: tuple[float, float] = (0.1, 12.0)
    """Limits of the stretch of a parameter."""
    terms: int = 2
    """Terms of a polynomial for each run."""
    more_terms: int = 10
    """Terms of a polynomial beside those for each run."""
    free: float = 1e6
    """The weight that makes a term of the trend as good as free."""
    keep: tuple[int, int] = (5, 2)
    """Winners whose neighbors are tried, with at most `keep_runs` runs, and with more runs, where
    priors change little."""
    keep_runs: int = 200
    """Runs up to which the larger number of winners is kept."""
    sweeps: int = 2
    """Rounds of the search for a prior."""
    fall: float = 0.01
    """Share of the mean square error that is left where logarithms are taken: with runs that
    change from one scale to the other, round by round, surfaces hardly become exact."""
    nearly: float = 1e-3
    """Share of the variance of a coefficient below which one minus what is known loses digits."""
    nothing: float = 1e-24
    """Share of the variance of a coefficient below which it is rounding."""
    negligible: float = 0.1
    """A term is left out where all that is left out stays under this part of the error: it then
    adds half a percent to it (root of 1 + 0.1^2)."""
    rounding: float = 1e-14
    """The same, over the largest term."""
    group: float = 16.0
    """Terms of the smallest group of experiments."""
    group_growth: float = 1.4
    """Terms of a group over those of the one before."""
    groups: int = 40
    """The most groups."""
    range_points: int = 2048
    """Points of the box at which the range of an outcome is sought."""
    range_block: int = 256
    """Points of the search of a range that are evaluated together."""
    corners: int = 10
    """Parameters of which all corners of the box are points of that search, at most."""
    range_step: float = 0.04
    """First step of the polish, over the width of the box."""
    halvings: int = 10
    """How often that step is halved."""


FITS = SurfaceFitSettings()
# The least error that is compared with another.
SMALLEST = np.finfo(np.float64).tiny


class SmoothnessPrior(NamedTuple):
    """What is assumed of the coefficients: w_nu = (1 + size(nu)^2)^(-smoothness/2).

    `scale` and `norm` define the size of an index (see `ball`). With a `trend` its first `trend` M
    indices and the linear ones are free, else the constant: polynomials in their span are
    reproduced exactly. `noise` is the standard deviation g of the runs, on the scale of w at index
    zero. With `logarithm` the coefficients are those of the logarithm of the outcome, positive in
    all runs.
    """

    scale: tuple[float, ...]
    norm: float
    smoothness: float
    trend: float
    noise: float = 0.0
    logarithm: bool = False

    def terms(self, y: Array) -> Array:
        """What is a polynomial, of outcomes y."""
        return np.log(y) if self.logarithm else y

    def outcomes(self, t: Array) -> Array:
        """The outcomes of polynomials t (A, ...)."""
        return outcomes(t, np.full(len(t), self.logarithm))


def first_priors(n: int, settings: SurfaceFitSettings = FITS) -> list[SmoothnessPrior]:
    """Return the priors to begin with: no preferred parameter."""
    even = (1.0,) * n
    return [SmoothnessPrior(even, *choice) for choice in settings.first]


def neighbors(prior: SmoothnessPrior, settings: SurfaceFitSettings = FITS) -> list[SmoothnessPrior]:
    """Return the priors one step away: one parameter stretched, or one choice moved."""
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
    """Return the values next to one of them."""
    k = values.index(one)
    return values[max(k - 1, 0) : k] + values[k + 1 : k + 2]


def weights(prior: SmoothnessPrior, runs: int) -> tuple[Indices, Array]:
    """Return indices (P, n) and weights w (P,) for a number of runs."""
    indices, size = ball(prior.scale, prior.norm, FITS.terms * runs + FITS.more_terms)
    weight = (1.0 + size**2) ** (-0.5 * prior.smoothness)
    free = indices.sum(axis=1) <= (prior.trend > 0.0)
    free[: int(prior.trend * runs)] = True
    return indices, np.where(free, FITS.free * weight, weight)


def _scaled(prior: SmoothnessPrior, z: Array) -> tuple[Indices, Array, Array]:
    """Return indices (P, n), weights (P,) and the matrix B ((P, M) or, with noise, (P + M, M))."""
    indices, weight = weights(prior, len(z))
    matrix = weight[:, None] * products(indices, z)
    if prior.noise > 0.0:
        matrix = np.vstack([matrix, prior.noise * np.eye(len(z))])
    return indices, weight, matrix


def leave_one_out(prior: SmoothnessPrior, z: Array, t: Array) -> Array:
    """Return t_i minus the polynomial fitted without run i (M, A), for t (M, A) at z (M, n).

    r_i = [K^-1 y]_i / [K^-1]_ii (Dubrule 1983): one factorization for all runs and experiments.
    """
    triangle = np.linalg.qr(_scaled(prior, z)[2], mode="r")
    inverse = solve_triangular(triangle, np.eye(len(z)))
    return np.asarray((inverse @ (inverse.T @ t)) / (inverse**2).sum(axis=1)[:, None])


@single_threaded
def fitted(prior: SmoothnessPrior, z: Array, y: Array) -> tuple[Indices, Array]:
    """Return indices (P, n) and coefficients (P, A) of the surfaces through runs y (M, A)."""
    indices, weight, matrix = _scaled(prior, z)
    q, r = np.linalg.qr(matrix)
    q = q[: len(weight)]
    return indices, weight[:, None] * (q @ solve_triangular(r, prior.terms(y), trans="T"))


class Judged(NamedTuple):
    """Surfaces of some experiments through the same runs, and what the runs say of their error.

    `expected` is in units of the polynomials, and all else in those of the outcome.
    """

    indices: Indices
    coefficients: Array  # (P, A)
    expected: Array  # (A,) root-mean-square error over the box that the prior expects
    there: Array  # (A,) the same at the points that were asked for, or over the box
    residual: Array  # (M, A) leave-one-out
    rate: Array  # (A,) root-mean-square derivative there of outcomes by polynomials


@single_threaded
def judged(prior: SmoothnessPrior, z: Array, y: Array, where: Array | None = None) -> Judged:
    """Return the surfaces with the error that the prior expects over the box, or at some points.

    The posterior covariance of the coefficients is s^2 W (I - Q Q') W; its trace is the mean
    square error over the box, because the basis is orthonormal there. s^2 is the mean square of
    the leave-one-out residuals over their variances 1 / [K^-1]_ii. At points `where` (J, n) it is
    the mean of s^2 (W phi)' (I - Q Q') W phi, for a logarithm times the square of the outcome.
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
    """Outcomes (M, A) minus those of polynomials of logarithms that are off by `residual`."""
    return np.asarray(-y * np.expm1(np.clip(-residual, -SURFACES.largest, SURFACES.largest)))


def _over_box(q: Array, weight: Array, settings: SurfaceFitSettings = FITS) -> float:
    """Return the mean posterior variance over the box, in units of s^2."""
    unknown = 1.0 - (q[: len(weight)] ** 2).sum(axis=1)
    # 1 - |q|^2 loses all digits where a coefficient is all but known: square the small vector
    # itself there, and take what is left at the level of rounding for nothing.
    near = np.flatnonzero(unknown < settings.nearly)
    rest = -(q @ q[near].T)
    rest[near, np.arange(len(near))] += 1.0
    unknown[near] = (rest**2).sum(axis=0)
    unknown[unknown < settings.nothing] = 0.0
    return float(weight**2 @ np.maximum(unknown, 0.0))


def _at(q: Array, weight: Array, basis: Array) -> Array:
    """Return the posterior variance (J,) at points with basis (P, J), in units of s^2."""
    own = weight[:, None] * basis
    rest = -(q @ (q[: len(weight)].T @ own))
    rest[: len(weight)] += own
    return np.asarray((rest**2).sum(axis=0))


class PriorSearch(NamedTuple):
    """Priors, the `best` of them (A,), its mean square `error` (A,), and a pool to go on with."""

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
    """Return priors, the best of them for each experiment (A,), and the pool to go on with.

    All experiments are judged together, one factorization a prior; each takes the prior with the
    least leave-one-out error. Where all its outcomes are positive it takes the best prior of their
    logarithms instead, if outcomes are missed by less (`_fall`), each with the share (M,) of its
    run.
    The neighbors of the most frequent winners are tried in turn; with one sweep only the pool is.
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
    """Whether mean square errors (A,) fall enough, by the mean of the experiment and the median.

    The experiments are alike, and the few runs of one tell little: where neither is good, as with a
    kink, chance would choose.
    """
    change = np.log(np.maximum(after, SMALLEST)) - np.log(np.maximum(before, SMALLEST))
    return np.asarray(
        change + (np.median(change) if change.size else 0.0) < 2.0 * np.log(settings.fall)
    )


Piece = tuple[Indices, Indices, Array]


def merged(
    pieces: Iterable[Piece], error: Array, settings: SurfaceFitSettings = FITS
) -> tuple[Indices, tuple[Group, ...]]:
    """Return common indices (P, n), and groups over its prefixes with their coefficients.

    A piece holds experiments (A,), indices (Q, n) and coefficients (Q, A). Terms used by most
    experiments come first, so that the few large surfaces do not make everyone pay.
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
    """Return coefficients (A, Q) with the smallest of each row set to zero."""
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
    """Return groups of experiments (rows) that need about the same number of leading terms."""
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

    From the runs (N, M), NaN where there is none, a search over points and corners of the box, and
    a polish of the best of them that halves its step.
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
    """Return the least sign * outcome (N,) that a compass search from x (N, n) finds."""
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
