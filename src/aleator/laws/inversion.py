"""The inverse of a distribution function whose derivative is at hand, for many values at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aleator.types import Array

_PASSES = 100

_ENOUGH = 1e-14
"""A bracket, or a step, under this part of the largest end of the bracket is at rounding."""


def invert(
    cdf: Callable[[Array], Array],
    pdf: Callable[[Array], Array],
    p: Array,
    low: Array,
    high: Array,
    start: Array | None = None,
) -> Array:
    """y (N, P) with cdf(y) = p (N, P), known to lie in [low, high] (N, P); sought from `start`.

    Newton's method kept in a bracket that shrinks at every pass, with a bisection where it would
    leave the bracket. `cdf` and `pdf` take and return (N, P). Cost: six passes for a smooth law,
    up to 50 where the density is a row of spikes.

    >>> from scipy.special import ndtr
    >>> at = np.array([[0.975]])
    >>> normal = lambda y: np.exp(-0.5 * y**2) / np.sqrt(2.0 * np.pi)
    >>> float(invert(ndtr, normal, at, at - 9.0, at + 9.0)[0, 0])
    1.959964
    """
    low, high = low.astype(float), high.astype(float)
    scale = np.maximum(np.abs(low), np.abs(high))
    y = 0.5 * (low + high) if start is None else start
    for _ in range(_PASSES):
        excess = cdf(y) - p
        low, high = np.where(excess <= 0.0, y, low), np.where(excess >= 0.0, y, high)
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            newton = y - excess / pdf(y)
        inside = (newton >= low) & (newton <= high)
        moved = np.where(inside, newton, 0.5 * (low + high))
        arrived = (np.abs(moved - y) <= _ENOUGH * scale) | (high - low <= _ENOUGH * scale)
        y = moved
        if arrived.all():
            break
    return y
