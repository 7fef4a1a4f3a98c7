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
        code = np.zeros(units, dtype=np.intp)
        for column in [*columns.values(), *([] if rows is None else [rows])]:
            one = _numbered(column)
            _, code = np.unique(code * (one.max(initial=0) + 1) + one, return_inverse=True)
        _, first, code = np.unique(code, return_index=True, return_inverse=True)
        # cases are numbered in the order of their first units
        order = np.argsort(first)
        condition = np.argsort(order)[code]
        first = first[order]
        distinct = {name: column[first] for name, column in columns.items()}
        return cls(distinct, first.astype(np.intp), condition.astype(np.intp))

    def at(self, case: Indices) -> dict[str, NDArray[Any]]:
        """The conditions of some runs, by name, whose cases are `case` (R,)."""
        return {name: column[case] for name, column in self.columns.items()}

    def values(self, case: int) -> dict[str, Any]:
        """The conditions of one case by name."""
        return {name: column[case] for name, column in self.columns.items()}


def _numbered(column: NDArray[Any]) -> Indices:
    """A number (U,) for each entry of a column, the same for equal ones."""
    if column.dtype != object:
        return np.unique(column, return_inverse=True)[1].astype(np.intp)
    number: dict[Any, int] = {}
    cells = (tuple(cell.tolist()) if isinstance(cell, np.ndarray) else cell for cell in column)
    return np.array([number.setdefault(cell, len(number)) for cell in cells], dtype=np.intp)
