"""Quantiles and shares of points with weights."""

from __future__ import annotations

import numpy as np

from aleator.types import Array


def quantiles(values: Array, weights: Array, probabilities: Array) -> Array:
    """Quantiles (..., P) of values (..., J) with weights (..., J).

    Each value stands in the middle of its weight; between values by interpolation.
    NaN where there is none; a value that is NaN does not count.

    >>> quantiles(np.array([3.0, 1.0, 2.0]), np.ones(3), np.array([0.5])).tolist()
    [2.0]
    """
    weights = np.broadcast_to(weights, values.shape)
    lead, size = values.shape[:-1], values.shape[-1]
    found = np.full((int(np.prod(lead)), len(probabilities)), np.nan)
    rows = zip(values.reshape(-1, size), weights.reshape(-1, size), strict=True)
    for row, (y, w) in enumerate(rows):
        order = np.argsort(y)
        y, w = y[order], w[order]
        counted = (w > 0.0) & ~np.isnan(y)
        if np.any(counted):
            y, w = y[counted], w[counted]
            reached = np.cumsum(w)
            found[row] = _between(y, (reached - 0.5 * w) / reached[-1], probabilities)
    return found.reshape(*lead, len(probabilities))


def _between(y: Array, reached: Array, probabilities: Array) -> Array:
    """By interpolation; beside an infinite value the next one itself."""
    if np.all(np.isfinite(y)):
        return np.interp(probabilities, reached, y)
    return y[np.clip(np.searchsorted(reached, probabilities), 0, len(y) - 1)]


def moments(values: Array, weights: Array) -> tuple[Array, Array, Array, Array]:
    """Mean, sd, skewness and kurtosis (...) of values (..., J) with weights (..., J).

    Values that are NaN do not count.
    """
    known = ~np.isnan(values)
    with np.errstate(all="ignore"):
        w = np.where(known, weights, 0.0)
        w = w / w.sum(axis=-1, keepdims=True)
        y = np.where(known, values, 0.0)
        mean = np.sum(w * y, axis=-1)
        away = y - np.where(np.isfinite(mean), mean, np.nan)[..., None]
        square = w * away**2
        variance = square.sum(axis=-1)
        third, fourth = (square * away).sum(axis=-1), (square * away**2).sum(axis=-1)
        return mean, np.sqrt(variance), third / variance**1.5, fourth / variance**2
