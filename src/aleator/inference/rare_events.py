"""Rare events and tolerance limits of outcomes, computed by importance sampling.

An `Event` is an outcome in given intervals. `importance_density` is a mixture of normal densities,
found by the cross-entropy method, from which points are drawn to compute its probability.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize, special
from scipy.stats import qmc

from aleator.core.types import Array, Flags
from aleator.inference.alpha_draws import quantiles


@dataclass(frozen=True)
class Event:
    """The event that an outcome lies in one of the intervals `parts`, which do not overlap.

    >>> Event(((1.0, np.inf),)).holds(np.array([0.5, 2.0])).tolist()
    [False, True]
    >>> Event(((1.0, 2.0),)).contrary.parts
    ((-inf, 1.0), (2.0, inf))
    """

    parts: tuple[tuple[float, float], ...]

    @property
    def contrary(self) -> Event:
        """The event of all other outcomes."""
        ends = [-np.inf, *(end for part in self.parts for end in part), np.inf]
        pairs = zip(ends[::2], ends[1::2], strict=True)
        return Event(tuple((low, high) for low, high in pairs if low < high))

    def holds(self, y: Array) -> Flags:
        """Which outcomes y are in the event; NaN is not."""
        found = np.zeros(y.shape, dtype=np.bool_)
        for low, high in self.parts:
            found |= (y > low) & (y < high)
        return found

    def distance(self, y: Array) -> Array:
        """The distances of outcomes y from the nearest end of an interval."""
        ends = [end for part in self.parts for end in part if np.isfinite(end)]
        return np.asarray(np.min([np.abs(y - end) for end in ends], axis=0))

    def missed(self, y: Array) -> Array:
        """The distances of outcomes y from the event: zero in the event, infinite for NaN."""
        away = [np.maximum(low - y, y - high) for low, high in self.parts]
        outside = np.maximum(np.min(away, axis=0), np.finfo(float).tiny)
        return np.where(self.holds(y), 0.0, np.nan_to_num(outside, nan=np.inf, posinf=np.inf))


Missed = Callable[[Array], tuple[Array, Array]]
"""A function of points u (J, d): how far outcomes miss an event (L, J), and weights (L, J), for L
laws.

The distance is zero in the event, and infinite where there is no outcome. Weights sum to one over
the laws.
"""


@dataclass(frozen=True)
class CrossEntropy:
    """Settings of the importance density of an event, chosen by `benchmarks limit_states`.

    Each of at most `rounds` rounds draws `points` from the present mixture. `components` normal
    densities are fitted to the points in the event, and widened by the factor `wider`. The law
    itself, and the law with each of the `scales`, keep at least the share `floor` in every mixture.
    An intermediate level of the event is sought such that the points that reach it are worth
    `effective` points of equal weight. A density is not improved further when its points in the
    event are worth the share `enough` of all. `iterations` is the number of steps of
    expectation-maximization.
    """

    points: int = 2048
    rounds: int = 12
    components: int = 8
    wider: float = 1.2
    floor: float = 0.07
    scales: tuple[float, ...] = (1.6, 2.6)
    effective: float = 100.0
    enough: float = 0.25
    iterations: int = 20


@dataclass(frozen=True)
class RareEventSettings:
    """Settings of points and levels of rare events. The values are chosen by judgement.

    edge: distance from zero and one that uniform numbers keep.
    stream: number of the random stream for the fits, separate from that of the points.
    seeds: difference between the seeds of two searches, whose rounds use consecutive seeds.
    levels: an intermediate level is located among the sorted distances to one part in so many.
    round: variance in all directions that is added to a component with a small number of points.
    tail: least probability beyond an end of a content interval, and tolerance of this probability.
    """

    edge: float = 1e-14
    stream: int = 5
    seeds: int = 1000
    levels: int = 1000
    round: float = 0.1
    tail: float = 1e-6


RARE_EVENTS = RareEventSettings()


@dataclass(frozen=True, eq=False)
class ImportanceDensity:
    """A mixture of M normal densities in d dimensions: `shares` (M,), `means` (M, d), `factors`.

    `factors` (M, d, d) are Cholesky factors of the covariances. The first components are the law
    itself and the law with other scales.
    """

    shares: Array
    means: Array
    factors: Array

    @classmethod
    def of_law(cls, variates: int, scales: tuple[float, ...]) -> ImportanceDensity:
        """The mixture of normal laws of scale one and of the other scales, in equal shares."""
        every = np.array([1.0, *scales])
        return cls(
            np.full(every.size, 1.0 / every.size),
            np.zeros((every.size, variates)),
            every[:, None, None] * np.eye(variates),
        )

    def drawn(self, points: Array) -> Array:
        """Points (J, d) from uniform points (J, d + 1); their last column chooses the component."""
        normal = special.ndtri(np.clip(points[:, :-1], RARE_EVENTS.edge, 1.0 - RARE_EVENTS.edge))
        last = len(self.shares) - 1
        owner = np.minimum(np.searchsorted(np.cumsum(self.shares), points[:, -1]), last)
        return np.asarray(self.means[owner] + np.einsum("jkl,jl->jk", self.factors[owner], normal))

    def log_parts(self, u: Array) -> Array:
        """Logarithms (M, J) of share times density at u (J, d), without factor (2 pi)^(-d/2)."""
        parts = np.empty((len(self.shares), len(u)))
        for k, (share, mean, factor) in enumerate(
            zip(self.shares, self.means, self.factors, strict=True)
        ):
            away = linalg.solve_triangular(factor, (u - mean).T, lower=True, check_finite=False)
            parts[k] = (
                np.log(max(share, np.finfo(float).tiny))
                - 0.5 * np.sum(away**2, axis=0)
                - np.log(np.diag(factor)).sum()
            )
        return parts

    def weights(self, u: Array) -> Array:
        """The density of the law divided by that of the mixture (J,), at u (J, d)."""
        log = np.logaddexp.reduce(self.log_parts(u), axis=0)
        return np.asarray(np.exp(-0.5 * np.sum(u**2, axis=1) - log))


def uniform_points(count: int, dimensions: int, seed: int) -> Array:
    """Scrambled Sobol' points (count, dimensions); `count` is a power of two."""
    return np.asarray(qmc.Sobol(dimensions, rng=seed).random_base2(count.bit_length() - 1))


def importance_density(
    missed: Missed, variates: int, choice: CrossEntropy, seed: int = 0
) -> tuple[ImportanceDensity, bool]:
    """A mixture near the density phi(u) 1(u in the event)/P, and whether a point was in the event.

    It is found by the multilevel cross-entropy method (Rubinstein and Kroese, 2004) with normal
    mixtures fitted by expectation-maximization (Kurtz and Song, 2013). A level is the least
    distance from the event within which there are enough points. Points of all rounds are used;
    their weight is the density of the law over the mean of the densities of all rounds (Owen and
    Zhou, 2000). The law and wider laws keep a share of the mixture. Parts of the event that are not
    known yet can thus still be found, and weights are bounded.
    """
    rng = np.random.default_rng([seed, RARE_EVENTS.stream])
    mixture = ImportanceDensity.of_law(variates, choice.scales)
    used: list[ImportanceDensity] = []
    u, misses, shares = np.empty((0, variates)), None, None
    for round_ in range(choice.rounds):
        start = RARE_EVENTS.seeds * seed + round_
        fresh = mixture.drawn(uniform_points(choice.points, variates + 1, start))
        miss, share = missed(fresh)
        used.append(mixture)
        u = np.concatenate([u, fresh])
        misses = miss if misses is None else np.concatenate([misses, miss], axis=1)
        shares = share if shares is None else np.concatenate([shares, share], axis=1)
        own = _within(0.0, mixture.weights(fresh), miss, share)
        if _effective(own) > choice.enough * choice.points:
            break
        log = [np.logaddexp.reduce(part.log_parts(u), axis=0) for part in used]
        mean = np.logaddexp.reduce(log, axis=0) - np.log(len(used))
        ratio = np.exp(-0.5 * np.sum(u**2, axis=1) - mean)
        weights = _level(ratio, misses, shares, choice.effective)
        if weights is None:
            continue
        mixture = _fitted(u, weights, variates, choice, rng)
    assert misses is not None
    return mixture, bool(np.any(misses <= 0.0))


def _effective(weights: Array) -> float:
    """The effective number of points with these weights, (sum w)^2/sum w^2 (Kish, 1965)."""
    square = float(np.sum(weights**2))
    return float(np.sum(weights)) ** 2 / square if square > 0.0 else 0.0


def _within(level: float, ratio: Array, misses: Array, shares: Array) -> Array:
    """Weights (J,) of the points that miss the event by no more than a level.

    They are the sum of two weights: those under the mixture of all laws, and those that give each
    law the same influence. By the mixture alone, laws under which the event is far less probable
    would have no points, and these laws determine the lower end of an interval of its probability.
    """
    each = ratio * shares * (misses <= level)
    own = each.sum(axis=1)
    counted = own > 0.0
    if not counted.any():
        return np.zeros(len(ratio))
    alike = np.mean(each[counted] / own[counted, None], axis=0)
    return np.asarray(each.sum(axis=0) / own.sum() + alike)


def _level(ratio: Array, misses: Array, shares: Array, effective: float) -> Array | None:
    """Weights (J,) of the points within the smallest level that contains enough of them.

    None where no point has an outcome.
    """

    def within(level: float) -> Array:
        return _within(level, ratio, misses, shares)

    found = within(0.0)
    if _effective(found) >= effective:
        return found
    finite = np.sort(misses[np.isfinite(misses)])
    if not finite.size:
        return None
    low, high = 0, finite.size - 1
    while high - low > finite.size // RARE_EVENTS.levels + 1:
        middle = (low + high) // 2
        if _effective(within(float(finite[middle]))) >= effective:
            high = middle
        else:
            low = middle
    return within(float(finite[high]))


def _fitted(
    u: Array, weights: Array, variates: int, choice: CrossEntropy, rng: np.random.Generator
) -> ImportanceDensity:
    """The normal mixture of least cross-entropy to the weighted points."""
    counted = weights > 0.0
    u, w = u[counted], weights[counted] / weights.sum()
    law = ImportanceDensity.of_law(variates, choice.scales)
    fixed = len(law.shares)
    means = u[_distant(u, w, choice.components, rng)]
    size = fixed + len(means)
    mixture = ImportanceDensity(
        np.full(size, 1.0 / size),
        np.concatenate([law.means, means]),
        np.concatenate([law.factors, np.tile(np.eye(variates), (len(means), 1, 1))]),
    )
    for _ in range(choice.iterations):
        parts = mixture.log_parts(u)
        owned = np.exp(parts - np.logaddexp.reduce(parts, axis=0)) * w
        mass = owned.sum(axis=1)
        means, factors = mixture.means.copy(), mixture.factors.copy()
        for k in range(fixed, size):
            if not mass[k] > 0.0:
                continue
            means[k] = owned[k] @ u / mass[k]
            away = u - means[k]
            spread = (owned[k][:, None] * away).T @ away / mass[k]
            factors[k] = np.linalg.cholesky(_rounder(spread, _effective(owned[k])))
        mixture = ImportanceDensity(mass, means, factors)
    floor = np.zeros(size)
    floor[:fixed] = choice.floor
    factors = mixture.factors.copy()
    factors[fixed:] *= choice.wider
    shares = (1.0 - floor.sum()) * mixture.shares / mixture.shares.sum() + floor
    return ImportanceDensity(shares, mixture.means, factors)


def _rounder(spread: Array, count: float) -> Array:
    """A covariance (d, d), shrunk towards equal variances; more so with fewer points."""
    d = len(spread)
    alike = (d + 1.0) * float(np.trace(spread)) / d + RARE_EVENTS.round
    return np.asarray((count * spread + alike * np.eye(d)) / (count + d + 1.0))


def _distant(u: Array, weights: Array, count: int, rng: np.random.Generator) -> Array:
    """Indices of points that are far from each other, chosen at random (k-means++, 2007)."""
    chosen = [int(rng.choice(len(u), p=weights))]
    nearest = np.sum((u - u[chosen[0]]) ** 2, axis=1)
    while len(chosen) < min(count, len(u)):
        chance = weights * nearest
        if not chance.sum() > 0.0:
            break
        chosen.append(int(rng.choice(len(u), p=chance / chance.sum())))
        nearest = np.minimum(nearest, np.sum((u - u[chosen[-1]]) ** 2, axis=1))
    return np.array(chosen)


def quantile_bound(
    y: Array, weights: Array, draws: Array, probability: float, confidence: float
) -> tuple[float, Array]:
    """The upper confidence bound of a quantile over A laws, and the quantile under each law (A,).

    `y` (A, J) are outcomes with `weights` (A, J) under the laws. The laws themselves have the
    weights `draws` (A,).
    """
    each = quantiles(y, weights, np.array([probability]))[:, 0]
    return float(quantiles(each, draws, np.array([confidence]))[0]), each


def content_interval(
    y: Array, weights: Array, draws: Array, content: float, confidence: float
) -> tuple[float, float]:
    """The interval that contains the share `content` of a law with the given confidence.

    It is a content tolerance interval (Wilks, 1941; Hamada et al., 2004). Its ends are the
    quantiles of t and 1 - t of the mixture of all laws. t is the largest value for which laws with
    a total weight of `confidence` have at least that content between the ends. NaN where the points
    do not reach far enough. Outcomes that are NaN do not count.
    """
    lost = np.isnan(y)
    y, weights = np.where(lost, 0.0, y), np.where(lost, 0.0, weights)
    total = weights.sum(axis=1)
    every = np.argsort(y, axis=None)
    values, whole = y.ravel()[every], (draws[:, None] * weights).ravel()[every]
    below = (np.cumsum(whole) - 0.5 * whole) / whole.sum()

    def ends(t: float) -> Array:
        return np.interp([t, 1.0 - t], below, values)

    order = np.argsort(y, axis=1)
    sorted_y = np.take_along_axis(y, order, axis=1)
    reached = np.cumsum(np.take_along_axis(weights, order, axis=1), axis=1)
    middle = reached - 0.5 * np.take_along_axis(weights, order, axis=1)

    def excess(t: float) -> float:
        low, high = ends(t)
        inside = [
            np.interp(high, row, m, 0.0, w) - np.interp(low, row, m, 0.0, w)
            for row, m, w in zip(sorted_y, middle, total, strict=True)
        ]
        shares = np.array(inside) / total
        return float(quantiles(shares, draws, np.array([1.0 - confidence]))[0]) - content

    least, most = RARE_EVENTS.tail, 0.5 * (1.0 - content)
    if excess(least) < 0.0:
        return float("nan"), float("nan")
    t = most if excess(most) >= 0.0 else float(optimize.brentq(excess, least, most, xtol=least))
    low, high = ends(t)
    return float(low), float(high)
