"""Ids and conditions out of the columns of a table."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aleator.errors import ExperimentsError
from aleator.observations.tables import Table
from aleator.types import Indices

if TYPE_CHECKING:
    import pandas as pd

DEFAULT_ID = "id"


class Rows(NamedTuple):
    """R rows of a table: the ids (N,) of the experiments, and what stands in each row.

    `experiment` (R,) is the experiment of each row; `conditions` and `table` have R rows. `source`
    is the table that all of this is from; it knows the experiments now.
    """

    ids: tuple[str, ...]
    experiment: Indices
    conditions: pd.DataFrame
    table: pd.DataFrame
    source: Table


def rows_of(
    table: Table,
    id: str | None,
    names: Sequence[str] | None,
    taken: Sequence[str] = (),
    beside: Collection[str] = (),
    numbers: Collection[str] = (),
) -> Rows:
    """The rows of a table; rows with the same id are one experiment, in order of appearance.

    `taken` are columns of outcomes, which are not part of the table that is kept. Conditions are
    `names`, or every other column but those `beside`. Those in `numbers` must be numbers.

    Raises ExperimentsError for a column that is not there, a blank id, and a slip in a number.
    """
    import pandas as pd

    if id is not None:
        table.require(id, "the id")
    elif DEFAULT_ID in table.columns and DEFAULT_ID not in taken:
        id = DEFAULT_ID
    ids, experiment = _ids(table, id)
    if id is not None:
        table = replace(table, owners=[ids[k] for k in experiment])
    chosen = names is not None
    kept = [name for name in table.columns if name != id and name not in taken]
    if names is None:
        names = [name for name in kept if name not in beside]
    for name in names:
        table.require(name, "the condition")
    index = range(len(table))
    conditions = {
        name: table.numbers(name) if name in numbers else _condition(table, name, chosen)
        for name in names
    }
    whole = {name: conditions[name] if name in conditions else _any(table, name) for name in kept}
    return Rows(
        ids, experiment, pd.DataFrame(conditions, index=index),
        pd.DataFrame(whole, index=index), table,
    )  # fmt: skip


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


def _condition(table: Table, name: str, chosen: bool) -> NDArray[np.float64] | pd.Series:
    """A column of numbers, or one of objects if it is plainly not meant as numbers.

    A text in a column of numbers is a slip that must not turn the column into text: it is an error
    if most cells are numbers, and for a condition chosen by name already if one cell is.
    """
    import pandas as pd

    numbers = table.is_number(name)
    if np.any(numbers) and (chosen or 2 * int(np.sum(numbers)) >= len(numbers)):
        try:
            return table.numbers(name)
        except ExperimentsError as error:
            if chosen:
                raise
            remedy = f"{error.remedy}; or, if '{name}' is no condition, name those that are"
            raise ExperimentsError(error.problem, f"{remedy}: conditions = [...]") from None
    return pd.Series(table.columns[name], dtype=object)


def _any(table: Table, name: str) -> NDArray[np.float64] | pd.Series:
    """A column that is no condition: numbers, NaN where blank, if it has nothing else."""
    import pandas as pd

    try:
        return table.numbers_or_blank(name)
    except ExperimentsError:
        return pd.Series(table.columns[name], dtype=object)
