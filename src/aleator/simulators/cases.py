"""The distinct conditions of the units of a table, of those that a simulator asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.types import Indices


@dataclass(frozen=True, eq=False)
class Cases:
    """C cases of U units: units under equal conditions are one case, and share runs.

    A unit is what one run serves: a row of the table, or a whole experiment. `columns` has an array
    (C,) for each condition, whose entries are arrays where one varies in a series; `first` (C,) is
    the first unit of each case, `condition` (U,) the case of each unit.

    >>> cases = Cases.of({"load": np.array([1.0, 2.0, 1.0])}, 3)
    >>> cases.first.tolist(), cases.condition.tolist(), cases.columns["load"].tolist()
    ([0, 1], [0, 1, 0], [1.0, 2.0])
    """

    columns: Mapping[str, NDArray[Any]]
    first: Indices
    condition: Indices

    def __len__(self) -> int:
        return len(self.first)

    @classmethod
    def of(
        cls, columns: Mapping[str, NDArray[Any]], units: int, rows: Indices | None = None
    ) -> Cases:
        """The cases of so many units, whose conditions are the `columns` (U,).

        Units with different numbers of `rows` (U,) are different cases.
        """
        number: dict[tuple[Any, ...], int] = {}
        parts = [_cells(column) for column in columns.values()]
        parts += [] if rows is None else [rows.tolist()]
        every = zip(*parts, strict=True) if parts else [()] * units
        condition = np.array([number.setdefault(row, len(number)) for row in every], dtype=np.intp)
        _, first = np.unique(condition, return_index=True)
        distinct = {name: column[first] for name, column in columns.items()}
        return cls(distinct, first.astype(np.intp), condition)

    def at(self, case: Indices) -> dict[str, NDArray[Any]]:
        """The conditions of some runs, by name, whose cases are `case` (R,)."""
        return {name: column[case] for name, column in self.columns.items()}

    def values(self, case: int) -> dict[str, Any]:
        """The conditions of one case by name."""
        return {name: column[case] for name, column in self.columns.items()}


def _cells(column: NDArray[Any]) -> list[Any]:
    """The entries of a column so that equal ones are one key."""
    cells: list[Any] = column.tolist()
    if column.dtype != object:
        return cells
    return [tuple(cell.tolist()) if isinstance(cell, np.ndarray) else cell for cell in cells]
