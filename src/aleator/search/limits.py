"""Limits so wide that a search within them has nothing to go by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.types import Array

WIDE = 1e6
"""Limits farther apart than this many times what is known of the value's size are wide."""
NOTHING = 1e-30
"""A value below this share of the distance between its limits says nothing of its size."""


def wide_limits(hyperparameters: Sequence[Hyperparameter]) -> tuple[str, ...]:
    """Names of the free hyperparameters whose limits span six orders of magnitude or more.

    Measured against the smallest of limits and start that is not zero; where these are all of one
    size, as for -1e9 to 1e9, against 1. A scale is never one: it is seen by its logarithm, and by
    its square near zero.

    >>> far = Hyperparameter("b.value", -1e9, 1e9, 0.0, free=True)
    >>> near = Hyperparameter("v.mean", 1e9, 3e11, 2e11, free=True)
    >>> wide_limits([far, near])
    ('b.value',)
    """
    return tuple(h.name for h in hyperparameters if h.free and not h.log and _spans(h) >= WIDE)


def outsized(width: Array, size: Array) -> NDArray[np.bool_]:
    """Where limits this far apart (F,) are wide for values of this size (F,).

    >>> outsized(np.array([1e9, 1e9, 1e9]), np.array([1.0, 1e8, 0.0])).tolist()
    [True, False, False]
    """
    return (size > NOTHING * width) & (width > WIDE * size)


def _spans(h: Hyperparameter) -> float:
    sizes = [abs(v) for v in (h.lower, h.upper, h.start) if v != 0.0]
    smallest, largest = min(sizes), max(sizes)
    # one size all round says nothing of the value's own size
    unknown = h.lower <= 0.0 <= h.upper and largest <= 2.0 * smallest
    return (h.upper - h.lower) / (min(1.0, smallest) if unknown else smallest)


def nowhere_finite(hyperparameters: Sequence[Hyperparameter], evaluations: int) -> InputsError:
    """The refusal of a search that met no alpha where the log-likelihood is a number."""
    wide = wide_limits(hyperparameters)
    because = f": the limits of {', '.join(wide)} span many orders of magnitude" if wide else ""
    which = ", ".join(wide or [h.name for h in hyperparameters if h.free])
    return InputsError(
        f"search: the log-likelihood is not a finite number at any of the {evaluations} points "
        f"that were tried{because}",
        f"narrow the limits of {which} to values that are physically possible, or give a start",
    )
