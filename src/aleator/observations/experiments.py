"""The table of experiments: an id, the conditions and the measured outcome of each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from aleator.errors import ExperimentsError
from aleator.observations import tables
from aleator.observations.tables import Table
from aleator.observations.transform import Transform

if TYPE_CHECKING:
    import pandas as pd

DEFAULT_ID = "id"


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions of N experiments without outcomes: what a prediction is asked for.

    `ids` (N,) are distinct texts, `conditions` has N rows and a named column for each condition:
    float64 where every cell is a number, else objects. `transform` is that of the identification.

    Raises ExperimentsError if the sizes differ or an id appears twice.

    >>> import pandas as pd
    >>> Conditions(("a", "b"), pd.DataFrame({"ratio": [0.9, 0.8]})).ids
    ('a', 'b')
    """

    ids: tuple[str, ...]
    conditions: pd.DataFrame
    transform: Transform = Transform.NONE

    def __post_init__(self) -> None:
        object.__setattr__(self, "transform", Transform.named(self.transform))
        _check_sizes(self.ids, self.conditions)

    @classmethod
    def from_frame(
        cls,
        frame: pd.DataFrame,
        *,
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        transform: str = Transform.NONE,
    ) -> Conditions:
        """Take `conditions` (default: every column but the id) from a data frame.

        Raises ExperimentsError as Experiments.from_frame does.

        >>> import pandas as pd
        >>> Conditions.from_frame(pd.DataFrame({"ratio": [0.9, 0.8]})).ids
        ('1', '2')
        """
        table = tables.from_frame(frame)
        return cls(*_conditions(table, id, conditions, ()), Transform.named(transform))

    @classmethod
    def from_csv(
        cls,
        path: str | Path,
        *,
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        numbers: Collection[str] = (),
        transform: str = Transform.NONE,
        delimiter: str = ",",
        decimal: str = ".",
    ) -> Conditions:
        """Take `conditions` (default: every column but the id) from a delimited file.

        Those named in `numbers` must be numbers; the others may be text.
        Raises ExperimentsError as Experiments.from_csv does.
        """
        table = tables.read(path, delimiter, decimal)
        return cls(*_conditions(table, id, conditions, (), numbers), Transform.named(transform))


@dataclass(frozen=True, eq=False)
class Experiments:
    """N experiments: conditions and measured outcomes.

    `ids` (N,) are distinct texts; `conditions` has N rows and a named column for each condition,
    float64 where every cell is a number, else objects; `outcomes` (N,) are finite and are what the
    likelihood sees, that is after the `transform` ("none" or "log"); `measured` is the original.

    Raises ExperimentsError if the sizes differ, an id appears twice or an outcome is not finite.

    >>> import pandas as pd
    >>> table = pd.DataFrame({"ratio": [0.95, 0.9], "kilocycles": [0.037, 0.2]})
    >>> experiments = Experiments.from_frame(table, outcome="kilocycles", transform="log")
    >>> experiments.ids, experiments.outcomes.round(3).tolist()
    (('1', '2'), [-3.297, -1.609])
    """

    ids: tuple[str, ...]
    conditions: pd.DataFrame
    outcomes: NDArray[np.float64]
    outcome_name: str = "outcome"
    transform: Transform = Transform.NONE

    def __post_init__(self) -> None:
        object.__setattr__(self, "transform", Transform.named(self.transform))
        _check_sizes(self.ids, self.conditions)
        outcomes = np.array(self.outcomes, dtype=np.float64)
        if outcomes.shape != (len(self.ids),) or not np.all(np.isfinite(outcomes)):
            raise ExperimentsError(
                f"outcomes of shape {outcomes.shape} for {len(self.ids)} experiments, "
                f"{np.sum(~np.isfinite(outcomes))} of them not finite",
                "give one finite outcome for each experiment",
            )
        outcomes.setflags(write=False)
        object.__setattr__(self, "outcomes", outcomes)

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def measured(self) -> NDArray[np.float64]:
        """The outcomes (N,) in their original unit, before the transform."""
        return self.transform.inverse(self.outcomes)

    @classmethod
    def from_frame(
        cls,
        frame: pd.DataFrame,
        *,
        outcome: str,
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        transform: str = Transform.NONE,
    ) -> Experiments:
        """Take the `outcome`, the `id` and the `conditions` from the columns of a data frame.

        `id` defaults to the column "id" if there is one, else to the numbers 1..N; `conditions` to
        every other column; `transform` "log" takes the logarithm of outcomes that are positive.

        Raises ExperimentsError with row and column for: a missing column, a blank, a text, NaN or
        an infinity where a number is needed, an id that appears twice, the logarithm of an
        outcome <= 0.

        >>> import pandas as pd
        >>> frame = pd.DataFrame({"id": ["a", "b"], "load": [1, 2], "time": [0.8, 0.9]})
        >>> Experiments.from_frame(frame, outcome="time").conditions.columns.tolist()
        ['load']
        """
        scale = Transform.named(transform)
        return cls._from_table(tables.from_frame(frame), outcome, id, conditions, scale)

    @classmethod
    def from_csv(
        cls,
        path: str | Path,
        *,
        outcome: str,
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        transform: str = Transform.NONE,
        delimiter: str = ",",
        decimal: str = ".",
    ) -> Experiments:
        """Take the `outcome`, the `id` and the `conditions` from the columns of a delimited file.

        Defaults as in `from_frame`. Text is UTF-8 or UTF-16, the first row names the columns.

        Raises ExperimentsError as `from_frame` does, with the row as a spreadsheet counts it (the
        header is row 1), and for a file that is absent, empty, no text, or differently delimited.
        """
        table = tables.read(path, delimiter, decimal)
        return cls._from_table(table, outcome, id, conditions, Transform.named(transform))

    @classmethod
    def _from_table(
        cls,
        table: Table,
        outcome: str,
        id: str | None,
        names: Sequence[str] | None,
        transform: Transform,
    ) -> Experiments:
        table.require(outcome, "the outcome")
        if names is not None and outcome in names:
            raise ExperimentsError(
                f"{table.source}: '{outcome}' is both the outcome and a condition",
                "leave it out of the conditions: a simulator must not know the measured outcome",
            )
        ids, conditions = _conditions(table, id, names, (outcome,))
        measured = table.numbers(outcome)
        outcomes = transform(measured)
        lost = np.flatnonzero(~np.isfinite(outcomes))
        if lost.size:
            row = int(lost[0])
            raise ExperimentsError(
                f"{table.where(row, outcome)}: {transform.fault(measured[row])}",
                f'correct the outcome, or leave out transform = "{transform}"',
            )
        return cls(ids, conditions, outcomes, outcome, transform)


def _check_sizes(ids: tuple[str, ...], conditions: pd.DataFrame) -> None:
    if len(ids) != len(conditions):
        raise ExperimentsError(
            f"{len(ids)} ids for {len(conditions)} rows of conditions", "give one id a row"
        )
    if len(set(ids)) != len(ids):
        twice = next(name for k, name in enumerate(ids) if name in ids[:k])
        raise ExperimentsError(f"the id '{twice}' appears twice", "give each experiment its own id")


def _conditions(
    table: Table,
    id: str | None,
    names: Sequence[str] | None,
    taken: tuple[str, ...],
    numbers: Collection[str] = (),
) -> tuple[tuple[str, ...], pd.DataFrame]:
    """Ids and conditions of a table; `taken` are columns that are not conditions by default."""
    if id is not None:
        table.require(id, "the id")
    elif DEFAULT_ID in table.columns and DEFAULT_ID not in taken:
        id = DEFAULT_ID
    ids = tuple(str(k) for k in range(1, len(table.places) + 1)) if id is None else _ids(table, id)
    chosen = names is not None
    if names is None:
        names = [name for name in table.columns if name not in (id, *taken)]
    for name in names:
        table.require(name, "the condition")
    columns = {
        name: table.numbers(name) if name in numbers else _condition(table, name, chosen)
        for name in names
    }
    import pandas as pd

    return ids, pd.DataFrame(columns, index=range(len(ids)))


def _ids(table: Table, column: str) -> tuple[str, ...]:
    first: dict[str, int] = {}
    for row, cell in enumerate(table.columns[column]):
        whole = isinstance(cell, float) and cell.is_integer()
        name = str(int(cell)) if isinstance(cell, float) and whole else str(cell).strip()
        if name in ("", "nan", "None", "<NA>"):
            raise ExperimentsError(
                f"{table.where(row, column)}: the id is blank",
                "write an id, or delete the column: the experiments are then numbered",
            )
        if name in first:
            raise ExperimentsError(
                f"{table.where(row, column)}: the id '{name}' appears already in "
                f"{table.places[first[name]]}",
                "give each experiment its own id, or delete the column: they are then numbered",
            )
        first[name] = row
    return tuple(first)


def _condition(table: Table, name: str, chosen: bool) -> NDArray[np.float64] | pd.Series:
    """A column of numbers, or one of objects if it is plainly not meant as numbers.

    A text in a column of numbers is a slip that must not turn the column into text: it is an error
    if most cells are numbers, and for a condition chosen by name already if one cell is.
    """
    import pandas as pd

    numbers = table.is_number(name)
    if np.any(numbers) and (chosen or 2 * int(np.sum(numbers)) >= len(numbers)):
        return table.numbers(name)
    return pd.Series(table.columns[name], dtype=object)
