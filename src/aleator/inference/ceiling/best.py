"""The best of all laws on a region: weights of points, and the points themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from aleator.inference.ceiling.climbing import climbed, local_maxima
from aleator.inference.ceiling.mixing import Mixing, bound, mixed
from aleator.types import Array

LogDensity = Callable[[Array], Array]
"""log p(observations of each experiment | point) (N, J) at points (J, s) of the unit cube."""
STARTS, LAST = 12, 40
"""Local maxima of the gradient function that are climbed in a round, and in the end."""
ROUNDS = 40
ENOUGH = 1e-4
"""Of the log-likelihood, what other points may still add."""
NEAR = 0.05
"""Distance of points that may be one."""
SAME, ALIKE = 0.01, 1e-3
"""Distance of points that are taken for one, and what that may cost of the log-likelihood."""
LARGEST = 700.0
"""Exponent of the largest ratio that is told."""


@dataclass(frozen=True, eq=False)
class BestLaw:
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


def gradient(log_density: LogDensity, each: Array, points: Array) -> Array:
    """D(x) = mean_l exp(log p(y_l | x) - each_l) - 1 at points (J, s): where mass is lacking.

    A law that moves a small share h of its mass to x gains N h D(x) in log-likelihood (Lindsay,
    1983). `each` (N,) are the log-densities under the law; -inf of one counts as the largest.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        ratio = log_density(points) - each[:, None]
    return np.asarray(
        np.exp(np.minimum(np.nan_to_num(ratio, nan=-np.inf), LARGEST)).mean(axis=0) - 1.0
    )


def best_law(log_density: LogDensity, points: Array, fresh: Array) -> BestLaw:
    """The law of largest likelihood on the unit cube, from points (J, s) that cover it.

    Weights are solved on few points (see `mixed`); the local maxima of the gradient function,
    climbed from the highest of all points, join them until none is above zero. Then it is sought
    anew from the `fresh` points, and the rest told as `gap`.
    """
    law = _of(mixed(log_density(points)), points)
    for _ in range(ROUNDS):
        higher, height = _higher(log_density, law, points, STARTS)
        if bound(height, len(law.each)) < ENOUGH:
            higher, height = _higher(log_density, law, fresh, LAST)
        gap = bound(height, len(law.each))
        if gap < ENOUGH:
            break
        joined = np.concatenate([law.points, higher[height > 0.0], _between(law)])
        law = _of(mixed(log_density(joined)), joined)
    return _merged(log_density, replace(law, gap=gap))


def _higher(
    log_density: LogDensity, law: BestLaw, points: Array, starts: int
) -> tuple[Array, Array]:
    """Local maxima of the gradient function uphill from its highest points, and its values."""

    def function(z: Array) -> Array:
        return gradient(log_density, law.each, z)

    spacing = 0.5 * len(points) ** (-1.0 / points.shape[1])
    high = points[local_maxima(points, function(points), starts)]
    ends = climbed(function, np.concatenate([law.points, high]), spacing)
    return ends, function(ends)


def _between(law: BestLaw) -> Array:
    """The middles of points that are near each other, which the law may have in their place."""
    near = cKDTree(law.points).query_pairs(NEAR, output_type="ndarray")
    share = law.weights[near] / law.weights[near].sum(axis=1, keepdims=True)
    return np.asarray(np.einsum("pk,pks->ps", share, law.points[near]))


def _merged(log_density: LogDensity, law: BestLaw) -> BestLaw:
    """The law with one point in place of those that are all but one, where that loses nothing.

    What it loses is added to the gap.
    """
    pairs = cKDTree(law.points).query_pairs(SAME, output_type="ndarray")
    count = len(law.points)
    links = sparse.coo_array((np.ones(len(pairs)), pairs.T), (count, count))
    group = sparse.csgraph.connected_components(links, directed=False)[1]
    share = (group == np.arange(group.max() + 1)[:, None]) * law.weights
    points = share @ law.points / share.sum(axis=1, keepdims=True)
    fewer = _of(mixed(log_density(points)), points)
    lost = law.log_likelihood - fewer.log_likelihood
    return replace(fewer, gap=law.gap + max(lost, 0.0)) if lost < ALIKE else law


def _of(found: Mixing, points: Array) -> BestLaw:
    at = found.support
    return BestLaw(points[at], found.weights[at], found.each, np.inf)
