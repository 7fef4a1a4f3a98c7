"""What one run of a simulator serves: a row of the table, or a whole experiment."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aleator.observations.responses import Response, Transform
from aleator.types import Array, Indices

if TYPE_CHECKING:
    import pandas as pd

    from aleator.observations.experiments import Conditions, Experiments


@dataclass(frozen=True, eq=False)
class Units:
    """U units: the rows of a table, or its experiments where the simulator makes whole `series`.

    A run of a unit returns W values: its rows one after the other, and of each row the responses.
    `experiment` (U,) is the experiment of each unit, `rows` (U,) how many rows of it a run serves.
    Observation k of M is value `column[k]` of unit `unit[k]`. `place` (U,) is where the unit's
    first row stands in its experiment, from 0; `row` (R,) are the table's rows, unit by unit.
    """

    series: bool
    responses: tuple[Response, ...]
    experiment: Indices
    rows: Indices
    place: Indices
    row: Indices
    unit: Indices
    column: Indices

    def __len__(self) -> int:
        return len(self.experiment)

    @classmethod
    def of(cls, table: Experiments | Conditions, series: bool = False) -> Units:
        """The units of a table, whose `series` come by one run each or row by row.

        >>> import pandas as pd
        >>> from aleator.observations.experiments import Conditions
        >>> units = Units.of(Conditions(("a", "b"), pd.DataFrame({"load": [1.0, 2.0]})))
        >>> len(units), units.width, units.unit.tolist(), units.column.tolist()
        (2, 1, [0, 1], [0, 0])
        """
        count, experiment, seen = len(table.conditions), table.experiment, table.observations
        order = np.argsort(experiment, kind="stable")
        sizes = np.bincount(experiment, minlength=len(table.ids))
        position = np.empty(count, dtype=np.intp)
        position[order] = np.arange(count) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        if series:
            return cls(
                True, seen.responses, np.arange(len(sizes)), sizes.astype(np.intp),
                np.zeros(len(sizes), np.intp), order, experiment[seen.row],
                position[seen.row] * len(seen.responses) + seen.response,
            )  # fmt: skip
        return cls(
            False, seen.responses, experiment, np.ones(count, np.intp), position,
            np.arange(count), seen.row, seen.response,
        )  # fmt: skip

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the responses."""
        return tuple(response.name for response in self.responses)

    @property
    def width(self) -> int:
        """W, the most values of a run."""
        return int(self.rows.max(initial=1)) * len(self.responses)

    def columns(
        self, frame: pd.DataFrame, names: Sequence[str], varying: Collection[str] = ()
    ) -> dict[str, NDArray[Any]]:
        """Conditions by name, an entry (U,) for each unit.

        An entry of a series is an array (m,) where the condition varies in any experiment, or is
        one of `varying`; else it is a number or a text.
        """
        columns = {name: frame[name].to_numpy()[self.row] for name in names}
        if not self.series:
            return columns
        ends = np.cumsum(self.rows)
        starts = ends - self.rows
        inside = np.repeat(starts, self.rows)
        return {
            name: _cut(column, starts, ends)
            if name in varying or np.any(column != column[inside])
            else column[starts]
            for name, column in columns.items()
        }

    def transformed(self, values: Array) -> Array:
        """Values (R, W) in the simulator's units as the likelihood sees them."""
        if all(response.transform is Transform.NONE for response in self.responses):
            return values
        seen, size = values.copy(), len(self.responses)
        for k, response in enumerate(self.responses):
            seen[:, k::size] = response.transform(values[:, k::size])
        return seen


def _cut(column: NDArray[Any], starts: Indices, ends: Indices) -> NDArray[Any]:
    cells = np.empty(len(starts), dtype=object)
    for k, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        cells[k] = column[start:end]
    return cells
