"""The conditions of experiments as further inputs of a surface."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.types import Array

# A condition that is positive, and larger at one end by this factor than at the other, is taken as
# its logarithm.
DECADE = 10.0
# Texts of one condition that are told apart; with more there is nothing to learn from.
TEXTS = 6


def features(columns: Mapping[str, NDArray[Any]]) -> Array | None:
    """Return conditions (N,) by name as inputs (N, d) in [-1, 1], or None where they cannot be.

    Numbers are scaled to their range, or their logarithms are. A text is one input for each of its
    values, 1 where it has it and -1 elsewhere: how far apart texts are is for the data to say.
    Columns that do not vary are left out. None where a column is neither numbers nor text of at
    most 6 values, a number is not finite, or none varies.

    >>> features({"speed": np.array([1.0, 2.0, 3.0]), "oil": np.array(["a", "b", "a"], object)})
    array([[-1.,  1., -1.], [ 0., -1.,  1.], [ 1.,  1., -1.]])
    """
    parts: list[Array] = []
    for column in columns.values():
        if column.dtype == object:
            kinds = sorted({str(cell) for cell in column})
            if len(kinds) > TEXTS:
                return None
            texts = column.astype(str)
            parts += [np.where(texts == kind, 1.0, -1.0) for kind in kinds if len(kinds) > 1]
        else:
            numbers = column.astype(np.float64)
            if not np.isfinite(numbers).all():
                return None
            parts += [_scaled(numbers)] if np.ptp(numbers) > 0.0 else []
    return np.column_stack(parts) if parts else None


def _scaled(numbers: Array) -> Array:
    if numbers.min() > 0.0 and numbers.max() > DECADE * numbers.min():
        numbers = np.log(numbers)
    low, high = numbers.min(), numbers.max()
    return np.asarray((2.0 * numbers - low - high) / (high - low))
