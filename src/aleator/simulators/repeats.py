"""Some of the runs that are made anyway are made again: nothing rests on a simulator that draws."""

from __future__ import annotations

import math

import numpy as np

from aleator.types import Array, Indices

REPEATABLE = 1e-6
"""Relative difference of two outcomes of the same run that is no cause for concern."""
MOST = 24
"""Runs that are made again: of those of which one in ten is random, one is found in 99 of 100."""


class Repeats:
    """Which runs are made again, once that has begun: of R that were made the root of R, up to 24.

    >>> repeats = Repeats()
    >>> repeats.begin()
    >>> [repeats.chosen(new).tolist() for new in (1, 3, 5, 100_000)]
    [[0], [0], [0], [0, 4999, 9999, 14999, 19999, 24999, 29999, 34999, ...]]
    """

    def __init__(self) -> None:
        self._begun = False
        self._made = self._again = 0

    def begin(self) -> None:
        """Choose from now on."""
        self._begun = True

    def chosen(self, new: int) -> Indices:
        """Positions among so many runs that were just made, far apart: conditions may matter."""
        if not self._begun:
            return np.empty(0, np.intp)
        self._made += new
        due = min(MOST, math.isqrt(self._made)) - self._again
        if due <= 0:
            return np.empty(0, np.intp)
        chosen = np.unique(np.linspace(0, new - 1, min(due, new)).astype(np.intp))
        self._again += len(chosen)
        return chosen


def differing(first: Array, again: Array) -> tuple[int, int] | None:
    """The first run and value in which (R, W) outcomes differ from those of the same runs again.

    Beyond a millionth of the value, or of what values are like. A run that has none in one of the
    two has failed: that is another matter.

    >>> differing(np.array([[1.0], [2.0]]), np.array([[1.0], [2.1]]))
    (1, 0)
    """
    size = np.abs(first[np.isfinite(first)])
    usual = REPEATABLE * float(np.median(size)) if size.size else 0.0
    same = np.isclose(first, again, rtol=REPEATABLE, atol=usual, equal_nan=True)
    same |= np.all(np.isnan(first), axis=1, keepdims=True)
    same |= np.all(np.isnan(again), axis=1, keepdims=True)
    found = np.argwhere(~same)
    return (int(found[0, 0]), int(found[0, 1])) if len(found) else None
