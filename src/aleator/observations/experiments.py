"""The table of experiments: an id, the conditions, and what was measured."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from aleator.errors import ExperimentsError
from aleator.observations import tables
from aleator.observations import tables as files
from aleator.observations.experiments import Conditions as Conditions
from aleator.observations.experiments import TableRows, check_sizes, rows_of
from aleator.observations.outcomes import Censored, OutcomeColumns
from aleator.observations.responses import Observations, Transform
from aleator.observations.tables import Table, real_numbers
from aleator.types import Array, Flags, Indices

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, init=False)
class Experiments:
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

    ids: tuple[str, ...]
    conditions: pd.DataFrame
    table: pd.DataFrame
    experiment: Indices
    places: Sequence[str]
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
        experiment = np.arange(len(ids)) if experiment is None else np.array(experiment, np.intp)
        table = conditions if table is None else table
        check_sizes(ids, conditions, experiment)
        if not isinstance(outcomes, Observations):
            outcomes = _simple(outcomes, len(ids), outcome_name, Transform.named(transform))
        values = {
            "ids": ids, "conditions": conditions, "table": table, "experiment": experiment,
            "observations": outcomes,
            "places": [f"experiment '{ids[k]}'" for k in experiment] if places is None else places,
        }  # fmt: skip
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.ids)

    def only(self, which: Flags) -> Experiments:
        """The same experiments with some of the observations (M,)."""
        return self.with_observations(self.observations.only(which))

    def with_observations(self, seen: Observations) -> Experiments:
        """The same experiments where something else was observed."""
        return Experiments(
            self.ids, self.conditions, seen,
            table=self.table, experiment=self.experiment, places=self.places,
        )  # fmt: skip

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
        found = {response.transform for response in self.observations.responses}
        return found.pop() if len(found) == 1 else Transform.NONE

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
        table = files.read(path, delimiter, decimal)
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
        rows: TableRows = rows_of(table, id, names, outcomes.taken, beside)
        return cls(
            rows.ids, rows.conditions, outcomes.read(rows.source, rows.experiment),
            table=rows.table, experiment=rows.experiment, places=rows.source.rows,
        )  # fmt: skip


def unmeasured(conditions: Conditions) -> Experiments:
    """The experiments of these conditions, of which nothing is measured: every value is NaN."""
    return Experiments(
        conditions.ids, conditions.conditions, conditions.observations,
        table=conditions.table, experiment=conditions.experiment, places=conditions.places,
    )  # fmt: skip


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
