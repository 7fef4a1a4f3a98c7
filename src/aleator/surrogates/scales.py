"""The scale on which an outcome is a polynomial: its own, or that of its logarithm."""

from __future__ import annotations

import numpy as np

from aleator.types import Array, Flags

LARGEST = 345.0
"""Size of a logarithm beyond which squares of outcomes are no numbers."""


def outcomes(t: Array, logarithmic: Flags) -> Array:
    """Outcomes (A, ...) of polynomials t (A, ...), some of them (A,) of the logarithm.

    >>> outcomes(np.array([0.0, 0.0]), np.array([False, True]))
    array([0., 1.])
    """
    if not logarithmic.any():
        return t
    out = np.array(t)
    out[logarithmic] = np.exp(np.clip(t[logarithmic], -LARGEST, LARGEST))
    return out


def chained(slope: Array, y: Array, logarithmic: Flags) -> None:
    """Make slopes (A, n, J) of polynomials, in place, those of the outcomes y (A, J)."""
    slope[logarithmic] *= y[logarithmic][:, None]


def widened(y: Array, by: Array, logarithmic: Flags) -> Array:
    """Ends y (A,) of ranges, moved on the scale of the polynomials."""
    moved = y + by
    moved[logarithmic] = outcomes(by, logarithmic)[logarithmic] * y[logarithmic]
    return moved
