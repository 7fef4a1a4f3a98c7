"""Measured values out of the columns of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aleator.errors import ExperimentsError
from aleator.observations.responses import Observations, Response, responses_of
from aleator.observations.tables import Table
from aleator.types import Array, Indices


class Values(NamedTuple):
    """Values of one column in the original unit: the row (m,) of each, and its two ends (m,)."""

    row: Indices
    lower: Array
    upper: Array


@dataclass(frozen=True)
class Outcomes:
    """Which columns of a table hold what was measured.

    Wide: each of the `columns` is a response of its name. Long: there is one column of values, and
    the column `response` says which response each is. `transform` is one for all responses, or one
    for each that has one.

    Raises ExperimentsError for columns that cannot be read so.

    >>> table = Table("a.csv", {"time": ["1", "2"], "torque": ["", "5"]}, ("row 2", "row 3"))
    >>> seen = Outcomes(("time", "torque")).read(table, np.array([0, 0]))
    >>> seen.lower.tolist(), seen.names, seen.response.tolist()
    ([1.0, 2.0, 5.0], ('time', 'torque'), [0, 0, 1])
    """

    columns: tuple[str, ...]
    response: str | None = None
    transform: str | Mapping[str, str] = "none"

    def __post_init__(self) -> None:
        if not self.columns or len({*self.columns}) != len(self.columns):
            raise ExperimentsError(
                f"the outcomes are {list(self.columns)}", "name each measured column once"
            )
        if self.response is not None and len(self.columns) > 1:
            raise ExperimentsError(
                f"the column '{self.response}' names the response of each value, and there are "
                f"{len(self.columns)} columns of values",
                "name one outcome, or leave out the response",
            )

    @property
    def taken(self) -> tuple[str, ...]:
        """The columns that hold what was measured, and are no conditions."""
        return (*self.columns, *([] if self.response is None else [self.response]))

    def require(self, table: Table, conditions: Sequence[str] | None) -> None:
        """Raise ExperimentsError for a column that is not there, or that is a condition too."""
        for name in self.columns:
            table.require(name, "the outcome")
        if self.response is not None:
            table.require(self.response, "the response")
        for name in self.taken if conditions is not None else ():
            if name in (conditions or ()):
                raise ExperimentsError(
                    f"{table.source}: '{name}' is both the outcome and a condition",
                    "leave it out of the conditions: a simulator must not know what was measured",
                )

    def read(self, table: Table, experiment: Indices) -> Observations:
        """The observations of a table whose rows are of the experiments (R,)."""
        parts = self._long(table) if self.response else self._wide(table)
        responses = responses_of([*parts], self.transform)
        seen = [
            _transformed(table, values, self._column(name), response)
            for (name, values), response in zip(parts.items(), responses, strict=True)
        ]
        row, lower, upper = (np.concatenate([part[k] for part in seen]) for k in range(3))
        which = np.repeat(np.arange(len(seen)), [len(part.row) for part in seen])
        order = np.lexsort((which, row, experiment[row]))
        row, which = row[order], which[order]
        return Observations(experiment[row], row, which, lower[order], upper[order], responses)

    def _column(self, response: str) -> str:
        return response if self.response is None else self.columns[0]

    def _wide(self, table: Table) -> dict[str, Values]:
        """The values of each column; with several columns a cell may be blank, a row may not."""
        if len(self.columns) == 1:
            values = table.numbers(self.columns[0])
            return {self.columns[0]: Values(np.arange(len(table)), values, values)}
        found = {name: table.numbers_or_blank(name) for name in self.columns}
        nothing = np.flatnonzero(np.all([np.isnan(values) for values in found.values()], axis=0))
        if nothing.size:
            place = f"{table.source}: {table.places[int(nothing[0])]}"
            raise ExperimentsError(
                f"{place}: no outcome: {', '.join(self.columns)} are all blank",
                "write what was measured there, or delete the row",
            )
        return {name: _given(values) for name, values in found.items()}

    def _long(self, table: Table) -> dict[str, Values]:
        """The values of each word of the column of responses, in order of appearance."""
        assert self.response is not None
        words = table.texts(self.response)
        if "" in words:
            raise ExperimentsError(
                f"{table.where(words.index(''), self.response)}: the response is blank",
                "write which response the value of this row is",
            )
        values = table.numbers(self.columns[0])
        names, of = list(dict.fromkeys(words)), np.array(words)
        rows = {name: np.flatnonzero(of == name) for name in names}
        return {name: Values(row, values[row], values[row]) for name, row in rows.items()}


def _given(values: Array) -> Values:
    row = np.flatnonzero(~np.isnan(values))
    return Values(row, values[row], values[row])


def _transformed(table: Table, values: Values, column: str, response: Response) -> Values:
    """The values as the likelihood sees them; raises ExperimentsError where it cannot."""
    ends = [response.transform(end) for end in (values.lower, values.upper)]
    for raw, end in zip((values.lower, values.upper), ends, strict=True):
        lost = np.flatnonzero(np.isfinite(raw) & ~np.isfinite(end))
        if lost.size:
            k = int(lost[0])
            raise ExperimentsError(
                f"{table.where(int(values.row[k]), column)}: {response.transform.fault(raw[k])}",
                f'correct the outcome, or leave out transform = "{response.transform}"',
            )
    return Values(values.row, *ends)
