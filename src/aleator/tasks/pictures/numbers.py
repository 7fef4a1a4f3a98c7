"""Numbers of pictures as a document holds them: few digits, for no eye sees more."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

DIGITS = 5


def drawn(values: ArrayLike) -> Any:
    """Numbers of any shape as nested lists with five significant digits; None where there is none.

    >>> drawn([1.23456789, float("inf"), 0.0])
    [1.2346, None, 0.0]
    """
    array = np.asarray(values, dtype=np.float64)
    return _shortest(array.tolist())


def _shortest(values: Any) -> Any:
    if isinstance(values, list):
        return [_shortest(value) for value in values]
    return float(f"{values:.{DIGITS}g}") if np.isfinite(values) else None
