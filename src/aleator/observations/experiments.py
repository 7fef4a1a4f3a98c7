"""The table of experiments: an id, the conditions, and what was measured."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from aleator.core.types import Array, Flags, Indices
from aleator.errors import ExperimentsError, nearest
from aleator.observations import tables
from aleator.observations.outcomes import Censored, OutcomeColumns
from aleator.observations.responses import Observations, Response, Transform, common_transform
from aleator.observations.tables import Table, real_numbers

if TYPE_CHECKING:
    import pandas as pd


DEFAULT_ID = "id"


@dataclass(frozen=True, eq=False, init=False)
class _TableRows:
    """R rows of a table, each of one of N experiments: what experiments and conditions share."""

    ids: tuple[str, ...]
    conditions: pd.DataFrame
    table: pd.DataFrame
    experiment: Indices
    places: Sequence[str]

    def __init__(
        self,
        ids: tuple[str, ...],
        conditions: pd.DataFrame,
        table: pd.DataFrame | None,
        experiment: Indices | None,
        places: Sequence[str] | None,
    ) -> None:
        """Without `experiment` each row is one. Raises ExperimentsError for sizes that differ."""
        experiment = np.arange(len(ids)) if experiment is None else np.array(experiment, np.intp)
        if len(experiment) != len(conditions):
            raise ExperimentsError(
                f"{len(experiment)} ids for {len(conditions)} rows of conditions",
                "give one id a row",
            )
        if len(set(ids)) != len(ids):
            twice = next(name for k, name in enumerate(ids) if name in ids[:k])
            raise ExperimentsError(
                f"the id '{twice}' appears twice", "give each experiment its own id"
            )
        if not np.array_equal(np.unique(experiment), np.arange(len(ids))):
            raise ExperimentsError(
                f"rows belong to {len(np.unique(experiment))} experiments, and there are "
                f"{len(ids)} ids",
                "number the experiment of each row from zero, and give each a row",
            )
        for name, value in {
            "ids": ids,
            "conditions": conditions,
            "table": conditions if table is None else table,
            "experiment": experiment,
            "places": [f"experiment '{ids[k]}'" for k in experiment] if places is None else places,
        }.items():
            object.__setattr__(self, name, value)

    def with_observations(self, seen: Observations) -> Experiments:
        """The experiments of these rows, with these observations."""
        return Experiments(
            self.ids, self.conditions, seen,
            table=self.table, experiment=self.experiment, places=self.places,
        )  # fmt: skip


def _rows_of(
    table: Table,
    id: str | None,
    names: Sequence[str] | None,
    outcomes: Sequence[str] = (),
    beside: Collection[str] = (),
    numbers: Collection[str] = (),
) -> tuple[_TableRows, Table]:
    """The rows of a table, and the table with their ids; rows with the same id are one experiment.

    The columns of `outcomes` are not part of the table that is kept. Conditions are `names`, or
    every other column but those `beside`. Those in `numbers` must be numbers.

    Raises ExperimentsError for a column that is not there, a blank id, and a slip in a number.
    """
    import pandas as pd

    if id is not None:
        table.require(id, "the id")
    elif DEFAULT_ID in table.columns and DEFAULT_ID not in outcomes:
        id = DEFAULT_ID
    ids, experiment = _ids(table, id)
    if id is not None:
        table = replace(table, ids=[ids[k] for k in experiment])
    remaining = [name for name in table.columns if name != id and name not in outcomes]
    for name in names or ():
        table.require(name, "the condition")
    conditions = {
        name: table.numbers(name) if name in numbers else _condition(table, name, names is not None)
        for name in (names if names is not None else remaining)
        if names is not None or name not in beside
    }
    whole = {n: conditions[n] if n in conditions else _any(table, n) for n in remaining}
    index = range(len(table))
    frame, every = pd.DataFrame(conditions, index=index), pd.DataFrame(whole, index=index)
    return _TableRows(ids, frame, every, experiment, table.rows), table


def _ids(table: Table, column: str | None) -> tuple[tuple[str, ...], Indices]:
    """The ids by first appearance, and the experiment of each row; row numbers without a column."""
    if column is None:
        return tuple(str(k) for k in range(1, len(table) + 1)), np.arange(len(table))
    number: dict[str, int] = {}
    experiment = np.empty(len(table), dtype=np.intp)
    for row, cell in enumerate(table.columns[column]):
        whole = isinstance(cell, float) and cell.is_integer()
        name = str(int(cell)) if isinstance(cell, float) and whole else str(cell).strip()
        if name in ("", "nan", "None", "<NA>"):
            raise ExperimentsError(
                f"{table.where(row, column)}: the id is blank",
                "write the id of the row's experiment, or delete the column: each row is then one",
            )
        experiment[row] = number.setdefault(name, len(number))
    return tuple(number), experiment


def _condition(table: Table, name: str, chosen: bool) -> Array | pd.Series:
    """A column of numbers, or one of objects if it is plainly not meant as numbers.

    A text in a column of numbers is a slip that must not turn the column into text: it is an error
    if most cells are numbers, and for a condition chosen by name already if one cell is.
    """
    import pandas as pd

    numbers = table.is_number(name)
    if not np.any(numbers) or not (chosen or 2 * int(np.sum(numbers)) >= len(numbers)):
        return pd.Series(table.columns[name], dtype=object)
    try:
        return table.numbers(name)
    except ExperimentsError as error:
        if chosen:
            raise
        remedy = f"{error.remedy}; or, if '{name}' is no condition, name those that are"
        raise ExperimentsError(error.problem, f"{remedy}: conditions = [...]") from None


def _any(table: Table, name: str) -> Array | pd.Series:
    """A column that is no condition: numbers, NaN where blank, if it has nothing else."""
    import pandas as pd

    try:
        return table.numbers_or_blank(name)
    except ExperimentsError:
        return pd.Series(table.columns[name], dtype=object)


@dataclass(frozen=True, eq=False, init=False)
class Conditions(_TableRows):
    """N experiments without outcomes: R rows of conditions.

    `ids` (N,) are distinct texts; `conditions` has R rows and a named column for each condition:
    float64 where every cell is a number, else objects. `table` has R rows and every column but the
    ids; `experiment` (R,) is the experiment of each row, arange(N) where each row is one, and
    `places` (R,) say where each stands. `responses` are those of the identification; `transform`
    is short for one response that has it.

    Raises ExperimentsError if the sizes differ or an id appears twice.

    >>> import pandas as pd
    >>> Conditions(("a", "b"), pd.DataFrame({"ratio": [0.9, 0.8]})).ids
    ('a', 'b')
    """

    responses: tuple[Response, ...]

    def __init__(
        self,
        ids: tuple[str, ...],
        conditions: pd.DataFrame,
        transform: str = Transform.NONE,
        *,
        responses: Sequence[Response] = (),
        table: pd.DataFrame | None = None,
        experiment: Indices | None = None,
        places: Sequence[str] | None = None,
    ) -> None:
        super().__init__(ids, conditions, table, experiment, places)
        one = (Response("outcome", Transform.named(transform)),)
        object.__setattr__(self, "responses", tuple(responses) or one)

    @property
    def transform(self) -> Transform:
        """The transform that all responses have; none where they differ."""
        return common_transform(self.responses)

    @property
    def simple(self) -> bool:
        """Whether each experiment is one row of one response."""
        alone = np.array_equal(self.experiment, np.arange(len(self.ids)))
        return len(self.responses) == 1 and alone

    @property
    def observations(self) -> Observations:
        """Every response at every row, as observations whose values are NaN."""
        order = np.argsort(self.experiment, kind="stable")
        row = np.repeat(order, len(self.responses))
        response = np.tile(np.arange(len(self.responses)), len(order))
        values = np.full(len(row), np.nan)
        return Observations(self.experiment[row], row, response, values, values, self.responses)

    @classmethod
    def from_frame(
        cls,
        frame: pd.DataFrame,
        *,
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        transform: str = Transform.NONE,
        responses: Sequence[Response] = (),
    ) -> Conditions:
        """Take `conditions` (default: every column but the id) from a data frame.

        Raises ExperimentsError as Experiments.from_frame does.

        >>> import pandas as pd
        >>> Conditions.from_frame(pd.DataFrame({"ratio": [0.9, 0.8]})).ids
        ('1', '2')
        """
        return cls._of(_rows_of(tables.from_frame(frame), id, conditions)[0], transform, responses)

    @classmethod
    def from_csv(
        cls,
        path: str | Path,
        *,
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        numbers: Collection[str] = (),
        transform: str = Transform.NONE,
        responses: Sequence[Response] = (),
        delimiter: str = ",",
        decimal: str = ".",
    ) -> Conditions:
        """Take `conditions` (default: every column but the id) from a delimited file.

        Those named in `numbers` must be numbers; the others may be text.
        Raises ExperimentsError as Experiments.from_csv does.
        """
        table = tables.read(path, delimiter, decimal)
        return cls._of(_rows_of(table, id, conditions, numbers=numbers)[0], transform, responses)

    @classmethod
    def _of(cls, rows: _TableRows, transform: str, responses: Sequence[Response]) -> Conditions:
        return cls(
            rows.ids, rows.conditions, transform, responses=responses,
            table=rows.table, experiment=rows.experiment, places=rows.places,
        )  # fmt: skip


def covariates(experiments: Experiments | Conditions, names: Sequence[str]) -> pd.DataFrame:
    """The named columns of the table with a row for each of the N experiments, indexed by ids.

    Raises ExperimentsError for a name that is no column, a blank cell, and a value that differs
    between rows of one experiment: a law holds for the whole experiment.

    >>> import pandas as pd
    >>> from aleator.observations.experiments import Conditions
    >>> table = pd.DataFrame({"id": ["a", "a", "b"], "by": ["x", "x", "y"], "time": [1, 2, 1]})
    >>> covariates(Conditions.from_frame(table, id="id"), ["by"])["by"].tolist()
    ['x', 'y']
    """
    table, owner = experiments.table, experiments.experiment
    first = np.searchsorted(np.sort(owner), np.arange(len(experiments.ids)))
    rows = np.argsort(owner, kind="stable")[first]
    for name in names:
        if name not in table.columns:
            known = [str(column) for column in table.columns]
            raise ExperimentsError(
                f"a law names '{name}', which is no column of the table{nearest(name, known)}",
                f"name one of {', '.join(known)}" if known else "add the column to the table",
            )
        cells = table[name].to_numpy()
        blank = table[name].isna().to_numpy() | (cells == "")
        if blank.any():
            raise ExperimentsError(
                f"{experiments.places[int(np.argmax(blank))]}, column '{name}' of experiment "
                f"'{experiments.ids[owner[int(np.argmax(blank))]]}' is blank, and a law needs it",
                "write its value in every row, or leave the experiment out",
            )
        other = np.flatnonzero(cells != cells[rows][owner])
        if other.size:
            row = int(other[0])
            one = int(rows[owner[row]])
            raise ExperimentsError(
                f"column '{name}' of experiment '{experiments.ids[owner[row]]}' is {cells[one]} in "
                f"{experiments.places[one]} and {cells[row]} in {experiments.places[row]}, "
                "and a law holds for the whole experiment",
                "name a column that does not vary within an experiment; what varies is a condition "
                "of the simulator",
            )
    found = table[list(names)].iloc[rows]
    return found.set_axis(list(experiments.ids), axis=0)


@dataclass(frozen=True, eq=False, init=False)
class Experiments(_TableRows):
    """N experiments: R rows of conditions, and M observations.

    `ids` (N,) are distinct texts. `conditions` has R rows and a named column for each condition:
    float64 where every cell is a number, else objects. `table` has R rows too, and every column
    but the ids and outcomes. `experiment` (R,) is the experiment of each row: rows of
    one experiment share one draw of the parameters. `places` (R,) say where each row stands.
    `observations` are what was measured.

    Experiments(ids, conditions, outcomes, outcome_name, transform) is a table with one row and one
    outcome an experiment; the outcomes (N,) are those after the `transform`.

    Raises ExperimentsError if the sizes differ, an id appears twice or an outcome is not finite.

    >>> import pandas as pd
    >>> frame = pd.DataFrame({"ratio": [0.95, 0.8], "kilocycles": [6.0, 25.0]})
    >>> experiments = Experiments.from_frame(frame, outcome="kilocycles", transform="log")
    >>> experiments.ids, experiments.outcomes.round(3).tolist()
    (('1', '2'), [1.792, 3.219])
    >>> frame = pd.DataFrame({"id": ["a", "a", "b"], "time": [1, 2, 1], "length": [1.1, 1.3, 1.0]})
    >>> series = Experiments.from_frame(frame, outcome="length")
    >>> series.ids, series.experiment.tolist(), series.simple
    (('a', 'b'), [0, 0, 1], False)
    """

    observations: Observations

    def __init__(
        self,
        ids: tuple[str, ...],
        conditions: pd.DataFrame,
        outcomes: ArrayLike | Observations,
        outcome_name: str = "outcome",
        transform: str = Transform.NONE,
        *,
        table: pd.DataFrame | None = None,
        experiment: Indices | None = None,
        places: Sequence[str] | None = None,
    ) -> None:
        super().__init__(ids, conditions, table, experiment, places)
        if not isinstance(outcomes, Observations):
            outcomes = _simple(outcomes, len(ids), outcome_name, Transform.named(transform))
        object.__setattr__(self, "observations", outcomes)

    def __len__(self) -> int:
        return len(self.ids)

    def only(self, which: Flags) -> Experiments:
        """The same experiments with some of the observations (M,)."""
        return self.with_observations(self.observations.only(which))

    @property
    def simple(self) -> bool:
        """Whether each experiment is one row with one value, not censored, all of one response."""
        seen, each = self.observations, np.arange(len(self.ids))
        return (
            len(seen.responses) == 1
            and np.array_equal(self.experiment, each)
            and np.array_equal(seen.row, each)
            and not np.any(seen.censored)
        )

    @property
    def outcomes(self) -> Array:
        """The outcomes (N,) of a simple table, as the likelihood sees them.

        Raises ExperimentsError for every other table: its `observations` are more than that.
        """
        if not self.simple:
            raise ExperimentsError(
                "the experiments have several observations, or some that are censored",
                "ask for their `observations`",
            )
        return self.observations.lower

    @property
    def measured(self) -> Array:
        """The outcomes (N,) of a simple table in their original unit, before the transform."""
        return self.transform.inverse(self.outcomes)

    @property
    def outcome_name(self) -> str:
        """The name of the response; several are joined by commas."""
        return ", ".join(self.observations.names)

    @property
    def transform(self) -> Transform:
        """The transform that all responses have; none where they differ."""
        return common_transform(self.observations.responses)

    @classmethod
    def from_frame(
        cls,
        frame: pd.DataFrame,
        *,
        outcome: str | Sequence[str],
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        transform: str | Mapping[str, str] = Transform.NONE,
        response: str | None = None,
        censored: Censored = None,
        beside: Collection[str] = (),
    ) -> Experiments:
        """Take the `outcome`, the `id` and the `conditions` from the columns of a data frame.

        `id` defaults to the column "id" if there is one, else each row is an experiment, numbered
        from 1; rows with the same id are one experiment. `outcome` is the measured column, or
        several: each is then a response, and a cell may be blank. With `response`, the column of
        that name says which response each value of the one outcome is. `transform` "log" takes the
        logarithm of outcomes that are positive; {response: transform} gives each its own. So does
        {response: Censoring(...)} as `censored`, by which only bounds of some outcomes are known.
        `conditions` default to every other column but those `beside`.

        Raises ExperimentsError with row and column for: a missing column, a blank, a text, NaN or
        an infinity where a number is needed, a blank id, the logarithm of an outcome <= 0, a
        censored value without a bound.

        >>> import pandas as pd
        >>> frame = pd.DataFrame({"id": ["a", "b"], "load": [1, 2], "time": [0.8, 0.9]})
        >>> Experiments.from_frame(frame, outcome="time").conditions.columns.tolist()
        ['load']
        """
        outcomes = OutcomeColumns(_names(outcome), response, transform, censored)
        return cls._from_table(tables.from_frame(frame), outcomes, id, conditions, beside)

    @classmethod
    def from_csv(
        cls,
        path: str | Path,
        *,
        outcome: str | Sequence[str],
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        transform: str | Mapping[str, str] = Transform.NONE,
        response: str | None = None,
        censored: Censored = None,
        beside: Collection[str] = (),
        delimiter: str = ",",
        decimal: str = ".",
    ) -> Experiments:
        """Take the `outcome`, the `id` and the `conditions` from the columns of a delimited file.

        Arguments as in `from_frame`. Text is UTF-8 or UTF-16, the first row names the columns.

        Raises ExperimentsError as `from_frame` does, with the row as a spreadsheet counts it (the
        header is row 1), and for a file that is absent, empty, no text, or differently delimited.
        """
        outcomes = OutcomeColumns(_names(outcome), response, transform, censored)
        table = tables.read(path, delimiter, decimal)
        return cls._from_table(table, outcomes, id, conditions, beside)

    @classmethod
    def _from_table(
        cls,
        table: Table,
        outcomes: OutcomeColumns,
        id: str | None,
        names: Sequence[str] | None,
        beside: Collection[str],
    ) -> Experiments:
        outcomes.require(table, names)
        rows, table = _rows_of(table, id, names, outcomes.taken, beside)
        return rows.with_observations(outcomes.read(table, rows.experiment))


def unmeasured(conditions: Conditions) -> Experiments:
    """Experiments under these conditions, with NaN for every value because none is measured."""
    return conditions.with_observations(conditions.observations)


def _names(outcome: str | Sequence[str]) -> tuple[str, ...]:
    return (outcome,) if isinstance(outcome, str) else tuple(outcome)


def _simple(outcomes: ArrayLike, count: int, name: str, transform: Transform) -> Observations:
    try:
        values = real_numbers(outcomes)
    except TypeError as error:
        raise ExperimentsError(
            f"the outcomes are {error}", "give one finite outcome for each experiment"
        ) from None
    if values.shape != (count,) or not np.all(np.isfinite(values)):
        raise ExperimentsError(
            f"outcomes of shape {values.shape} for {count} experiments, "
            f"{np.sum(~np.isfinite(values))} of them not finite",
            "give one finite outcome for each experiment",
        )
    return Observations.exact(values, name, transform)
