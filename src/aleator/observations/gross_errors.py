"""Measured values that look like a slip of the pen: a wrong sign, or a misplaced decimal point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array


@dataclass(frozen=True)
class GrossErrorSettings:
    """Settings of the search for gross errors; chosen by judgement, and only notes follow.

    share: the largest share of values that are questioned. If there are more, the outcome itself
    has both signs, or spans decades. range: the ratio of the ends of a range about the median, in
    which all other values lie; a value times or over ten then leaves it, or nearly.
    """

    share: float = 0.1
    range: float = 10.0


GROSS_ERRORS = GrossErrorSettings()


def gross_errors(values: Array, settings: GrossErrorSettings = GROSS_ERRORS) -> dict[int, float]:
    """The indices of values (M,) that look like gross errors, each with the value that would fit.

    All but a tenth of the values lie within a decade about their median. The others are questioned
    if they lie among these with the other sign, or with the decimal point moved by one place. NaN
    is a value that is not known.

    >>> gross_errors(np.array([3.2, 4.4, 4.5, 5.1, 8.0, 7.9, 3.1, 3.6, 4.1, 4.2, -4.4]))
    {10: 4.4}
    >>> gross_errors(np.array([3.2, 44.0, 4.5, 5.1, 8.0, 7.9, 3.1, 3.6, 4.1, 4.2]))
    {1: 4.4}
    >>> gross_errors(np.array([0.1, 1.0, 10.0, 100.0])), gross_errors(np.array([-1.0, 1.0]))
    ({}, {})
    """
    known = values[np.isfinite(values)]
    median = float(np.median(known)) if known.size else 0.0
    if not median > 0.0:
        return {}
    half = settings.range**0.5
    with np.errstate(invalid="ignore"):
        usual = (values >= median / half) & (values <= median * half)
    odd = np.flatnonzero(np.isfinite(values) & ~usual)
    if odd.size > settings.share * known.size:
        return {}
    low, high = float(values[usual].min()), float(values[usual].max())
    found = {}
    for k in odd.tolist():
        right = [moved for moved in (-values[k], values[k] / 10.0, 10.0 * values[k])
                 if low <= moved <= high]  # fmt: skip
        if right:
            found[k] = float(f"{right[0]:.12g}")
    return found
