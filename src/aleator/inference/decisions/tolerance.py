"""Limits that hold a share of a distribution with some confidence."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from aleator.inference.decisions.weighted import quantiles
from aleator.types import Array


def quantile_bound(
    y: Array, weights: Array, draws: Array, probability: float, confidence: float
) -> tuple[float, Array]:
    """The value that quantiles of draws are below with this confidence, and the quantiles (A,).

    `y` (A, J) are outcomes with `weights` (A, J) under A laws, whose own weights are `draws` (A,).
    """
    each = quantiles(y, weights, np.array([probability]))[:, 0]
    return float(quantiles(each, draws, np.array([confidence]))[0]), each


def content_interval(
    y: Array, weights: Array, draws: Array, content: float, confidence: float
) -> tuple[float, float]:
    """The interval that holds the share `content` of a law with this confidence.

    Its ends are quantiles t and 1 - t of the mixture of all laws, with the largest t such that laws
    of a total weight of `confidence` have at least that content between them: a content
    tolerance interval (Wilks, 1941; Hamada et al., 2004). NaN where the points end before.
    Outcomes that are NaN do not count.
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

    least, most = 1e-6, 0.5 * (1.0 - content)
    if excess(least) < 0.0:
        return float("nan"), float("nan")
    t = most if excess(most) >= 0.0 else float(optimize.brentq(excess, least, most, xtol=1e-6))
    low, high = ends(t)
    return float(low), float(high)
