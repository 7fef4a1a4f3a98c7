"""What the columns of a table may be: outcome, conditions, the name of an experiment, an error."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aleator.observations import tables as files
from aleator.observations.experiments import DEFAULT_ID
from aleator.observations.tables import Table
from aleator.study.roles import numbers_of, tells_bounds, varies_within
from aleator.types import Array

MANY = 5
"""Experiments from where on a column whose name does not say so may name them: of fewer values it
is rather a supplier or a bench."""
DELIMITERS = (",", ";", "\t", "|")
_COMMA = re.compile(r"^[<>≤≥]?=?\s*-?\d+,\d+$")
_ERROR = re.compile(
    r"(^|_)(sd|std|se|sem|std_?err|sigma|error|uncertainty|noise)($|_)", re.IGNORECASE
)
_NAMING = re.compile(
    r"(^|_)(id|no|nr|number|name|experiment|test|run|unit|specimen|sample|part|serial|subject|"
    r"person|patient|batch|tank|device|cell)($|_)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Sheet:
    """A delimited file as it was read, with the signs that it turned out to be written with."""

    table: Table
    delimiter: str
    decimal: str

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its columns."""
        return tuple(self.table.columns)


@dataclass(frozen=True)
class Roles:
    """What each column of a table with N rows may be, given what the simulator takes.

    `conditions` are columns that the simulator takes. `outcomes` are other columns of numbers that
    vary, within experiments if any does, `errors` those whose name says that they tell a
    measurement error. `id` is the column that names experiments, with `repeated` where rows share a
    name; None where nothing seems to.
    `constant` columns have one value, and `others` are none of all these.
    """

    conditions: tuple[str, ...]
    outcomes: tuple[str, ...]
    errors: tuple[str, ...]
    id: str | None
    repeated: bool
    constant: tuple[str, ...]
    others: tuple[str, ...]


def sheet_of(path: Path) -> Sheet:
    """Read a delimited file by the delimiter that its header has most of, and by its decimals.

    Raises ExperimentsError as `files.read` does.
    """
    try:
        header = path.read_bytes()[:10_000].decode("utf-8", "replace").partition("\n")[0]
    except OSError:
        header = ""  # `files.read` tells it
    delimiter = max(DELIMITERS, key=header.count)
    table = files.read(path, delimiter)
    cells = [str(cell) for column in table.columns.values() for cell in column]
    comma = delimiter != "," and any(_COMMA.match(cell) for cell in cells)
    return Sheet(files.read(path, delimiter, ","), delimiter, ",") if comma else Sheet(
        table, delimiter, "."
    )  # fmt: skip


def roles_in(table: Table, taken: Collection[str], outcome: Sequence[str] = ()) -> Roles:
    """The roles of the columns; `taken` are names that the simulator takes.

    The `outcome`, where it is known already, has no other role. A column names experiments if it is
    called "id", or if it is no condition, holds texts or whole numbers, and has a name that says
    so, another text in each row, the number of the row, or values that tell rows with equal
    conditions apart. Of several the finest does.
    """
    numbers = {name: numbers_of(table, name) for name in table.columns}
    distinct = {name: len({*table.texts(name)}) for name in table.columns}
    conditions = tuple(name for name in table.columns if name in taken and name not in outcome)
    left = [name for name in table.columns if name not in conditions and name not in outcome]
    naming = [name for name in left if _names_experiments(table, name, conditions, distinct)]
    chosen = (
        DEFAULT_ID if DEFAULT_ID in naming else max(naming, key=distinct.__getitem__, default="")
    )
    errors = tuple(n for n in left if _ERROR.search(n) and _positive(numbers[n]) and n != chosen)
    constant = tuple(name for name in left if distinct[name] == 1 and name != chosen)
    rest = [name for name in left if name not in (chosen, *errors, *constant)]
    measured = _measured(table, [name for name in rest if numbers[name] is not None], chosen)
    return Roles(
        conditions,
        tuple(outcome) or measured,
        errors,
        chosen or None,
        bool(chosen) and distinct[chosen] < len(table),
        constant,
        tuple(name for name in rest if outcome or name not in measured),
    )


def _measured(table: Table, numbers: list[str], id: str) -> tuple[str, ...]:
    """Of columns of numbers those that may be outcomes: of repeated rows those that vary there."""
    values = [name for name in numbers if not tells_bounds(table, name, numbers)]
    varying = [name for name in values if varies_within(table, name, id or None)]
    return tuple(varying or values)


def spread_of(table: Table, column: str, *, log: bool = False) -> float:
    """The standard deviation of the numbers of a column, or of their logarithms.

    NaN of fewer than two.
    """
    known = _known(table, column)
    if known.size < 2:
        return np.nan
    return float(np.std(np.log(known) if log else known, ddof=1))


def count_of(table: Table, id: str | None) -> int:
    """How many experiments the rows are."""
    return len(table) if id is None else len({*table.texts(id)})


def decades_of(table: Table, column: str) -> float:
    """Decades from the smallest number to the largest; zero where one is not positive."""
    known = _known(table, column)
    if known.size < 2 or known.min() <= 0.0:
        return 0.0
    return float(np.log10(known.max() / known.min()))


def _known(table: Table, column: str) -> Array:
    numbers = numbers_of(table, column)
    return np.array([]) if numbers is None else numbers[np.isfinite(numbers)]


def _positive(numbers: Array | None) -> bool:
    return numbers is not None and bool(np.all(numbers > 0.0))


def _names_experiments(
    table: Table, name: str, conditions: Sequence[str], distinct: dict[str, int]
) -> bool:
    texts = table.texts(name)
    if distinct[name] == 1 or "" in texts or not _whole_or_text(table, name):
        return False
    each_its_own = distinct[name] == len(table) and _counts_or_text(table, name)
    if name == DEFAULT_ID or _NAMING.search(name) or each_its_own:
        return True
    rows = [*zip(*(table.texts(condition) for condition in conditions), strict=True)]
    told_apart = len({*zip(texts, rows, strict=True)}) if rows else 0
    repeated = bool(rows) and len({*rows}) < len(rows)
    some = MANY <= distinct[name] <= len(table) // 2
    return some and repeated and told_apart == len(table)


def _counts_or_text(table: Table, name: str) -> bool:
    """Whether a column has texts, or numbers that count the rows."""
    numbers = numbers_of(table, name)
    return numbers is None or bool(np.all(np.diff(numbers) == 1.0))


def _whole_or_text(table: Table, name: str) -> bool:
    numbers = numbers_of(table, name)
    return numbers is None or bool(np.all(numbers == np.round(numbers)))
