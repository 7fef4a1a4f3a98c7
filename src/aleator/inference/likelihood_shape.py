"""The shape of the log-likelihood about its maximum: along one hyperparameter, and over two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array, Indices
from aleator.inference.information import Inference
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search.interface import Scored
from aleator.search.newton import ascended, positive


@dataclass(frozen=True)
class ShapeSettings:
    """How far curves and surfaces of the likelihood reach; by judgement."""

    margin: float = 0.3
    """Share of an interval by which a curve goes beyond it, so that its ends are seen to drop."""
    reach: float = 3.75
    """Standard errors to which a surface goes."""
    arrived: float = 0.01
    """Log-likelihood left to climb at a point of a curve: less than the width of its line."""


SHAPE = ShapeSettings()


@dataclass(frozen=True)
class LikelihoodCurve:
    """The profile log-likelihood `value` (P,) where alpha_k is fixed `at` (P,)."""

    k: int
    at: Array
    value: Array


@dataclass(frozen=True)
class LikelihoodGrid:
    """Log-likelihoods `value` (Q, Q) at `first` and `second` (Q, Q) of two hyperparameters.

    Rows and columns of the grid go along the axes of the ellipse of the information. NaN beyond
    the limits.
    """

    pair: tuple[int, int]
    first: Array
    second: Array
    value: Array


def likelihood_curve(
    objective: Scored,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    k: int,
    at: Array,
    settings: ShapeSettings = SHAPE,
) -> LikelihoodCurve:
    """The profile log-likelihood of alpha_k at increasing values `at` (P,) (Wilks, 1938).

    max log L over all other free hyperparameters: from the maximum alpha (K,) outward, each climbed
    to from the one before, moved along the ridge by -I_oo^-1 I_ok. Less than `ARRIVED` is left to
    climb. Cost: two to six evaluations a point.
    """
    way = _Ridge.of(hyperparameters, inference, [k], inference.identified)
    value = np.full(at.size, np.nan)
    outward = [np.flatnonzero(at <= alpha[k])[::-1], np.flatnonzero(at > alpha[k])]
    for side in outward:
        here = alpha
        for p in side:
            here = way.followed(here, np.array([at[p]]))
            end = ascended(
                objective, here, hyperparameters, way.moving, way.curvature, settings.arrived
            )
            here, value[p] = end.alpha, end.value
    return LikelihoodCurve(k, at, np.where(np.isfinite(value), value, np.nan))


def likelihood_surface(
    objective: Scored,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    pair: tuple[int, int],
    count: int,
    settings: ShapeSettings = SHAPE,
) -> LikelihoodGrid:
    """The log-likelihood over two free hyperparameters; the others follow along the ridge.

    On a grid of `count` times `count` points, `REACH` standard errors to either side along the axes
    of the ellipse: a narrow ridge is not missed. Where the limits leave less than half of that, the
    grid is a rectangle within them. The others move by -I_oo^-1 I_op from the maximum
    alpha (K,), within their limits, but for those on a limit, which stay: exact for two
    hyperparameters, near the maximum for more. Cost: an evaluation a point.
    """
    rows = [int(np.flatnonzero(inference.free == k)[0]) for k in pair]
    variance, axes = np.linalg.eigh(inference.covariance[np.ix_(rows, rows)])
    half = axes * np.sqrt(np.maximum(variance, 0.0))
    here = alpha[list(pair)]
    u, v = np.meshgrid(*[np.linspace(-settings.reach, settings.reach, count)] * 2)
    points = here + np.stack([u.ravel(), v.ravel()], axis=1) @ half.T
    lower, upper = limits_of(hyperparameters, np.array(pair))
    inside = np.all((points >= lower) & (points <= upper), axis=1)
    if inside.mean() < 0.5:
        reach = settings.reach * np.sqrt(np.diag(inference.covariance)[rows])
        ends = np.maximum(lower, here - reach), np.minimum(upper, here + reach)
        u, v = np.meshgrid(*np.linspace(*ends, count).T)
        points, inside = np.stack([u.ravel(), v.ravel()], axis=1), np.ones(u.size, dtype=bool)
    way = _Ridge.of(hyperparameters, inference, list(pair), inference.free)
    value = np.full(len(points), np.nan)
    for k in np.flatnonzero(inside):
        value[k] = objective(way.followed(alpha, points[k])).total
    value = np.where(np.isfinite(value), value, np.nan)
    first, second = points.T
    return LikelihoodGrid(
        pair, first.reshape(u.shape), second.reshape(u.shape), value.reshape(u.shape)
    )


def curve_points(
    interval: Sequence[float], estimate: float, h: Hyperparameter, settings: ShapeSettings = SHAPE
) -> Array:
    """Values for a curve: the estimate, its interval, and some room beyond, within limits.

    >>> h = Hyperparameter("x", 0.0, 2.2, 1.0, True)
    >>> curve_points((1.0, 2.0), 1.4, h).round(2).tolist()
    [0.7, 1.0, 1.4, 2.0, 2.2]
    """
    low, high = interval
    reach = settings.margin * (high - low)
    beyond = max(low - reach, h.lower), min(high + reach, h.upper)
    return np.unique([beyond[0], low, estimate, high, beyond[1]])


def weakest_pair(correlation: Array) -> tuple[int, int] | None:
    """The rows of the two estimates of largest correlation; None below two.

    >>> weakest_pair(np.array([[1.0, 0.1, -0.9], [0.1, 1.0, 0.2], [-0.9, 0.2, 1.0]]))
    (0, 2)
    """
    size = len(correlation)
    pairs = [(i, j) for i in range(size) for j in range(i + 1, size)]
    known = [pair for pair in pairs if np.isfinite(correlation[pair])]
    return max(known, key=lambda pair: abs(correlation[pair])) if known else None


@dataclass(frozen=True, eq=False)
class _Ridge:
    """How the `moving` hyperparameters follow the `fixed` ones along the ridge.

    `curvature` (F, F) is the information of the moving ones, `follow` (F, H) their slopes by the
    fixed ones.
    """

    fixed: list[int]
    moving: Indices
    limits: tuple[Array, Array]
    curvature: Array
    follow: Array

    @classmethod
    def of(
        cls,
        hyperparameters: Sequence[Hyperparameter],
        inference: Inference,
        held: list[int],
        among: Indices,
    ) -> _Ridge:
        """The ridge at the maximum, along which those `among` follow that are not fixed."""
        apart = ~np.isin(inference.identified, among) | np.isin(inference.identified, held)
        moving = inference.identified[~apart]
        # in the order in which they are held
        rows = [int(np.flatnonzero(inference.identified == k)[0]) for k in held]
        own = positive(inference.information[np.ix_(~apart, ~apart)])
        coupling = inference.information[:, rows][~apart]
        limits = limits_of(hyperparameters, moving)
        follow = -np.linalg.solve(own, coupling) if moving.size else coupling
        return cls(held, moving, limits, own, np.asarray(follow, float))

    def followed(self, here: Array, values: Array) -> Array:
        """The point reached from `here` (K,) where the fixed ones have these values (H,)."""
        there = here.copy()
        there[self.fixed] = values
        wished = here[self.moving] + self.follow @ (values - here[self.fixed])
        there[self.moving] = np.clip(wished, *self.limits)
        return there
