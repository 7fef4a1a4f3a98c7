"""What one run of a simulator serves, under which conditions, and which values it returns."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array, Flags, Indices
from aleator.errors import SimulatorError, nearest
from aleator.observations.responses import Response, Transform
from aleator.observations.tables import real_numbers
from aleator.simulators.protocol import Columns, Simulator, WithSlopes

if TYPE_CHECKING:
    import pandas as pd

    from aleator.observations.experiments import Conditions, Experiments


@dataclass(frozen=True, eq=False)
class Cases:
    """The C distinct conditions (cases) of U units; units under equal conditions share their runs.

    A unit is what one run serves: a row of the table, or a whole experiment. `columns` has an array
    (C,) for each condition; for a condition that varies within a series its entries are arrays.
    `first` (C,) is the first unit of each case, and `condition` (U,) the case of each unit.

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
        """The cases of `units` units, from their conditions in the `columns` (U,).

        Units with different numbers of `rows` (U,) are different cases.
        """
        code = np.zeros(units, dtype=np.intp)
        for column in [*columns.values(), *([] if rows is None else [rows])]:
            one = _numbered(column)
            _, code = np.unique(code * (one.max(initial=0) + 1) + one, return_inverse=True)
        _, first, code = np.unique(code, return_index=True, return_inverse=True)
        # Cases are numbered in the order of their first units.
        order = np.argsort(first)
        condition = np.argsort(order)[code]
        first = first[order]
        distinct = {name: column[first] for name, column in columns.items()}
        return cls(distinct, first.astype(np.intp), condition.astype(np.intp))

    def at(self, case: Indices | int) -> dict[str, Any]:
        """The conditions by name, of one case or of R runs with the cases `case` (R,)."""
        return {name: column[case] for name, column in self.columns.items()}


def _numbered(column: NDArray[Any]) -> Indices:
    """Numbers (U,) for the entries of a column; equal entries have equal numbers."""
    if column.dtype != object:
        return np.unique(column, return_inverse=True)[1].astype(np.intp)
    number: dict[Any, int] = {}
    cells = (tuple(cell.tolist()) if isinstance(cell, np.ndarray) else cell for cell in column)
    return np.array([number.setdefault(cell, len(number)) for cell in cells], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Units:
    """U units, each served by one run: rows of the table, or whole experiments if `series`.

    A run of a unit returns W values: its rows one after the other, and in each row a value for each
    response. `experiment` (U,) is the experiment of each unit, and `rows` (U,) its number of rows.
    Observation k of M is value `column[k]` of unit `unit[k]`. `place` (U,) is the position of the
    unit's first row in its experiment, from 0. `row` (R,) lists the rows of the table, unit by
    unit.
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
        """The units of a table: whole experiments if one run makes a series, else rows.

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
        """The names of the responses, in the order of the values of a row."""
        return tuple(response.name for response in self.responses)

    @property
    def width(self) -> int:
        """W, the largest number of values that a run returns."""
        return int(self.rows.max(initial=1)) * len(self.responses)

    def columns(
        self, frame: pd.DataFrame, names: Sequence[str], varying: Collection[str] = ()
    ) -> dict[str, NDArray[Any]]:
        """Arrays (U,) of the conditions by name, with an entry for each unit.

        In a series the entry is an array (m,) if the condition varies in any experiment, or is one
        of `varying`; otherwise it is a number or a text.
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
        """Values (R, W) on the scale of the likelihood, from values in the simulator's units."""
        if all(response.transform is Transform.NONE for response in self.responses):
            return values
        seen, size = values.copy(), len(self.responses)
        for k, response in enumerate(self.responses):
            part = slice(k, self.width, size)
            seen[:, part] = response.transform(values[:, part])
        return seen

    def rates(self, values: Array) -> Array:
        """The derivatives (R, W) of the transforms at values in the simulator's units."""
        out, size = np.ones_like(values), len(self.responses)
        for k, response in enumerate(self.responses):
            if response.transform is Transform.LOG:
                with np.errstate(divide="ignore"):
                    out[:, k::size] = 1.0 / values[:, k::size]
        return out


def _cut(column: NDArray[Any], starts: Indices, ends: Indices) -> NDArray[Any]:
    cells = np.empty(len(starts), dtype=object)
    for k, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        cells[k] = column[start:end]
    return cells


RunValue = float | Array | Mapping[str, Any] | WithSlopes
"""The return value of one run: a number, an array (m,) of a series, or one of these by response.
Each may have its slopes beside it."""


@dataclass(frozen=True, eq=False)
class Form:
    """Which of W values each of R runs returns: row by row, and in each row one for each response.

    `rows` (R,) is the number of rows of each run, and `experiments` (R,) the id of its experiment;
    both are None if every run makes one row. `observed` (R, W) marks values that an experiment
    measured; these must be finite. None means that all are measured. If the simulator gives the
    derivatives of each value by `slopes` parameters, they follow the values: W slopes more columns.
    """

    responses: tuple[str, ...] = ("",)
    width: int = 1
    rows: Indices | None = None
    observed: Flags | None = None
    experiments: NDArray[np.object_] | None = None
    slopes: int = 0

    @classmethod
    def of(cls, units: Units, cases: Cases, ids: Sequence[str], slopes: int = 0) -> Form:
        """Which values a run under each of the distinct conditions returns."""
        observed = np.zeros((len(cases), units.width), dtype=np.bool_)
        observed[cases.condition[units.unit], units.column] = True
        experiments = np.array(ids, dtype=object)[units.experiment[cases.first]]
        return cls(
            units.names,
            units.width,
            units.rows[cases.first] if units.series else None,
            None if np.all(observed) else observed,
            experiments if units.series else None,
            slopes,
        )

    @property
    def columns(self) -> int:
        """The number of values of a run and of their slopes."""
        return self.width * (1 + self.slopes)

    def some(self, rows: slice | Indices) -> Form:
        """This form for the runs `rows` alone: which values they return."""
        if self.rows is None and self.observed is None:
            return self
        return replace(
            self,
            rows=None if self.rows is None else self.rows[rows],
            observed=None if self.observed is None else self.observed[rows],
            experiments=None if self.experiments is None else self.experiments[rows],
        )

    def missing(self, values: Array) -> Flags:
        """Which values (R, W) are measured by an experiment but not finite."""
        wrong = ~np.isfinite(values[:, : self.width])
        return wrong if self.observed is None else wrong & self.observed

    def fault(self, run: int, column: int, value: float) -> str:
        """The message about the value in this column of a run, which is not finite.

        >>> Form(("speed", "time"), 4, np.array([2])).fault(0, 3, np.nan)
        'it returned nan for time in row 2 of 2'
        """
        response = self.responses[column % len(self.responses)]
        named = f" for {response}" if len(self.responses) > 1 else ""
        row = column // len(self.responses) + 1
        placed = "" if self.rows is None else f" in row {row} of {self.rows[run]}"
        return f"it returned {value:g}{named}{placed}"

    def shaped(self, simulator: Simulator, returned: Any, count: int) -> Array:
        """Values (count, W) of the first `count` runs; NaN where a run returned fewer values.

        `returned` is an array (count,) of numbers, a mapping from responses to such arrays, or a
        list with the return value of each run. Slopes follow the values, where there are any.
        Raises SimulatorError for a wrong shape or type, a missing response, and a series of the
        wrong length.
        """
        if not count:
            return np.empty((0, self.columns))
        if self.rows is not None and not isinstance(returned, Mapping):
            returned = [*returned]
        if isinstance(returned, list):
            return self._listed(simulator, returned)
        if isinstance(returned, Mapping):
            parts = [_numbers(simulator, part, count) for part in self._of(simulator, returned)]
            return np.stack(parts, axis=1)
        if len(self.responses) > 1 and np.shape(returned) == (count,):
            raise self._unnamed(simulator, "one number a run")
        return _numbers(simulator, returned, count)[:, None]

    def of_rows(self, simulator: Simulator, returned: Any) -> Array:
        """Values (R, W) of R series, of which a function returned all rows one after the other.

        Raises SimulatorError as `shaped` does.

        >>> form = Form(width=2, rows=np.array([2, 1]))
        >>> form.of_rows(None, np.array([1.0, 2.0, 3.0])).tolist()
        [[1.0, 2.0], [3.0, nan]]
        """
        assert self.rows is not None
        size, count = len(self.responses), int(self.rows.sum())
        values = np.full((len(self.rows), self.width // size, size), np.nan)
        filled = np.arange(self.width // size) < self.rows[:, None]
        rows = replace(self, rows=None, observed=None, width=size)
        values[filled] = rows.shaped(simulator, returned, count)
        return values.reshape(len(self.rows), self.width)

    def _listed(self, simulator: Simulator, answers: Sequence[RunValue]) -> Array:
        values = np.full((len(answers), self.columns), np.nan)
        rates = values[:, self.width :].reshape(len(answers), self.width, self.slopes)
        for k, answer in enumerate(answers):
            given: Any = ()
            if isinstance(answer, WithSlopes):
                answer, given = answer.value, answer.slopes
            if isinstance(answer, Mapping):
                parts = self._of(simulator, answer)
            elif len(self.responses) == 1:
                parts = [answer]
            else:
                raise self._unnamed(simulator, "an array" if np.ndim(answer) else "one number")
            size = len(self.responses)
            rows = 1 if self.rows is None else int(self.rows[k])
            for j, part in enumerate(parts):
                if np.ndim(part) and np.shape(part) != (rows,):
                    raise self._wrong_length(simulator, k, j, np.shape(part)[0], rows)
                number = part if isinstance(part, float) else _real(simulator, part)
                values[k, j : rows * size : size] = number
                if self.slopes:
                    one = given[self.responses[j]] if isinstance(given, Mapping) else given
                    rates[k, j : rows * size : size] = one
        return values

    def _of(self, simulator: Simulator, answer: Mapping[str, Any]) -> list[Any]:
        """The values that one run returned, in the order of the responses."""
        for name in self.responses:
            if name not in answer:
                raise SimulatorError(
                    f"simulator '{simulator.name}' returned no "
                    f"'{name}'{nearest(name, [*answer])}; it returned "
                    + (", ".join(map(str, answer)) or "nothing"),
                    "let it return what the table measures, by the names of the responses",
                )
        return [answer[name] for name in self.responses]

    def _unnamed(self, simulator: Simulator, got: str) -> SimulatorError:
        return SimulatorError(
            f"simulator '{simulator.name}' returned {got}, but the table has the responses "
            + ", ".join(self.responses),
            "let it return a mapping: {"
            + ", ".join(f'"{name}": ...' for name in self.responses)
            + "}",
        )

    def _wrong_length(
        self, simulator: Simulator, run: int, response: int, got: int, rows: int
    ) -> SimulatorError:
        name = self.responses[response]
        named = f" of {name}" if len(self.responses) > 1 else ""
        where = f" for experiment '{self.experiments[run]}'" if self.experiments is not None else ""
        return SimulatorError(
            f"simulator '{simulator.name}' returned {got} values{named}{where}, which has {rows} "
            f"rows: expected an array of shape ({rows},)",
            "let it return one value for each row of the experiment, in their order, or one number "
            "for all of them",
        )


def is_named(returned: Any) -> bool:
    """Whether the returned values have the names of their responses."""
    first = returned[0] if isinstance(returned, list) and returned else returned
    return isinstance(first.value if isinstance(first, WithSlopes) else first, Mapping)


def _numbers(simulator: Simulator, returned: object, count: int) -> Array:
    shape = np.shape(np.asanyarray(returned))
    if shape != (count,):
        kind = type(returned).__name__
        got = f"{kind} of shape {shape}" if shape else f"a single {kind}"
        raise SimulatorError(
            f"simulator '{simulator.name}' returned {'None' if returned is None else got} "
            f"for {count} values, expected an array of shape ({count},)",
            "leave out vectorized if it computes one run at a time (as float() and the "
            "functions of math do); else let it return one number a run",
        )
    return _real(simulator, returned)


def _real(simulator: Simulator, part: object) -> Array:
    try:
        return real_numbers(part)
    except TypeError as error:
        raise SimulatorError(
            f"simulator '{simulator.name}' returned {error}", "let it return real numbers"
        ) from None


@dataclass(frozen=True, eq=False)
class Bound:
    """A simulator with the distinct conditions of a table, and names for the n columns of x.

    `form` says which values one run under each of the conditions returns.

    >>> from aleator.simulators.function import FunctionSimulator
    >>> cases = Cases.of({"load": np.array([1.0, 2.0])}, 2)
    >>> bound = Bound(FunctionSimulator(lambda load, x: load * x), cases, ("x",))
    >>> bound.columns(np.array([1, 1]), np.array([[0.5], [0.7]]))
    ({'load': array([2., 2.])}, {'x': array([0.5, 0.7])})

    `by_rows` says that a function of series is called with the rows of many runs one after the
    other: every condition and parameter is then an array with an entry for each row.
    """

    simulator: Simulator
    cases: Cases
    parameters: tuple[str, ...]
    form: Form = Form()
    by_rows: bool = False

    def columns(self, case: Indices, x: Array) -> tuple[Columns, Columns]:
        """Conditions and parameters by name, of runs of cases `case` (R,) at points x (R, n)."""
        conditions, points = self.cases.at(case), np.asarray(x, dtype=np.float64)
        if self.by_rows and self.form.rows is not None:
            rows = self.form.rows[case]
            conditions = {
                name: np.concatenate(cells)
                if isinstance(cells[0], np.ndarray)
                else np.repeat(cells, rows)
                for name, cells in conditions.items()
            }
            points = np.repeat(points, rows, axis=0)
        return conditions, dict(zip(self.parameters, points.T.copy(), strict=True))

    def shaped(self, case: Indices, returned: Any) -> Array:
        """Values (R, W) of what a call returned for runs of cases `case` (R,)."""
        form = self.form.some(case)
        if self.by_rows:
            return form.of_rows(self.simulator, returned)
        return form.shaped(self.simulator, returned, len(case))
