"""Numbers of pictures as a document holds them: few digits, for no eye sees more."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

DIGITS = 5
PLACES = 10
"""Digits of where something is: an interval may be narrow beside its place."""


def drawn(values: ArrayLike, digits: int = DIGITS) -> Any:
    """Numbers of any shape as nested lists with so many significant digits; None for none.

    >>> drawn([1.23456789, float("inf"), 0.0]), drawn([1000000.25], PLACES)
    ([1.2346, None, 0.0], [1000000.25])
    """
    return _shortest(np.asarray(values, dtype=np.float64).tolist(), digits)


def _shortest(values: Any, digits: int) -> Any:
    if isinstance(values, list):
        return [_shortest(value, digits) for value in values]
    return float(f"{values:.{digits}g}") if np.isfinite(values) else None
