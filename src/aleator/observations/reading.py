"""Measured values out of the columns of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aleator.errors import ExperimentsError
from aleator.observations.outcomes import Censoring, ColumnValues
from aleator.observations.responses import Observations, Response, require_responses, responses_of
from aleator.observations.tables import UNMEASURED, Table
from aleator.types import Array, Indices

Censored = Censoring | Mapping[str, Censoring] | None
"""How values are censored: all, or those of each response, or none."""


@dataclass(frozen=True)
class Outcomes:
    """Which columns of a table hold what was measured.

    Wide: each of the `columns` is a response of its name. Long: there is one column of values, and
    the column `response` says which response each is. `transform` and `censored` are one for all
    responses, or one for each that has one.

    Raises ExperimentsError for columns that cannot be read so.

    >>> table = Table("a.csv", {"time": ["1", "2"], "torque": ["", "5"]}, ("row 2", "row 3"))
    >>> seen = Outcomes(("time", "torque")).read(table, np.array([0, 0]))
    >>> seen.lower.tolist(), seen.names, seen.response.tolist()
    ([1.0, 2.0, 5.0], ('time', 'torque'), [0, 0, 1])
    """

    columns: tuple[str, ...]
    response: str | None = None
    transform: str | Mapping[str, str] = "none"
    censored: Censored = None

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
        if isinstance(self.censored, Censoring) and len(self.columns) > 1:
            raise ExperimentsError(
                f"censored: which of the responses {', '.join(self.columns)} is meant is not said",
                f"say it for each that is censored: censored = {{{self.columns[0]} = {{...}}}}",
            )

    @property
    def taken(self) -> tuple[str, ...]:
        """The columns that hold what was measured, and are no conditions."""
        censored = self.censored if isinstance(self.censored, Mapping) else {"": self.censored}
        said = [name for one in censored.values() if one is not None for name in one.columns]
        return (*self.columns, *([] if self.response is None else [self.response]), *said)

    def require(self, table: Table, conditions: Sequence[str] | None) -> None:
        """Raise ExperimentsError for a column that is not there, or that is a condition too."""
        for name in self.columns:
            table.require(name, "the outcome")
        if self.response is not None:
            table.require(self.response, "the response")
        both = [name for name in self.taken if name in (conditions or ())]
        if both:
            raise ExperimentsError(
                f"{table.source}: '{both[0]}' is both of the outcome and a condition",
                "leave it out of the conditions: a simulator must not know what was measured",
            )

    def read(self, table: Table, experiment: Indices) -> Observations:
        """The observations of a table whose rows are of the experiments (R,)."""
        rows = self._long(table) if self.response else dict.fromkeys(self.columns, None)
        responses = responses_of([*rows], self.transform)
        if isinstance(self.censored, Mapping):
            require_responses(self.censored, [*rows], "censored")
        every = np.arange(len(table))
        found = [self._values(table, r, every if of is None else of) for r, of in rows.items()]
        self._require_values(table, found)
        seen = [
            _transformed(table, values, self._columns(response.name), response)
            for values, response in zip(found, responses, strict=True)
        ]
        row, lower, upper = (np.concatenate([part[k] for part in seen]) for k in range(3))
        which = np.repeat(np.arange(len(seen)), [len(part.row) for part in seen])
        order = np.lexsort((which, row, experiment[row]))
        row, which = row[order], which[order]
        return Observations(experiment[row], row, which, lower[order], upper[order], responses)

    def _long(self, table: Table) -> dict[str, Indices]:
        """The rows of each word of the column of responses, in order of appearance."""
        assert self.response is not None
        words = table.texts(self.response)
        if "" in words:
            raise ExperimentsError(
                f"{table.where(words.index(''), self.response)}: the response is blank",
                "write which response the value of this row is",
            )
        of = np.array(words)
        return {name: np.flatnonzero(of == name) for name in dict.fromkeys(words)}

    def _values(self, table: Table, response: str, rows: Indices) -> ColumnValues:
        column, censoring = self._columns(response)[0], self._censoring(response)
        if censoring is not None:
            return censoring.read(table, column, rows)
        values = table.numbers_or_blank(column)[rows]
        given = ~np.isnan(values)
        return ColumnValues(rows[given], values[given], values[given])

    def _require_values(self, table: Table, found: Sequence[ColumnValues]) -> None:
        """Raise ExperimentsError for a row without any value."""
        given = np.zeros(len(table), dtype=bool)
        for values in found:
            given[values.row] = True
        if not np.all(given):
            row = int(np.flatnonzero(~given)[0])
            raise ExperimentsError(
                f"{table.where(row, self.columns[0])}: the cell is blank, a number is needed"
                + (f" there or in {', '.join(self.columns[1:])}" if len(self.columns) > 1 else ""),
                UNMEASURED,
            )

    def _censoring(self, response: str) -> Censoring | None:
        censored = self.censored
        return censored.get(response) if isinstance(censored, Mapping) else censored

    def _columns(self, response: str) -> tuple[str, str]:
        """The columns of the lower and of the upper ends of a response."""
        column = response if self.response is None else self.columns[0]
        censoring = self._censoring(response)
        return column, (censoring.upper if censoring else None) or column


def _transformed(
    table: Table, values: ColumnValues, columns: tuple[str, str], response: Response
) -> ColumnValues:
    """The values as the likelihood sees them; raises ExperimentsError where it cannot."""
    ends: list[Array] = []
    for raw, column in zip((values.lower, values.upper), columns, strict=True):
        ends.append(np.where(np.isinf(raw), raw, response.transform(raw)))
        lost = np.flatnonzero(np.isfinite(raw) & ~np.isfinite(ends[-1]))
        if lost.size:
            k = int(lost[0])
            raise ExperimentsError(
                f"{table.where(int(values.row[k]), column)}: {response.transform.fault(raw[k])}",
                f'correct the outcome, or leave out transform = "{response.transform}"',
            )
    return ColumnValues(values.row, ends[0], ends[1])
