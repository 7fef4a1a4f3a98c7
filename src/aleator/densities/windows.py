"""One scattering parameter: the few nodes that have a share in a density."""

from __future__ import annotations

import numpy as np

from aleator.densities.linearized import Linearized
from aleator.types import Array, Flags

NEAR = 12.0
"""Standard deviations of a node's component within which an outcome is near it."""
WIDEST = 96
"""Nodes between the first and the last near one up to which they are a window."""
ROUNDING = 37.0
"""Logarithm by which what the other nodes could add must lie below the density."""

_LOG_SQRT_2PI = 0.5 * np.log(2.0 * np.pi)


def windowed(outcome: Array, around: Linearized) -> tuple[Flags, Array, Array]:
    """Log-densities (N,) at outcomes (N,) of nodes on one line, with their partials (N, J) by y.

    The first value (N,) tells where they are known: where the nodes near the outcome are few, lie
    together and not at the border, and all others together change no digit. Zero elsewhere. Cost: a
    third of a sum over all nodes.
    """
    count, nodes = around.y.shape
    inverse = np.sqrt(around.variance)
    np.divide(1.0, inverse, out=inverse)
    z = outcome[:, None] - around.mean
    z *= inverse
    near = (np.abs(z) < NEAR) & ~around.points
    first, after = near.argmax(axis=1), nodes - near[:, ::-1].argmax(axis=1)
    inside = (first > 0) & (after < nodes) & (after - first <= min(WIDEST, nodes - 2))
    inside &= near[np.arange(count), first]  # of no node at all the first is none
    value, d_y = np.zeros(count), np.zeros(around.y.shape)
    rows = np.flatnonzero(inside)
    if rows.size:
        size = int((after - first)[rows].max())
        start = np.minimum(first[rows], nodes - 1 - size)
        at = rows[:, None], start[:, None] + np.arange(size)
        log_core = np.where(around.points[at], -np.inf, around.log_core_all[at[1]])
        found, share = shares(np.log(inverse[at]) - 0.5 * z[at] ** 2 + log_core)
        most = np.log(inverse[rows] @ np.exp(around.log_core_all)) - 0.5 * NEAR**2
        sure = found > most + ROUNDING
        inside[rows[~sure]] = False
        value[rows] = np.where(sure, found - _LOG_SQRT_2PI, 0.0)
        share *= sure[:, None]
        by_mean = share * z[at] * inverse[at]
        by_variance = 0.5 * share * (z[at] ** 2 - 1.0) * inverse[at] ** 2
        wide = rows[:, None], start[:, None] + np.arange(-1, size + 1)
        d_y[wide] = _transposed(
            around, by_mean, by_variance, around.slopes[0][at], around.bends[0][at]
        )
    return inside, value, d_y


def _transposed(
    around: Linearized, by_mean: Array, by_variance: Array, slope: Array, bend: Array
) -> Array:
    """By y at the nodes of a window and their neighbors (N, W + 2), by the partials (N, W)."""
    step, square = around.lattice.step, around.lattice.width**2
    by_bend = square * (0.5 * by_mean + square * by_variance * bend) / step**2
    by_slope = square * by_variance * slope / step
    total = np.zeros((by_mean.shape[0], by_mean.shape[1] + 2))
    total[:, 1:-1] = by_mean - 2.0 * by_bend
    total[:, :-2] += by_bend - by_slope
    total[:, 2:] += by_bend + by_slope
    return total


def shares(exponent: Array) -> tuple[Array, Array]:
    """Logarithm (N,) of the sum of exp(exponent) (N, J), and the share of each in it."""
    top = exponent.max(axis=1, keepdims=True)
    share = np.exp(exponent - top)
    total = share.sum(axis=1, keepdims=True)
    return (top + np.log(total))[:, 0], share / total
