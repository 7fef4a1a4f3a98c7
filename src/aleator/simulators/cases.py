"""The distinct conditions of a table of experiments, of those that a simulator asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.types import Indices


@dataclass(frozen=True, eq=False)
class Cases:
    """U cases of N experiments: experiments under equal conditions are one case, and share runs.

    `columns` has an array (U,) for each condition, `first` (U,) is the first experiment of each
    case, `condition` (N,) the case of each experiment.

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
    def of(cls, columns: Mapping[str, NDArray[Any]], experiments: int) -> Cases:
        """The cases of so many experiments, whose conditions are the `columns` (N,)."""
        number: dict[tuple[Any, ...], int] = {}
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        every = rows if columns else [()] * experiments
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
