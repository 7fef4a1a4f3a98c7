"""The table of experiments: their ids, their conditions, and the measured values."""

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
    """R rows of a table of N experiments, the base class of `Experiments` and `Conditions`.

    An experiment has one row or several.
    """

    ids: tuple[str, ...]
    conditions: pd.DataFrame
    table: pd.DataFrame
    experiment: Indices
    places: Sequence[str]
    id: str | None

    def __init__(
        self,
        ids: tuple[str, ...],
        conditions: pd.DataFrame,
        table: pd.DataFrame | None,
        experiment: Indices | None,
        places: Sequence[str] | None,
        id: str | None,
    ) -> None:
        """Take the rows; if `experiment` is None each row is one experiment.

        `id` is the name of the column of ids; None if ids are the numbers of the rows.

        Raises ExperimentsError for sizes that differ, an id that appears twice, or an experiment
        without a row.
        """
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
            "id": id,
        }.items():
            object.__setattr__(self, name, value)

    def with_observations(self, seen: Observations) -> Experiments:
        """The experiments of these rows, with these observations."""
        return Experiments(
            self.ids, self.conditions, seen,
            table=self.table, experiment=self.experiment, places=self.places, id=self.id,
        )  # fmt: skip


def _rows_of(
    table: Table,
    id: str | None,
    names: Sequence[str] | None,
    outcomes: Sequence[str] = (),
    beside: Collection[str] = (),
    numbers: Collection[str] = (),
) -> tuple[_TableRows, Table]:
    """The rows of a table, and the table with the ids of its rows.

    Rows with the same id are one experiment. The columns `outcomes` are left out of the rows. The
    conditions are the columns `names`, by default every other column but those in `beside`. Columns
    in `numbers` must hold numbers.

    Raises ExperimentsError for a missing column, a blank id, and a faulty number.
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
    return _TableRows(ids, frame, every, experiment, table.rows, id), table


def _ids(table: Table, column: str | None) -> tuple[tuple[str, ...], Indices]:
    """The ids in order of first appearance, and the experiment of each row.

    If `column` is None, the ids are the row numbers from 1.
    """
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
    """The column of a condition, as numbers or, if it is clearly not meant as numbers, as texts.

    A text in a column of numbers is a typing error, which must not turn the column into texts.
    ExperimentsError is raised for a text if at least half of the cells are numbers. If the user has
    `chosen` the condition by name, it is raised if any cell is a number.
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
    """A column that is no condition: as numbers (NaN for a blank) if possible, else as objects."""
    import pandas as pd

    try:
        return table.numbers_or_blank(name)
    except ExperimentsError:
        return pd.Series(table.columns[name], dtype=object)


@dataclass(frozen=True, eq=False, init=False)
class Conditions(_TableRows):
    """N experiments without outcomes: R rows of conditions.

    `ids` (N,) are distinct texts. `conditions` is a data frame with R rows and a named column for
    each condition: float64 where every cell is a number, else objects. `table` is a data frame with
    R rows and every column but the ids. `experiment` (R,) is the number of the experiment of each
    row, and `places` (R,) say in words where each row stands. `id` is the name of the column of
    ids, None if they are the numbers of the rows. `responses` are the measured quantities of the
    identification; in place of them, `transform` stands for one response with this transform.

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
        id: str | None = DEFAULT_ID,
    ) -> None:
        super().__init__(ids, conditions, table, experiment, places, id)
        one = (Response("outcome", Transform.named(transform)),)
        object.__setattr__(self, "responses", tuple(responses) or one)

    @property
    def transform(self) -> Transform:
        """The common transform of all responses; Transform.NONE if they differ."""
        return common_transform(self.responses)

    @property
    def simple(self) -> bool:
        """Whether each experiment has one row, and there is one response."""
        alone = np.array_equal(self.experiment, np.arange(len(self.ids)))
        return len(self.responses) == 1 and alone

    @property
    def observations(self) -> Observations:
        """Observations of every response in every row, with NaN for their values."""
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
        numbers: Collection[str] = (),
        transform: str = Transform.NONE,
        responses: Sequence[Response] = (),
        decimal: str = ".",
    ) -> Conditions:
        """Take `conditions` (default: every column but the id) from a data frame.

        Those named in `numbers` must be numbers; the others may be text. `decimal` is the decimal
        sign of numbers that are texts. Raises ExperimentsError in the cases of
        `Experiments.from_frame`.

        >>> import pandas as pd
        >>> Conditions.from_frame(pd.DataFrame({"ratio": [0.9, 0.8]})).ids
        ('1', '2')
        """
        table = replace(tables.from_frame(frame), decimal=decimal)
        return cls._of(_rows_of(table, id, conditions, numbers=numbers)[0], transform, responses)

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
        Raises ExperimentsError in the cases of `Experiments.from_csv`.
        """
        table = tables.read(path, delimiter, decimal)
        return cls.from_table(table, id, conditions, numbers, transform, responses)

    @classmethod
    def from_table(
        cls,
        table: Table,
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        numbers: Collection[str] = (),
        transform: str = Transform.NONE,
        responses: Sequence[Response] = (),
    ) -> Conditions:
        """Take the columns that `from_csv` names from a table that was read."""
        return cls._of(_rows_of(table, id, conditions, numbers=numbers)[0], transform, responses)

    @classmethod
    def _of(cls, rows: _TableRows, transform: str, responses: Sequence[Response]) -> Conditions:
        return cls(
            rows.ids, rows.conditions, transform, responses=responses,
            table=rows.table, experiment=rows.experiment, places=rows.places, id=rows.id,
        )  # fmt: skip


def covariates(experiments: Experiments | Conditions, names: Sequence[str]) -> pd.DataFrame:
    """The columns `names` of the table, with one row for each of the N experiments.

    The law of the parameters may depend on them. The rows are indexed by the ids. Raises
    ExperimentsError for a name that is no column, for a blank cell, and for a value that differs
    between rows of one experiment, because a law holds for the whole experiment.

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

    `ids` (N,) are distinct texts. `conditions` is a data frame with R rows and a named column for
    each condition: float64 where every cell is a number, else objects. `table` is a data frame with
    R rows and every column but the ids and outcomes. `experiment` (R,) is the number of the
    experiment of each row; rows of one experiment share one draw of the parameters. `places` (R,)
    say in words where each row stands. `id` is the name of the column of ids, None if they are the
    numbers of the rows. `observations` are the measured values.

    Experiments(ids, conditions, outcomes, outcome_name, transform) makes a table with one row and
    one outcome for each experiment; the outcomes (N,) are already transformed.

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
        id: str | None = DEFAULT_ID,
    ) -> None:
        super().__init__(ids, conditions, table, experiment, places, id)
        if not isinstance(outcomes, Observations):
            outcomes = _simple(outcomes, len(ids), outcome_name, Transform.named(transform))
        object.__setattr__(self, "observations", outcomes)

    def __len__(self) -> int:
        return len(self.ids)

    def only(self, which: Flags) -> Experiments:
        """These experiments, with only the observations that are marked in `which` (M,)."""
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
    def exact_each(self) -> int | None:
        """The number of values of each experiment without noise; None if it differs.

        It is None, too, if one of several values is censored.
        """
        seen = self.observations
        counts = np.bincount(seen.experiment, minlength=len(self.ids))
        alike = len(seen) > 0 and np.all(counts == counts[0])
        return int(counts[0]) if alike and (counts[0] == 1 or not np.any(seen.censored)) else None

    @property
    def outcomes(self) -> Array:
        """The transformed outcomes (N,) of a simple table, as the likelihood uses them.

        Raises ExperimentsError if the table is not `simple`; then use `observations`.
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
        """The name of the response; the names of several responses are joined by commas."""
        return ", ".join(self.observations.names)

    @property
    def transform(self) -> Transform:
        """The common transform of all responses; Transform.NONE if they differ."""
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

        Rows with the same `id` are one experiment. `id` is by default the column "id"; without one,
        each row is an experiment, numbered from 1. `outcome` is the column of measured values, or
        several columns, each of which is then a response in which cells may be blank. `response` is
        a column that names the response of each value in the one outcome column. The `transform`
        "log" takes the logarithm of the outcomes, which must be positive; a mapping
        {response: transform} gives each response its own. `censored` says which outcomes are known
        only by bounds, as a `Censoring` or a mapping {response: Censoring(...)}. `conditions` are
        by default all other columns but those in `beside`.

        Raises ExperimentsError, which names row and column, for a missing column; for a blank, a
        text, NaN or an infinity where a number is needed; for a blank id; for the logarithm of an
        outcome <= 0; and for a censored value without a bound.

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

        The other arguments are those of `from_frame`. The text is UTF-8 or UTF-16, and its first
        row names the columns.

        Raises ExperimentsError in the cases of `from_frame`, with the row number of a spreadsheet
        (the header is row 1), and for a file that is absent, empty, no text file, or has another
        delimiter.
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


def conditions_of(experiments: Experiments, which: Flags, *, named: bool = True) -> Conditions:
    """The conditions of those experiments that are marked in `which` (N,), with all columns.

    If they are not `named` they are new experiments, whose ids say nothing.

    >>> import pandas as pd
    >>> frame = pd.DataFrame({"id": ["a", "b"], "load": [1, 2], "time": [0.8, 0.9]})
    >>> table = Experiments.from_frame(frame, outcome="time")
    >>> conditions_of(table, np.array([False, True])).ids
    ('b',)
    """
    return _conditions_of(experiments, which, which[experiments.experiment], named)


def _conditions_of(experiments: Experiments, which: Flags, kept: Flags, named: bool) -> Conditions:
    """The conditions of the experiments `which` (N,), of which the rows `kept` (R,) are taken."""
    number, rows = np.cumsum(which) - 1, np.flatnonzero(kept)
    return Conditions(
        tuple(name for name, kept in zip(experiments.ids, which, strict=True) if kept),
        experiments.conditions.iloc[rows].reset_index(drop=True),
        responses=experiments.observations.responses,
        table=experiments.table.iloc[rows].reset_index(drop=True),
        experiment=number[experiments.experiment[rows]],
        places=[experiments.places[row] for row in rows.tolist()],
        id=experiments.id if named else None,
    )


def distinct_conditions(experiments: Experiments, names: Sequence[str]) -> Conditions:
    """New experiments as those that differ in a column in `names`, each once, in their order.

    Rows of an experiment that are equal in these columns count once. Only series keep their ids,
    which say which rows belong together.

    >>> import pandas as pd
    >>> frame = pd.DataFrame({"load": [1, 1, 2], "oil": ["a", "b", "a"], "time": [0.8, 0.9, 2.0]})
    >>> table = Experiments.from_frame(frame, outcome="time")
    >>> distinct_conditions(table, ["load"]).conditions["load"].tolist()
    [1.0, 2.0]
    >>> repeated = Experiments.from_frame(frame.assign(id=[*"ccd"]), outcome="time", id="id")
    >>> distinct_conditions(repeated, ["load"]).conditions["load"].tolist()
    [1.0, 2.0]
    """
    cells = experiments.table[list(names)].astype(object).to_numpy()
    series: list[dict[tuple[object, ...], int]] = [{} for _ in experiments.ids]
    for row, owner in enumerate(experiments.experiment.tolist()):
        series[owner].setdefault(tuple(cells[row]), row)
    first: dict[tuple[object, ...], int] = {}
    for k, rows in enumerate(series):
        first.setdefault(tuple(rows), k)
    which, kept = np.zeros(len(series), dtype=np.bool_), np.zeros(len(cells), dtype=np.bool_)
    which[[*first.values()]] = True
    kept[[row for k in first.values() for row in series[k].values()]] = True
    return _conditions_of(experiments, which, kept, any(len(rows) > 1 for rows in first))


def conditions_at(experiments: Experiments, of: str | None, names: Collection[str]) -> Conditions:
    """The conditions of the experiments, for predictions without others.

    For new experiments they are those that differ in a column in `names`, each once. For further
    values of measured experiments they are those of the experiment `of`, or of all.
    """
    if of is None:
        return distinct_conditions(experiments, [*names])
    whole = np.ones(len(experiments.ids), dtype=np.bool_)
    own = np.array([name == of for name in experiments.ids])
    return conditions_of(experiments, own if own.any() else whole)


def first_rows(conditions: Conditions, responses: tuple[Response, ...]) -> Conditions:
    """The first row of each experiment with all columns, for other responses without conditions.

    >>> import pandas as pd
    >>> frame = pd.DataFrame({"id": ["a", "a", "b"], "load": [1, 2, 3]})
    >>> first_rows(Conditions.from_frame(frame, id="id"), (Response("x"),)).table["load"].tolist()
    [1.0, 3.0]
    """
    import pandas as pd

    first = np.unique(conditions.experiment, return_index=True)[1]
    return Conditions(
        conditions.ids,
        pd.DataFrame(index=range(len(first))),
        responses=responses,
        table=conditions.table.iloc[first].reset_index(drop=True),
        places=[conditions.places[row] for row in first.tolist()],
        id=conditions.id,
    )


def unmeasured(conditions: Conditions) -> Experiments:
    """Experiments under the given conditions whose values are all NaN, as none is measured yet."""
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
