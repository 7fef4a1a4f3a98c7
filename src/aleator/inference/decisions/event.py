"""What is asked of an outcome: to lie in one of some intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.types import Array, Flags


@dataclass(frozen=True)
class Event:
    """An outcome in one of the intervals `parts`, which do not overlap.

    >>> Event(((1.0, np.inf),)).holds(np.array([0.5, 2.0])).tolist()
    [False, True]
    >>> Event(((1.0, 2.0),)).contrary.parts
    ((-inf, 1.0), (2.0, inf))
    """

    parts: tuple[tuple[float, float], ...]

    @property
    def contrary(self) -> Event:
        """Everything else."""
        ends = [-np.inf, *(end for part in self.parts for end in part), np.inf]
        pairs = zip(ends[::2], ends[1::2], strict=True)
        return Event(tuple((low, high) for low, high in pairs if low < high))

    def holds(self, y: Array) -> Flags:
        """Whether outcomes y are in it; what is NaN is not."""
        found = np.zeros(y.shape, dtype=np.bool_)
        for low, high in self.parts:
            found |= (y > low) & (y < high)
        return found

    def distance(self, y: Array) -> Array:
        """How far outcomes y are from the nearest end of an interval."""
        ends = [end for part in self.parts for end in part if np.isfinite(end)]
        return np.asarray(np.min([np.abs(y - end) for end in ends], axis=0))

    def missed(self, y: Array) -> Array:
        """By how much outcomes y miss it: zero within, infinite where there is no outcome."""
        away = [np.maximum(low - y, y - high) for low, high in self.parts]
        outside = np.maximum(np.min(away, axis=0), np.finfo(float).tiny)
        return np.where(self.holds(y), 0.0, np.nan_to_num(outside, nan=np.inf, posinf=np.inf))
