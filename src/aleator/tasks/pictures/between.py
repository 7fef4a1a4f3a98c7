"""The likelihood between the points at which it was evaluated, to be drawn."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator, RectBivariateSpline, RegularGridInterpolator

from aleator.types import Array

CURVE = 80
"""Points of the line of a profile."""
STEPS = 5
"""Steps between two points of a surface."""


def profile_line(at: Array, below: Array) -> tuple[Array, Array]:
    """A line through the points of a profile: its signed root is nearly straight.

    `below` is how far the log-likelihood is below its maximum at the values `at`, in ascending
    order; the line's ordinate is minus that.

    >>> x, y = profile_line(np.array([-3.0, 0.0, 2.0]), np.array([4.5, 0.0, 2.0]))
    >>> bool(np.allclose(y, -0.5 * x**2))
    True
    """
    known = np.isfinite(below) & (np.diff(at, prepend=-np.inf) > 0.0)
    at, below = at[known], below[known]
    if at.size < 2:
        return at, -below
    root = np.sign(at - at[np.argmin(below)]) * np.sqrt(2.0 * np.maximum(below, 0.0))
    x = np.union1d(np.linspace(at[0], at[-1], CURVE), at)
    return x, -0.5 * PchipInterpolator(at, root)(x) ** 2


def finer(grid: Array) -> Array:
    """A square grid with steps between its points: smooth, or straight where some are unknown.

    >>> side = np.arange(4.0)
    >>> bool(np.allclose(finer(np.add.outer(side, side**2))[::STEPS, 1], side + 1 / STEPS**2))
    True
    """
    at = np.arange(float(len(grid)))
    fine = np.linspace(0.0, at[-1], STEPS * (len(grid) - 1) + 1)
    if np.all(np.isfinite(grid)):
        return np.asarray(RectBivariateSpline(at, at, grid)(fine, fine))
    between = np.meshgrid(fine, fine, indexing="ij")
    return np.asarray(RegularGridInterpolator((at, at), grid)(tuple(between)))
