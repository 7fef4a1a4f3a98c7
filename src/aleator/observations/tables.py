"""A table as cells that know their row and column.

What is wrong with a cell is told with its place, the offending text and what to do about it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aleator.errors import ExperimentsError, nearest
from aleator.observations.tables import (
    bound_of,
    has_decimal_comma,
    is_blank,
    number_of,
    outcome_remedy,
    remedy,
    text_of,
)

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Table:
    """Columns of cells, each cell a text or a Python value, with the place of each row.

    `source` names the file or the frame, `columns` has one list of N cells a name, `places` (N,)
    says where each row stands, `decimal` is the decimal sign of the numbers in the text. `owners`
    (N,) are the ids of the rows' experiments, as far as they are known already. `units` are those
    that heads of columns state.

    >>> table = Table("a.csv", {"ratio": ["0.95", "0.9"]}, ("row 2", "row 3"))
    >>> table.numbers("ratio").tolist()
    [0.95, 0.9]
    """

    source: str
    columns: Mapping[str, Sequence[object] | NDArray[Any]]
    places: Sequence[str]
    decimal: str = "."
    owners: Sequence[str] = ()
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.places)

    def require(self, name: str, role: str) -> None:
        """Raise ExperimentsError unless the column `name` is there; `role` says what it is for."""
        if name not in self.columns:
            known = ", ".join(f"'{column}'" for column in self.columns)
            lower = {column.lower(): column for column in self.columns}
            raise ExperimentsError(
                f"{self.source}: {role} '{name}' is not a column"
                f"{nearest(lower.get(name.lower(), name), self.columns)}",
                f"the columns are {known}",
            )

    def where(self, row: int, column: str) -> str:
        """The place of a cell in words: file, row, column, experiment."""
        of = f" of experiment '{self.owners[row]}'" if self.owners else ""
        return f"{self.source}: {self.places[row]}, column '{column}'{of}"

    @property
    def rows(self) -> Sequence[str]:
        """The place of each row in words: file, row."""
        return _Rows(self.source, self.places)

    def is_number(self, column: str) -> NDArray[np.bool_]:
        """Which of the N cells of a column are, or look like, finite numbers, bool (N,)."""
        cells = self.columns[column]
        if _at_once(cells, self.decimal) is not None:
            return np.ones(len(self), dtype=bool)
        return np.array(
            [number_of(cell, self.decimal)[1] == "" or has_decimal_comma(cell) for cell in cells]
        )

    def is_blank(self, column: str) -> NDArray[np.bool_]:
        """Which of the N cells of a column hold nothing, bool (N,); NaN is nothing in a frame."""
        cells = self.columns[column]
        if isinstance(cells, np.ndarray):
            return np.asarray(np.isnan(cells))
        return np.array([is_blank(cell) for cell in cells])

    def texts(self, column: str) -> list[str]:
        """The N cells of a column as stripped texts, "" where a cell holds nothing."""
        cells = self.columns[column]
        return ["" if is_blank(cell) else text_of(cell) for cell in cells]

    def numbers(self, column: str) -> NDArray[np.float64]:
        """The N numbers of a column, float64 (N,), all finite.

        Raises ExperimentsError with the place of the first cell that is not a finite number.
        """
        cells = self.columns[column]
        found = _at_once(cells, self.decimal)
        if found is not None:
            return found
        numbers = np.empty(len(self.places))
        for row, cell in enumerate(cells):
            numbers[row], fault = number_of(cell, self.decimal)
            if fault:
                raise ExperimentsError(f"{self.where(row, column)}: {fault}", remedy(cell))
        return numbers

    def numbers_or_blank(self, column: str) -> NDArray[np.float64]:
        """The N numbers of a column, float64 (N,), NaN where the cell holds nothing.

        Raises ExperimentsError as `numbers` does for every other cell.
        """
        cells = self.columns[column]
        found = _at_once(cells, self.decimal)
        if found is not None:
            return found
        numbers = np.full(len(self.places), np.nan)
        for row, cell in enumerate(cells):
            if is_blank(cell):
                continue
            numbers[row], fault = number_of(cell, self.decimal)
            if fault:
                raise ExperimentsError(f"{self.where(row, column)}: {fault}", outcome_remedy(cell))
        return numbers

    def bounds(self, column: str) -> tuple[NDArray[np.float64], NDArray[np.int_]]:
        """The N numbers of a column and their signs: 1 for "> 20", -1 for "< 0.5", else 0.

        NaN where the cell holds nothing. Raises ExperimentsError for every other cell.
        """
        cells = self.columns[column]
        numbers, signs = np.full(len(self), np.nan), np.zeros(len(self), dtype=int)
        for row, cell in enumerate(cells):
            if is_blank(cell):
                continue
            numbers[row], signs[row], fault = bound_of(cell, self.decimal)
            if fault:
                raise ExperimentsError(f"{self.where(row, column)}: {fault}", remedy(cell))
        return numbers, signs


class _Rows(Sequence[str]):
    """The places of rows with their source, worded when they are asked for."""

    def __init__(self, source: str, places: Sequence[str]) -> None:
        self.source, self.places = source, places

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, row: int) -> str:  # type: ignore[override]
        return f"{self.source}: {self.places[row]}"


def _at_once(cells: Sequence[object] | NDArray[Any], decimal: str) -> NDArray[np.float64] | None:
    """The numbers of a column that is nothing but finite numbers, else None: columns are long."""
    if not isinstance(cells, np.ndarray):
        plain = decimal == "." and all(type(cell) is str and "_" not in cell for cell in cells)
        if not plain:
            return None
    try:
        numbers = np.array(cells, dtype=np.float64)
    except ValueError:
        return None
    return numbers if np.all(np.isfinite(numbers)) else None


def from_frame(frame: pd.DataFrame) -> Table:
    """The table of a data frame; a row's place is its position from 1, and its label.

    Raises ExperimentsError for no rows, no columns or a column name that appears twice.

    >>> import pandas as pd
    >>> from_frame(pd.DataFrame({"v": [1.0]}, index=["first"])).places[0]
    "row 1 (index 'first')"
    """
    source = "the data frame"
    names = [str(name) for name in frame.columns]
    check_header(names, source)
    if frame.empty:
        raise ExperimentsError(f"{source} has no rows", "give one row for each experiment")
    return Table(
        source, {n: _cells(frame.iloc[:, k]) for k, n in enumerate(names)}, _Labels(frame.index)
    )


def _cells(column: pd.Series) -> list[object] | NDArray[Any]:
    """An array of numbers as it is, which is fast; else the cells."""
    plain = isinstance(column.dtype, np.dtype) and column.dtype.kind in "fiu"
    return column.to_numpy() if plain else column.tolist()


class _Labels(Sequence[str]):
    """The places of a frame's rows, worded when they are asked for: a frame may have millions."""

    def __init__(self, labels: pd.Index) -> None:
        self.labels = labels

    def __len__(self) -> int:
        return len(self.labels)

    def __getitem__(self, row: int) -> str:  # type: ignore[override]
        return f"row {row + 1} (index {self.labels[row : row + 1].tolist()[0]!r})"


def check_header(header: Sequence[str], source: str) -> None:
    """Raise ExperimentsError for no columns, a column without a name, and a name used twice."""
    if not header:
        raise ExperimentsError(f"{source} has no columns", "name the columns in the first row")
    for k, name in enumerate(header):
        if not name:
            raise ExperimentsError(
                f"{source}: row 1: column {k + 1} has no name",
                "name it in the header, or delete it",
            )
        if name in header[:k]:
            raise ExperimentsError(
                f"{source}: row 1: the column name '{name}' appears twice "
                f"(columns {header.index(name) + 1} and {k + 1})",
                "give each column its own name",
            )
