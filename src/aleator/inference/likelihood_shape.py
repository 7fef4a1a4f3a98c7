"""The log-likelihood around its maximum: curves for one hyperparameter and surfaces for two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array, Indices
from aleator.inference.information import Inference
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search.interface import Scored, objective_of
from aleator.search.newton import ascended, positive


@dataclass(frozen=True)
class ShapeSettings:
    """Settings of likelihood curves and surfaces. The values are chosen by judgement."""

    margin: float = 0.3
    """Share of the interval's width by which a curve goes beyond each end of the interval."""
    reach: float = 3.75
    """Standard errors on either side of the maximum that a surface covers."""
    arrived: float = 0.01
    """Remaining rise, in log-likelihood, at which the maximum for a point of a curve counts as
    reached.
    """


SHAPE = ShapeSettings()


@dataclass(frozen=True)
class LikelihoodCurve:
    """The profile log-likelihood `value` (P,) with hyperparameter k fixed at `at` (P,)."""

    k: int
    at: Array
    value: Array


@dataclass(frozen=True)
class LikelihoodGrid:
    """Log-likelihoods `value` (Q, Q) at `first` and `second` (Q, Q) of two hyperparameters.

    Rows and columns of the grid follow the axes of the confidence ellipse. Values beyond the limits
    are NaN.
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

    It is max log L over all other free hyperparameters. The points are computed from the maximum
    alpha (K,) outward. The search for each point starts from the last one, moved along the ridge by
    -I_oo^-1 I_ok (I is the information, o the other hyperparameters). Each search ends where less
    than `arrived` of the settings remains to be gained. Cost: two to six evaluations for each
    point.
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

    The grid has `count` times `count` points along the axes of the confidence ellipse, so that a
    narrow ridge is not missed. It covers `reach` standard errors on either side. Where more than
    half of it would lie beyond the limits, the grid is a rectangle within the limits instead. The
    other hyperparameters move by -I_oo^-1 I_op from the maximum alpha (K,), within their limits;
    those on a limit stay there. This is exact for two hyperparameters, and near the maximum for
    more. Cost: one evaluation for each point.
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
    value[inside] = objective_of(objective).values(
        np.array([way.followed(alpha, point) for point in points[inside]])
    )
    value = np.where(np.isfinite(value), value, np.nan)
    first, second = points.T
    return LikelihoodGrid(
        pair, first.reshape(u.shape), second.reshape(u.shape), value.reshape(u.shape)
    )


def curve_points(
    interval: Sequence[float], estimate: float, h: Hyperparameter, settings: ShapeSettings = SHAPE
) -> Array:
    """Values for a curve: the estimate, its interval's ends, and two beyond, within limits.

    >>> h = Hyperparameter("x", 0.0, 2.2, 1.0, True)
    >>> curve_points((1.0, 2.0), 1.4, h).round(2).tolist()
    [0.7, 1.0, 1.4, 2.0, 2.2]
    """
    low, high = interval
    reach = settings.margin * (high - low)
    beyond = max(low - reach, h.lower), min(high + reach, h.upper)
    return np.unique([beyond[0], low, estimate, high, beyond[1]])


def weakest_pair(correlation: Array) -> tuple[int, int] | None:
    """The row and column of the strongest correlation; None with fewer than two estimates.

    >>> weakest_pair(np.array([[1.0, 0.1, -0.9], [0.1, 1.0, 0.2], [-0.9, 0.2, 1.0]]))
    (0, 2)
    """
    size = len(correlation)
    pairs = [(i, j) for i in range(size) for j in range(i + 1, size)]
    known = [pair for pair in pairs if np.isfinite(correlation[pair])]
    return max(known, key=lambda pair: abs(correlation[pair])) if known else None


@dataclass(frozen=True, eq=False)
class _Ridge:
    """How the `moving` hyperparameters follow the `fixed` ones along the ridge of the likelihood.

    `curvature` (F, F) is the information of the moving ones, and `follow` (F, H) the derivatives of
    the moving ones with respect to the fixed ones along the ridge.
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
        """The ridge at the maximum, on which the hyperparameters `among` follow the fixed ones."""
        apart = ~np.isin(inference.identified, among) | np.isin(inference.identified, held)
        moving = inference.identified[~apart]
        # The rows are in the order of the fixed hyperparameters.
        rows = [int(np.flatnonzero(inference.identified == k)[0]) for k in held]
        own = positive(inference.information[np.ix_(~apart, ~apart)])
        coupling = inference.information[:, rows][~apart]
        limits = limits_of(hyperparameters, moving)
        follow = -np.linalg.solve(own, coupling) if moving.size else coupling
        return cls(held, moving, limits, own, np.asarray(follow, float))

    def followed(self, here: Array, values: Array) -> Array:
        """The alpha (K,) on the ridge through `here` with `values` (H,) of the fixed ones."""
        there = here.copy()
        there[self.fixed] = values
        wished = here[self.moving] + self.follow @ (values - here[self.fixed])
        there[self.moving] = np.clip(wished, *self.limits)
        return there
