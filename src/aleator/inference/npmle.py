"""The nonparametric maximum likelihood estimate (NPMLE): the best of all laws of the parameters.

Over all probability laws G on a region it maximizes sum_l log int p(y_l | x) dG(x) (Kiefer and
Wolfowitz, 1956). It is a law of at most N points: weights of given points are a concave problem
with a certificate (`mixed`), and the points are climbed to where the gradient function is highest
(`npmle`). Whether a law is worse than it by more than chance is judged by parametric bootstrap
(`judged`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import linalg, optimize, sparse
from scipy.spatial import cKDTree

from aleator.core.progress import Progress
from aleator.core.threads import single_threaded
from aleator.core.types import Array, Indices
from aleator.inference.fit import Fit, climbed, stepped


@dataclass(frozen=True)
class NPMLESettings:
    """How weights and points of the best law are computed, and its gap tested; by judgement."""

    weighed: float = 1e-7
    """Of the gradient function, over its largest value at the end."""
    steps: int = 200
    """Newton steps to the weights, at most."""
    covered: float = 0.05
    """Share of its largest likelihood that each experiment has at one of the first points."""
    entering: int = 8
    """Points that enter in one step."""
    shortest: float = 1e-4
    """Of a step that is cut."""
    rise: float = 1e-4
    """Share of the rise that the gradient promises."""
    crosses: int = 40
    """Rounds of an ascent of the gradient function, at most."""
    finest: float = 1e-6
    """Step at the end, over the width of the region."""
    narrower: float = 0.25
    """Width of a cross over the one before, where the point in its middle is the highest."""
    flat: float = 1e-3
    """Least curvature along an axis, over the largest of all axes."""
    flattest: float = 1e-6
    """Least curvature along an axis, over the slope."""
    farthest: float = 8.0
    """Steps that Newton's may be long."""
    starts: int = 12
    """Local maxima of the gradient function that are climbed in a round."""
    last: int = 40
    """The same in the end."""
    rounds: int = 40
    """Rounds in which points join the law, at most."""
    enough: float = 1e-4
    """Of the log-likelihood, what other points may still add."""
    near: float = 0.05
    """Distance of points that may be one."""
    same: float = 0.01
    """Distance of points that are merged."""
    alike: float = 1e-3
    """Log-likelihood that merging may cost."""
    largest: float = 700.0
    """Exponent of the largest ratio that is told."""
    climbed: float = 0.01
    """What may be left to climb in a replicate, in log-likelihood."""
    coarse: float = 1e-5
    """Of the gradient function, over its largest value in a replicate."""
    exceeded: int = 10
    """Replicates above the gap after which no more are drawn."""


NPMLE_SETTINGS = NPMLESettings()


@dataclass(frozen=True, eq=False)
class Mixing:
    """Weights (J,) of the points of a law, and log f_l (N,) of each experiment under it.

    `gradient` (J,) is D_j = mean_l L_lj / f_l - 1. No weights of these points have a
    log-likelihood above that of these by more than `gap` = N log(1 + max D).
    """

    weights: Array
    each: Array
    gradient: Array

    @property
    def log_likelihood(self) -> float:
        """sum_l log f_l."""
        return float(self.each.sum())

    @property
    def gap(self) -> float:
        """The log-likelihood of the best law on points x (J, n) minus that of the fit."""
        return bound(self.gradient, self.each.size)

    @property
    def support(self) -> Indices:
        """The points that have a weight."""
        return np.flatnonzero(self.weights)


def bound(gradient: Array, experiments: int) -> float:
    """The bound N log(1 + max D) of what a law on these points may gain (Jensen's inequality)."""
    return experiments * float(np.log1p(max(gradient.max(initial=0.0), 0.0)))


@single_threaded
def mixed(
    log_density: Array,
    enough: float = NPMLE_SETTINGS.weighed,
    settings: NPMLESettings = NPMLE_SETTINGS,
) -> Mixing:
    """The weights w that maximize sum_l log sum_j w_j exp(log_density[l, j]), (N, J).

    Kiefer and Wolfowitz (1956) showed the estimate consistent; D <= 0 at all points marks the
    maximum (Lindsay, 1983). Solved by Newton steps whose quadratic problem on the simplex is a
    nonnegative least-squares problem, on the few points that have weight and those of largest D
    (Wang, 2007). NaN counts as -inf. An experiment that no point explains has -inf, and no part in
    the weights. Cost: some twenty products with the matrix.

    >>> found = mixed(np.log([[0.9, 0.1, 0.5], [0.1, 0.9, 0.5]]))
    >>> found.weights.round(6).tolist(), round(found.log_likelihood, 6)
    ([0.5, 0.5, 0.0], -1.386294)
    """
    log_density = np.nan_to_num(log_density, nan=-np.inf, neginf=-np.inf)
    top = log_density.max(axis=1)
    known = np.isfinite(top)
    if not known.any():
        count = log_density.shape[1]
        return Mixing(np.full(count, 1.0 / count), top, np.zeros(count))
    density = np.exp(log_density[known] - top[known, None])
    weights = _ascended(density, enough, settings)
    each = np.full(top.size, -np.inf)
    f = density @ weights
    each[known] = top[known] + np.log(f)
    return Mixing(weights, each, _gradient(density, f))


def _ascended(density: Array, enough: float, settings: NPMLESettings) -> Array:
    """Weights by Newton steps from a few points that explain every experiment."""
    weights = np.zeros(density.shape[1])
    first = _cover(density, settings)
    weights[first] = 1.0 / max(first.size, 1)
    for _ in range(settings.steps):
        f = density @ weights
        gradient = _gradient(density, f)
        if gradient.max(initial=0.0) <= enough:
            break
        entering = np.argsort(-gradient)[: settings.entering]
        at = np.union1d(np.flatnonzero(weights), entering[gradient[entering] > 0.0])
        moved = np.zeros_like(weights)
        moved[at] = _newton(density[:, at] / f[:, None])
        better = _searched(density, weights, moved, gradient, settings)
        if better is None:
            break
        weights = better
    return weights


def _cover(density: Array, settings: NPMLESettings) -> Indices:
    """Points such that each experiment has a considerable likelihood at one of them."""
    chosen, open_ = list[int](), np.ones(len(density), dtype=np.bool_)
    while open_.any():
        chosen.append(int(np.argmax(density[open_].sum(axis=0))))
        reached = density[:, chosen[-1]] >= settings.covered
        if not np.any(reached & open_):
            chosen[-1] = int(np.argmax(density[np.argmax(open_)]))
            reached = density[:, chosen[-1]] >= settings.covered
        open_ &= ~reached
    return np.unique(np.array(chosen, dtype=np.intp))


def _newton(ratio: Array) -> Array:
    """The weights that minimize |ratio w - 2|^2 on the simplex: the parabola of the objective.

    As sum w = 1 that is |P w|^2 with P = ratio - 2, homogeneous in w, and the constraint is met by
    scaling the minimum of |P w|^2 + (sum w - 1)^2 (Dax, 1990).
    """
    reduced = linalg.qr(ratio - 2.0, mode="r", check_finite=False)[0][: ratio.shape[1]]
    rows = np.vstack([reduced, np.ones(ratio.shape[1])])
    right = np.zeros(len(rows))
    right[-1] = 1.0
    weights = optimize.nnls(rows, right)[0]
    return np.asarray(weights / weights.sum())


def _searched(
    density: Array, weights: Array, moved: Array, gradient: Array, settings: NPMLESettings
) -> Array | None:
    """The weights on the way to `moved` where the log-likelihood rises; None without any."""
    promised = len(density) * float(gradient @ (moved - weights))
    now, then = density @ weights, density @ moved
    share = 1.0
    while share > settings.shortest:
        with np.errstate(divide="ignore"):
            rise = float(np.log(now + share * (then - now)).sum() - np.log(now).sum())
        if rise >= settings.rise * share * promised:
            return weights + share * (moved - weights)
        share *= 0.5
    return None


def _gradient(density: Array, f: Array) -> Array:
    return np.asarray((1.0 / f) @ density / len(f) - 1.0)


Function = Callable[[Array], Array]


def uphill(
    function: Function, starts: Array, step: float, settings: NPMLESettings = NPMLE_SETTINGS
) -> Array:
    """Local maxima (P, s) of a function on the unit cube, uphill from `starts` (P, s).

    Each round asks for the function on a cross about every point, takes the best of the cross and
    of the top of its parabola, and makes the cross a quarter as wide where nothing is better.
    `function` gives (Q,) at points (Q, s). Cost: some 20 rounds of P (2 s^2 + 2) values.
    """
    s = starts.shape[1]
    cross = _cross(s)
    points, width = starts.copy(), np.full(len(starts), step)
    value = function(points)
    for _ in range(settings.crosses):
        moving = np.flatnonzero(width > settings.finest)
        if not moving.size:
            break
        about = np.clip(points[moving, None] + width[moving, None, None] * cross, 0.0, 1.0)
        around = function(about.reshape(-1, s)).reshape(len(moving), -1)
        top = _top(points[moving], width[moving], value[moving], around, settings)
        trial = np.concatenate([about, top[:, None]], axis=1)
        values = np.concatenate([around, function(top)[:, None]], axis=1)
        best = np.argmax(values, axis=1)
        rows = np.arange(len(moving))
        higher = values[rows, best] > value[moving]
        length = np.linalg.norm(trial[rows, best] - points[moving], axis=1)
        points[moving[higher]] = trial[rows, best][higher]
        value[moving[higher]] = values[rows, best][higher]
        near = ~higher | ((best == len(cross)) & (length < width[moving]))
        width[moving[near]] *= settings.narrower
    return points


def local_maxima(points: Array, value: Array, most: int) -> Indices:
    """Those of points (J, s) that are higher than their neighbours, the highest first."""
    s = points.shape[1]
    nearest = (
        cKDTree(points).query(points, min(1 + 2 * s * s, len(points)))[1].reshape(len(points), -1)
    )
    found = np.flatnonzero(value >= value[nearest].max(axis=1))
    return found[np.argsort(-value[found], kind="stable")][:most]


def _cross(s: int) -> Array:
    """Steps (2 s^2, s) along each axis and along both diagonals of each two."""
    axes = np.eye(s)
    steps = [sign * axis for axis in axes for sign in (1.0, -1.0)]
    for i, j in combinations(range(s), 2):
        steps += [a * axes[i] + b * axes[j] for a in (1.0, -1.0) for b in (1.0, -1.0)]
    return np.array(steps)


def _top(
    points: Array, width: Array, value: Array, around: Array, settings: NPMLESettings
) -> Array:
    """The top of the parabola through each cross; without one a step up the slope."""
    count, s = points.shape
    up, down = around[:, 0 : 2 * s : 2], around[:, 1 : 2 * s : 2]
    slope = 0.5 * (up - down)
    curvature = np.zeros((count, s, s))
    diagonal = np.arange(s)
    curvature[:, diagonal, diagonal] = up + down - 2.0 * value[:, None]
    for k, (i, j) in enumerate(combinations(range(s), 2)):
        pp, pm, mp, mm = around[:, 2 * s + 4 * k : 2 * s + 4 * k + 4].T
        curvature[:, i, j] = curvature[:, j, i] = 0.25 * (pp - pm - mp + mm)
    bent, axes = np.linalg.eigh(np.nan_to_num(curvature))
    along = np.einsum("pij,pi->pj", axes, np.nan_to_num(slope))
    flat = settings.flat * np.max(np.abs(bent), axis=1, keepdims=True)
    # a step that is much too long is cut anyhow
    least = settings.flattest * np.abs(along) + np.finfo(float).tiny
    along /= np.maximum(np.maximum(np.abs(bent), flat), least)
    step = np.einsum("pij,pj->pi", axes, along)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    step *= settings.farthest / np.maximum(length, settings.farthest)
    return np.asarray(np.clip(points + width[:, None] * step, 0.0, 1.0))


LogDensity = Callable[[Array], Array]
"""log p(observations of each experiment | point) (N, J) at points (J, s) of the unit cube."""


@dataclass(frozen=True, eq=False)
class NPMLE:
    """The law of largest likelihood: weights (S,) of points (S, s) of the unit cube.

    `each` (N,) is log f_l. `gap` is how much larger the log-likelihood of any law can be, as far
    as the points at which the gradient function was sought tell.
    """

    points: Array
    weights: Array
    each: Array
    gap: float

    @property
    def log_likelihood(self) -> float:
        """sum_l log f_l."""
        return float(self.each.sum())


def gradient(
    log_density: LogDensity, each: Array, points: Array, settings: NPMLESettings = NPMLE_SETTINGS
) -> Array:
    """The gradient function D(x) = mean_l exp(log p(y_l | x) - each_l) - 1 at points (J, s).

    A law that moves a small share h of its mass to x gains N h D(x) in log-likelihood (Lindsay,
    1983). `each` (N,) are the log-densities under the law; -inf of one counts as the largest.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        ratio = log_density(points) - each[:, None]
    return np.asarray(
        np.exp(np.minimum(np.nan_to_num(ratio, nan=-np.inf), settings.largest)).mean(axis=0) - 1.0
    )


def npmle(
    log_density: LogDensity, points: Array, fresh: Array, settings: NPMLESettings = NPMLE_SETTINGS
) -> NPMLE:
    """The law of largest likelihood on the unit cube, from points (J, s) that cover it.

    Weights are solved on few points (see `mixed`); the local maxima of the gradient function,
    uphill from the highest of all points, join them until none is above zero. Then it is sought
    anew from the `fresh` points, and the rest told as `gap`.
    """
    law = _of(mixed(log_density(points), settings=settings), points)
    for _ in range(settings.rounds):
        higher, height = _higher(log_density, law, points, settings.starts, settings)
        if bound(height, len(law.each)) < settings.enough:
            higher, height = _higher(log_density, law, fresh, settings.last, settings)
        gap = bound(height, len(law.each))
        if gap < settings.enough:
            break
        joined = np.concatenate([law.points, higher[height > 0.0], _between(law, settings)])
        law = _of(mixed(log_density(joined), settings=settings), joined)
    return _merged(log_density, replace(law, gap=gap), settings)


def _higher(
    log_density: LogDensity, law: NPMLE, points: Array, starts: int, settings: NPMLESettings
) -> tuple[Array, Array]:
    """Local maxima of the gradient function uphill from its highest points, and its values."""

    def function(z: Array) -> Array:
        return gradient(log_density, law.each, z, settings=settings)

    spacing = 0.5 * len(points) ** (-1.0 / points.shape[1])
    high = points[local_maxima(points, function(points), starts)]
    ends = uphill(function, np.concatenate([law.points, high]), spacing, settings=settings)
    return ends, function(ends)


def _between(law: NPMLE, settings: NPMLESettings) -> Array:
    """Means of points that are near each other, as candidates in their place."""
    near = cKDTree(law.points).query_pairs(settings.near, output_type="ndarray")
    share = law.weights[near] / law.weights[near].sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("pk,pks->ps", share, law.points[near]))


def _merged(log_density: LogDensity, law: NPMLE, settings: NPMLESettings) -> NPMLE:
    """The law with nearly equal points merged, where that costs nothing.

    What it costs is added to the gap.
    """
    pairs = cKDTree(law.points).query_pairs(settings.same, output_type="ndarray")
    count = len(law.points)
    links = sparse.coo_array((np.ones(len(pairs)), pairs.T), (count, count))
    group = sparse.csgraph.connected_components(links, directed=False)[1]
    share = (group == np.arange(group.max() + 1)[:, None]) * law.weights
    points = share @ law.points / share.sum(axis=1, keepdims=True)
    fewer = _of(mixed(log_density(points), settings=settings), points)
    lost = law.log_likelihood - fewer.log_likelihood
    return replace(fewer, gap=law.gap + max(lost, 0.0)) if lost < settings.alike else law


def _of(found: Mixing, points: Array) -> NPMLE:
    at = found.support
    return NPMLE(points[at], found.weights[at], found.each, np.inf)


Points = Callable[[Fit, np.random.Generator], Array]
"""The points x (J, n) that the best law of a fit is sought on."""


@dataclass(frozen=True)
class GapTest:
    """The share of data sets drawn from the law itself that have as large a gap.

    `failed` replicates have no log-likelihood and count as larger.
    """

    p_value: float
    replicates: int
    exceeded: int
    failed: int


def gap(fit: Fit, points: Array, settings: NPMLESettings = NPMLE_SETTINGS) -> float:
    """Log-likelihood of the best law on points x (J, n) above that of the fit."""
    best = mixed(
        fit.likelihood.log_density_at(points), settings.coarse, settings=settings
    ).log_likelihood
    return best - fit.scored().likelihood


def gap_test(
    fit: Fit,
    points: Points,
    most: int,
    seed: int,
    progress: Progress,
    settings: NPMLESettings = NPMLE_SETTINGS,
) -> GapTest | None:
    """The p value of the gap, by data sets drawn from the fitted law and fitted again.

    The best law has no limit distribution to compare with, so that the gap is drawn (McLachlan,
    1987). It is that on points made by one rule for measured and for drawn data. It stops early:
    after ten larger gaps p is ten over the replicates until then (Besag and Clifford, 1991), else
    (g + 1)/(most + 1). None where the measured data have no gap. Cost: a climb and a product of
    matrices for each replicate.
    """
    seen = gap(fit, points(fit, np.random.default_rng([seed, 0])), settings=settings)
    if not np.isfinite(seen):
        return None
    exceeded = failed = count = 0
    while count < most and exceeded < settings.exceeded:
        count += 1
        progress.update(f"{count} of at most {most} data sets of the law", count, most)
        larger = _larger(fit, seen, points, np.random.default_rng([seed, count]), settings)
        failed += larger is None
        exceeded += larger is not False
    p_value = exceeded / count if exceeded >= settings.exceeded else (exceeded + 1) / (count + 1)
    return GapTest(p_value, count, exceeded, failed)


def _larger(
    fit: Fit, seen: float, points: Points, rng: np.random.Generator, settings: NPMLESettings
) -> bool | None:
    """Whether the gap of a drawn data set is as large; None where it is no number.

    One step comes near the maximum from below, so that a gap that is smaller after it stays
    smaller.
    """
    near = stepped(fit.drawn(rng))
    found = gap(near, points(near, rng), settings=settings)
    if found >= seen:
        end = climbed(near, arrived=settings.climbed)
        found = gap(end, points(end, rng), settings=settings)
    return bool(found >= seen) if np.isfinite(found) else None
