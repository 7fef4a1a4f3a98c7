"""Experiments by their names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def chosen(which: NDArray[np.intp], ids: Sequence[str]) -> tuple[str, ...]:
    """The ids of the experiments `which`."""
    return tuple(ids[l] for l in which)


def named(which: NDArray[np.intp], ids: Sequence[str]) -> str:
    """The experiments `which`, by their ids, at most eight.

    >>> named(np.array([0, 2]), ["a", "b", "c"])
    'experiments a, c'
    """
    shown = ", ".join(ids[l] for l in which[:8])
    more = f" and {which.size - 8} more" if which.size > 8 else ""
    return f"experiment{'s' if which.size > 1 else ''} {shown}{more}"
