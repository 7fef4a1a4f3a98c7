"""The nonparametric maximum likelihood estimate (NPMLE): the best of all laws of the parameters.

Over all probability laws G on a region it maximizes sum_l log int p(y_l | x) dG(x) (Kiefer and
Wolfowitz, 1956). The maximum is a law of at most N points. For given points the weights solve a
concave problem, whose gradient proves the maximum (`mixed`). New points are the local maxima of the
gradient function (`npmle`). Whether the likelihood of a parametric law is lower by more than chance
is tested by parametric bootstrap (`gap_test`).
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
    """Settings of the best law's weights and points, and of the test of its gap, by judgement."""

    weighed: float = 1e-7
    """Value of the gradient function D up to which the weights count as optimal."""
    steps: int = 200
    """Largest number of Newton steps to the weights."""
    covered: float = 0.05
    """Share of its largest likelihood that each experiment has at one of the first points or more.
    """
    entering: int = 8
    """Largest number of points that enter the law in one Newton step."""
    shortest: float = 1e-4
    """Shortest fraction of a Newton step that is tried when the step is halved."""
    rise: float = 1e-4
    """Least rise of the log-likelihood over a step, relative to what the gradient predicts."""
    crosses: int = 40
    """Largest number of rounds of an ascent of the gradient function D."""
    finest: float = 1e-6
    """Distance of neighbouring points at which an ascent of D ends, relative to the region's width.
    """
    narrower: float = 0.25
    """Factor by which the distance of neighbouring points is reduced where none is higher."""
    flat: float = 1e-3
    """Least curvature along an axis in a Newton step on D, relative to the largest of all axes."""
    flattest: float = 1e-6
    """Least curvature along an axis in a Newton step on D, relative to the slope."""
    farthest: float = 8.0
    """Largest length of a Newton step on D, in units of the distance of neighbouring points."""
    starts: int = 12
    """Number of local maxima of the gradient function D that are sought in each round."""
    last: int = 40
    """Number of local maxima of the gradient function D that are sought in the last round."""
    rounds: int = 40
    """Largest number of rounds in which points are added to the law."""
    enough: float = 1e-4
    """Possible gain in log-likelihood from further points at which the search ends."""
    near: float = 0.05
    """Distance below which two points are tried as one point at their mean."""
    same: float = 0.01
    """Distance below which two points are merged at the end."""
    alike: float = 1e-3
    """Largest loss of log-likelihood for which points are merged."""
    largest: float = 700.0
    """Largest exponent of a ratio of densities; a larger one is cut."""
    climbed: float = 0.01
    """Remaining rise in log-likelihood at which the maximum for a replicate counts as reached."""
    coarse: float = 1e-5
    """Value of the gradient function D up to which the weights for a replicate count as optimal."""
    exceeded: int = 10
    """Number of replicates with a larger gap after which no more are drawn."""


NPMLE_SETTINGS = NPMLESettings()


@dataclass(frozen=True, eq=False)
class Mixing:
    """Weights (J,) of the points of a law, and log-density log f_l (N,) of each experiment.

    `gradient` (J,) is D_j = mean_l L_lj / f_l - 1, where L_lj is the likelihood of experiment l at
    point j. No other weights of these points have a log-likelihood that is larger by more than
    `gap` = N log(1 + max D).
    """

    weights: Array
    each: Array
    gradient: Array

    @property
    def log_likelihood(self) -> float:
        """The log-likelihood of the law, sum_l log f_l."""
        return float(self.each.sum())

    @property
    def gap(self) -> float:
        """The most that other weights of the same points could add to the log-likelihood."""
        return bound(self.gradient, self.each.size)

    @property
    def support(self) -> Indices:
        """The indices of the points with a positive weight."""
        return np.flatnonzero(self.weights)


def bound(gradient: Array, experiments: int) -> float:
    """The bound N log(1 + max D) of a law's gain from these points (Jensen's inequality)."""
    return experiments * float(np.log1p(max(gradient.max(initial=0.0), 0.0)))


@single_threaded
def mixed(
    log_density: Array,
    enough: float = NPMLE_SETTINGS.weighed,
    settings: NPMLESettings = NPMLE_SETTINGS,
) -> Mixing:
    """The weights w that maximize sum_l log sum_j w_j exp(log_density[l, j]), log_density (N, J).

    Kiefer and Wolfowitz (1956) proved that the estimate is consistent. D <= 0 at all points marks
    the maximum (Lindsay, 1983). The weights are computed by Newton steps. The quadratic problem of
    each, with nonnegative weights that sum to one, is a nonnegative least-squares problem on the
    points that have weight and those of largest D (Wang, 2007). NaN counts as -inf. An experiment
    with zero likelihood at all points keeps a log-density of -inf and does not influence the
    weights. Cost: about twenty products with the matrix.

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
    """Weights by Newton steps, starting from points that give every experiment a likelihood."""
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
    """The weights that minimize |ratio w - 2|^2, nonnegative with the sum one.

    This is the quadratic approximation of the log-likelihood. Since sum w = 1, it equals |P w|^2
    with P = ratio - 2. The constraint is met by minimizing |P w|^2 + (sum w - 1)^2 over nonnegative
    w and scaling the result (Dax, 1990).
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
    """The weights on the way to `moved` where the log-likelihood rises; None if there are none."""
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
    """Local maxima (P, s) of a function on the unit cube, by ascents from `starts` (P, s).

    In each round the function is evaluated on a cross of points around every point, and at the top
    of the parabola through the cross. The best point is taken; where none is better, the cross is
    made a quarter as wide. `function` gives values (Q,) at points (Q, s). Cost: about 20 rounds of
    P (2 s^2 + 2) values.
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
    """The indices of the points (J, s) that are higher than their neighbours, the highest first."""
    s = points.shape[1]
    nearest = (
        cKDTree(points).query(points, min(1 + 2 * s * s, len(points)))[1].reshape(len(points), -1)
    )
    found = np.flatnonzero(value >= value[nearest].max(axis=1))
    return found[np.argsort(-value[found], kind="stable")][:most]


def _cross(s: int) -> Array:
    """Steps (2 s^2, s) along each axis, and along both diagonals of each pair of axes."""
    axes = np.eye(s)
    steps = [sign * axis for axis in axes for sign in (1.0, -1.0)]
    for i, j in combinations(range(s), 2):
        steps += [a * axes[i] + b * axes[j] for a in (1.0, -1.0) for b in (1.0, -1.0)]
    return np.array(steps)


def _top(
    points: Array, width: Array, value: Array, around: Array, settings: NPMLESettings
) -> Array:
    """The top of the parabola through each cross; where there is none, a step up the slope."""
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
    # A step that is much too long is cut later anyway.
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

    `each` (N,) is the log-density of each experiment. `gap` bounds how much larger the
    log-likelihood of any law can be, as far as the gradient function was searched.
    """

    points: Array
    weights: Array
    each: Array
    gap: float

    @property
    def log_likelihood(self) -> float:
        """The log-likelihood of the law, the sum over experiments."""
        return float(self.each.sum())


def gradient(
    log_density: LogDensity, each: Array, points: Array, settings: NPMLESettings = NPMLE_SETTINGS
) -> Array:
    """The gradient function D(x) = mean_l exp(log p(y_l | x) - each_l) - 1 at points (J, s).

    A law that moves a small share h of its mass to x gains N h D(x) in log-likelihood (Lindsay,
    1983). `each` (N,) are the log-densities under the law; where one is -inf, its ratio is the
    largest number that is allowed.
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

    Weights are computed for a small number of points (see `mixed`). Local maxima of the gradient
    function, reached from the highest of all points, are added until none is above zero. The search
    is then repeated from the `fresh` points, and the gain that is still possible is reported as
    `gap`.
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
    """Local maxima of the gradient function uphill from its highest points, and their values."""

    def function(z: Array) -> Array:
        return gradient(log_density, law.each, z, settings=settings)

    spacing = 0.5 * len(points) ** (-1.0 / points.shape[1])
    high = points[local_maxima(points, function(points), starts)]
    ends = uphill(function, np.concatenate([law.points, high]), spacing, settings=settings)
    return ends, function(ends)


def _between(law: NPMLE, settings: NPMLESettings) -> Array:
    """Weighted means of points close to each other, as candidates to replace them."""
    near = cKDTree(law.points).query_pairs(settings.near, output_type="ndarray")
    share = law.weights[near] / law.weights[near].sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("pk,pks->ps", share, law.points[near]))


def _merged(log_density: LogDensity, law: NPMLE, settings: NPMLESettings) -> NPMLE:
    """The law with nearly equal points merged, where this hardly changes the log-likelihood.

    The loss is added to the gap.
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
"""A function that gives the points x (J, n) on which the best law of a fit is computed."""


@dataclass(frozen=True)
class GapTest:
    """The share of data sets drawn from the fitted law with a gap as large as the measured one.

    `failed` replicates have no log-likelihood and count as larger.
    """

    p_value: float
    replicates: int
    exceeded: int
    failed: int


def gap(fit: Fit, points: Array, settings: NPMLESettings = NPMLE_SETTINGS) -> float:
    """The gap: log-likelihood of the best law on points x (J, n) minus that of the fit."""
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

    The gap has no known limit law, so that its law is simulated (McLachlan, 1987). The points for
    the best law are made by the same rule for measured and drawn data. After ten larger gaps the
    test stops, with p equal to ten over the number of replicates (Besag and Clifford, 1991);
    otherwise p is (g + 1)/(most + 1) with g larger gaps. None where the gap of the measured data is
    not finite. Cost: a refit and a product of matrices for each replicate.
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
    """Whether the gap of a drawn data set is as large as `seen`; None where it is not finite.

    Before a full refit one Newton step is made. Its likelihood is below the maximum, so that its
    gap is too large; if even this gap is smaller than `seen`, no refit is needed.
    """
    near = stepped(fit.drawn(rng))
    found = gap(near, points(near, rng), settings=settings)
    if found >= seen:
        end = climbed(near, arrived=settings.climbed)
        found = gap(end, points(end, rng), settings=settings)
    return bool(found >= seen) if np.isfinite(found) else None
