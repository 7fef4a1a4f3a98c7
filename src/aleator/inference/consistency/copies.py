"""Columns that the outcome determines: in another unit, rounded, as a rank, or as a bound."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from aleator.inference.consistency.columns import ORDER, Column
from aleator.observations.responses import Observations
from aleator.types import Array

DISTINCT = 7
"""Distinct values at least, of the column and of the outcome: fewer may be in one order by chance.

Of seven independent values two orders in 5040 are that of the outcome, or its reverse.
"""
COARSE = 0.5
"""Distinct values that a copy has at least, for each of the outcome: rounding leaves so many."""


def copies_of(
    columns: Sequence[Column], seen: Observations, asked: Collection[str]
) -> tuple[Column, ...]:
    """The columns whose numbers order the measured values of a response as these are themselves.

    Or in reverse. A condition does that only where nothing else scatters; so the columns that the
    simulator or a law has `asked` for are none. Nor are columns conditions that tell no more than
    whether an outcome was measured, or is a bound, and which: a second column of the censoring.
    """
    return tuple(
        column
        for column in columns
        if column.name != ORDER
        and not {column.name, *column.alike} & set(asked)
        and (
            any(_copied(column, seen, k) for k in range(len(seen.responses)))
            or _censoring(column, seen)
        )
    )


def _censoring(column: Column, seen: Observations) -> bool:
    """Whether the bounds alone give the column: one value for what was measured, and each bound."""
    if np.all(seen.measured):
        return False
    ends = np.where(seen.measured[:, None], 0.0, np.stack([seen.lower, seen.upper], axis=1))
    kind = np.unique(np.column_stack([seen.measured, ends]), axis=0, return_inverse=True)[1].ravel()
    pairs = np.unique(np.column_stack([kind, column.group]), axis=0)
    return bool(len(pairs) == kind.max() + 1)


def _copied(column: Column, seen: Observations, response: int) -> bool:
    rows = seen.measured & (seen.response == response) & (column.level >= 0)
    if column.ranks is None or not np.any(rows):
        return False
    y, ranks = seen.lower[rows], column.ranks[rows]
    few, many = sorted((np.unique(y).size, np.unique(ranks).size))
    if few < max(DISTINCT, COARSE * many):
        return False
    return _rising(y, ranks) or _rising(y, -ranks)


def _rising(y: Array, values: Array) -> bool:
    """Whether no pair of values falls where y rises."""
    return bool(np.all(np.diff(values[np.lexsort((values, y))]) >= 0.0))
