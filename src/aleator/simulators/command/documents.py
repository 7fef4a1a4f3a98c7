"""An outcome in a table or in a JSON document that a program wrote."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aleator.errors import SimulatorError, nearest
from aleator.simulators.command.numbers import finite, number
from aleator.simulators.command.outputs import OutputFile, Series
from aleator.simulators.failure import RunFailed


@dataclass(frozen=True)
class CsvOutput(OutputFile):
    """A cell of a table; of a series a whole column. A column by name has its header in the first
    line after `skip` lines.

    A column by number counts from 0, and the table then has no header. Rows count from 0 after the
    header, and -1 is the last; empty lines do not count. `delimiter = " "` is any white space.

    Raises SimulatorError for a delimiter of more than one character.
    """

    column: str | int = 0
    row: int = -1
    delimiter: str = ","
    skip: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.delimiter) != 1 or self.skip < 0:
            raise SimulatorError(
                f"delimiter = {self.delimiter!r}, skip = {self.skip}: no table is written so",
                'write one character, such as "," or ";" or "\\t", and skip = 0 or more lines',
            )

    def read(self, folder: Path) -> float:
        """The number in the cell."""
        rows, column = self._body(folder)
        if not -len(rows) <= self.row < len(rows):
            raise RunFailed(f"'{self.file}' has {len(rows)} rows, row {self.row} is wanted")
        return finite(self._cell(rows, self.row, column), self.file)

    def series(self, folder: Path) -> Series:
        """The numbers in the column, row by row."""
        rows, column = self._body(folder)
        return [number(self._cell(rows, k, column), self.file) for k in range(len(rows))]

    def _body(self, folder: Path) -> tuple[list[list[str]], int]:
        """The rows after the header, and which column it is."""
        rows, column = self._rows(folder), self.column
        if not isinstance(column, str):
            return rows, column
        header = [cell.strip() for cell in rows[0]] if rows else []
        if column not in header:
            raise RunFailed(
                f"'{self.file}' has no column '{column}'{nearest(column, header)}; it has "
                f"{', '.join(header[:8]) or 'no header'}"
            )
        return rows[1:], header.index(column)

    def _cell(self, rows: list[list[str]], row: int, column: int) -> str:
        cells = rows[row]
        if not -len(cells) <= column < len(cells):
            raise RunFailed(
                f"row {row} of '{self.file}' has {len(cells)} columns, column "
                f"{self.column!r} is wanted"
            )
        return cells[column].strip()

    def _rows(self, folder: Path) -> list[list[str]]:
        lines = self.text(folder).splitlines()[self.skip :]
        if self.delimiter == " ":
            return [line.split() for line in lines if line.strip()]
        try:
            rows = list(csv.reader(lines, delimiter=self.delimiter, skipinitialspace=True))
        except csv.Error as error:
            raise RunFailed(f"'{self.file}' is not a table: {error}") from None
        return [row for row in rows if row]


@dataclass(frozen=True)
class JsonOutput(OutputFile):
    """A place in a JSON document: keys and positions from 0, with points between them.

    A series has a list there, with null where there is no number.
    """

    path: str = ""

    def read(self, folder: Path) -> float:
        """The number at that place."""
        at = self._at(folder)
        if not _is_number(at):
            raise RunFailed(f"'{self.path}' in '{self.file}' is {at!r:.60}, not a number")
        return finite(str(at), self.file)

    def series(self, folder: Path) -> Series:
        """The list of numbers at that place, or one number."""
        at = self._at(folder)
        if _is_number(at):
            return number(str(at), self.file)
        if not isinstance(at, list) or not all(one is None or _is_number(one) for one in at):
            raise RunFailed(f"'{self.path}' in '{self.file}' is {at!r:.60}, not a list of numbers")
        return [number("nan" if one is None else str(one), self.file) for one in at]

    def _at(self, folder: Path) -> Any:
        try:
            at: Any = json.loads(self.text(folder))
        except ValueError as error:
            raise RunFailed(f"'{self.file}' is not JSON: {error}") from None
        for k, part in enumerate(parts := self.path.split(".")):
            place = ".".join(parts[:k]) or "its top"
            if isinstance(at, dict) and part in at:
                at = at[part]
            elif isinstance(at, list) and part.isdecimal() and int(part) < len(at):
                at = at[int(part)]
            else:
                keys = list(map(str, at)) if isinstance(at, dict) else []
                kind = f"{len(at)} entries" if isinstance(at, list) else ", ".join(keys[:8])
                raise RunFailed(
                    f"'{self.file}' has no '{part}' at {place}{nearest(part, keys)}; it has "
                    f"{kind or 'no keys'} there"
                )
        return at


def _is_number(value: Any) -> bool:
    """Whether it may be a number; as a text too, which `number` looks at."""
    return isinstance(value, (int, float, str)) and not isinstance(value, bool)
