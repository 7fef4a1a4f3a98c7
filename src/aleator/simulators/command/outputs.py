"""Outputs of a program: how its outcome is found in the files that it wrote."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from aleator.errors import SimulatorError, nearest
from aleator.simulators import surroundings
from aleator.simulators.command.inputs import within
from aleator.simulators.command.run import STDERR, STDOUT, read_text
from aleator.simulators.function import FunctionSimulator, load_function
from aleator.simulators.protocol import RunFailed, describe


def finite(text: str, where: str) -> float:
    """A finite number from a text, also in Fortran's notation (1.0D+3). Raises RunFailed.

    >>> finite("1.5D+03", "result.txt")
    1500.0
    """
    value = number(text, where)
    if not math.isfinite(value):
        raise RunFailed(f"the outcome in '{where}' is {text}, which is not finite")
    return value


def number(text: str, where: str) -> float:
    """A number from a text, finite or not. Raises RunFailed if it is no number.

    Values that are not finite are allowed because a series may lack values that were not measured.

    >>> number("NaN", "result.txt")
    nan
    """
    try:
        # Python accepts 1_000 as a number, but no program writes one so.
        return float(re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", text.replace("_", "?")))
    except ValueError:
        shown = f"'{text[:60]}'" if text else "empty"
        raise RunFailed(f"the outcome in '{where}' is {shown}, not a number") from None


_STREAMS = {"stdout": STDOUT, "stderr": STDERR}


def _files(folder: Path) -> list[str]:
    """The sorted names of what is in the folder of a run, without what the program printed."""
    return sorted(p.name for p in folder.iterdir() if p.name not in (STDOUT, STDERR))


def _beginning(text: str, lines: int = 3, most: int = 80) -> str:
    """The words that show how a text begins: its first lines, cut (both by judgement).

    >>> _beginning("mode,frequency\\n1,5.2\\n"), _beginning(" ")
    ('begins with "mode,frequency | 1,5.2"', 'is empty')
    """
    first = [line.strip()[:most] for line in text.strip().splitlines()[:lines]]
    return f'begins with "{" | ".join(first)}"' if first else "is empty"


class Output(Protocol):
    """Finds the outcome of a run of a program that ended successfully."""

    @property
    def file(self) -> str | None:
        """The file in the folder of the run that is read; None if it may be any file."""

    def read(self, folder: Path, series: bool) -> float | list[float]:
        """The outcome, a finite number; for a series a number for each row, or one for all rows.

        Raises RunFailed if there is no outcome.
        """

    def fingerprint(self) -> str:
        """A text that changes with every setting that may change the outcome."""


@dataclass(frozen=True)
class OutputFile:
    """An outcome that is the whole text of a file in the folder of a run.

    The names "stdout" and "stderr" stand for what the program printed. The text is only the number,
    or for a series numbers between white space. Raises SimulatorError for a name that leads out of
    the folder.
    """

    file: str = "stdout"

    def __post_init__(self) -> None:
        within(self.file, "the output file")

    def text(self, folder: Path) -> str:
        """The text of the file; raises RunFailed if there is no such file."""
        path = folder / _STREAMS.get(self.file, self.file)
        try:
            return read_text(path)
        except OSError as error:
            if surroundings.cause(error):
                raise
            wrote = _files(folder)
            what = "wrote no file" if isinstance(error, FileNotFoundError) else "left unreadable"
            raise RunFailed(
                f"it {what} '{self.file}'{nearest(self.file, wrote)}; its folder holds "
                f"{', '.join(wrote[:8]) or 'nothing'}"
            ) from None

    def read(self, folder: Path, series: bool) -> float | list[float]:
        """The number in the file, or all numbers of a series.

        Where the text has no such number, the message shows how the text begins, and which files
        the folder of the run holds.
        """
        text = self.text(folder)
        try:
            return self.outcome(text, series)
        except RunFailed as fault:
            held = ", ".join(name for name in _files(folder)[:8] if name != self.file)
            raise RunFailed(
                f"{fault.message}; '{self.file}' {_beginning(text)}"
                f"{f'; the folder of the run holds {held} too' if held else ''}"
            ) from None

    def outcome(self, text: str, series: bool) -> float | list[float]:
        """The number in the text of the file, or all numbers of a series; raises RunFailed."""
        if series:
            return [number(one, self.file) for one in self.every(text)]
        return finite(self.one(text), self.file)

    def one(self, text: str) -> str:
        """The part of the file's text that is the outcome."""
        return text.strip()

    def every(self, text: str) -> list[str]:
        """The parts of the file's text that are the values of a series."""
        return text.split()

    def fingerprint(self) -> str:
        """A text with all settings of this output."""
        return repr(self)


@dataclass(frozen=True)
class RegexOutput(OutputFile):
    """An outcome that a regular expression with one group finds in a file.

    `match` is the number of the match that counts: 0 is the first, -1 the last. `^` and `$` match
    at every line. For a series every match is a number.

    Raises SimulatorError for an invalid expression, and unless it has exactly one group.
    """

    regex: str = r"(\S+)"
    match: int = -1

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            groups = re.compile(self.regex).groups
        except re.error as error:
            raise SimulatorError(
                f"the regex {self.regex!r} is wrong: {error}",
                "in TOML write it between single quotes: 'time = (\\S+)'",
            ) from None
        if groups != 1:
            raise SimulatorError(
                f"the regex {self.regex!r} has {groups} groups in parentheses instead of one",
                "put the number in parentheses, and write (?:...) for other groups",
            )

    def one(self, text: str) -> str:
        """The text of the group in match number `match`."""
        found = self.every(text)
        if not -len(found) <= self.match < len(found):
            raise RunFailed(
                f"the regex {self.regex!r} matches {len(found)} times in '{self.file}', "
                f"match {self.match} is needed"
                if found
                else f"the regex {self.regex!r} matches nothing in '{self.file}'"
            )
        return found[self.match]

    def every(self, text: str) -> list[str]:
        """The texts of the group in all matches."""
        return re.findall(self.regex, text, re.MULTILINE)


@dataclass(frozen=True)
class HookOutput:
    """An outcome that a Python function "module.py:name" of the user finds.

    It is called as `function(folder: Path, stdout: str) -> float`. For a series it returns an array
    with a number for each row, or one number. The reference is relative to the folder `base`.
    Raises SimulatorError if there is no such function.
    """

    reference: str
    base: Path = Path(".")

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", self.base.absolute())
        load_function(self.reference, self.base)

    @property
    def file(self) -> None:
        """None, because the function may read any file."""

    def read(self, folder: Path, series: bool) -> float | list[float]:
        """The number that the user's function returns, or the numbers of a series."""
        function = load_function(self.reference, self.base)
        try:
            found = function(folder, read_text(folder / STDOUT))
        except Exception as error:
            raise RunFailed(f"the output hook {self.reference} raised {describe(error)}") from error
        if not series and isinstance(found, (bool, str, bytes)):
            raise self._wrong(found, "a number")
        try:
            values = np.asarray(found, dtype=np.float64) if series else np.float64(float(found))
        except (TypeError, ValueError, OverflowError):
            raise self._wrong(found, "an array of numbers" if series else "a number") from None
        if values.ndim > 1:
            raise self._wrong(found, "a number for each row")
        if not series:
            return finite(repr(float(values)), f"the output hook {self.reference}")
        listed: float | list[float] = values.tolist()
        return listed

    def _wrong(self, found: object, kind: str) -> RunFailed:
        return RunFailed(f"the output hook {self.reference} returned {found!r:.60}, not {kind}")

    def fingerprint(self) -> str:
        """A hash of the function's source and of the modules beside it."""
        return FunctionSimulator(load_function(self.reference, self.base)).fingerprint()


@dataclass(frozen=True)
class CsvOutput(OutputFile):
    """An outcome that is a cell of a table in a file, or for a series a whole column.

    A `column` that is a name is looked up in the header, which is the first line after `skip`
    lines. A column that is a number counts from 0, and the table then has no header. Rows count
    from 0 after the header, and -1 is the last; empty lines do not count. The `delimiter` " " means
    any white space.

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

    def one(self, text: str) -> str:
        """The text in the cell of the table."""
        rows, column = self._body(text)
        if not -len(rows) <= self.row < len(rows):
            raise RunFailed(f"'{self.file}' has {len(rows)} rows, row {self.row} is needed")
        return self._cell(rows, self.row, column)

    def every(self, text: str) -> list[str]:
        """The texts in all cells of the column, row by row."""
        rows, column = self._body(text)
        return [self._cell(rows, k, column) for k in range(len(rows))]

    def _body(self, text: str) -> tuple[list[list[str]], int]:
        """The rows of the table after its header, and the position of the column."""
        lines, column = text.splitlines()[self.skip :], self.column
        try:
            rows = [
                row
                for row in (
                    map(str.split, lines)
                    if self.delimiter == " "
                    else csv.reader(lines, delimiter=self.delimiter, skipinitialspace=True)
                )
                if row
            ]
        except csv.Error as error:
            raise RunFailed(f"'{self.file}' is not a table: {error}") from None
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
                f"{self.column!r} is needed"
            )
        return cells[column].strip()


@dataclass(frozen=True)
class JsonOutput(OutputFile):
    """An outcome in a JSON file, at a path of keys and positions (from 0) separated by points.

    For a series there is a list at that path, with null for a missing number.
    """

    path: str = ""

    def outcome(self, text: str, series: bool) -> float | list[float]:
        """The number at that path, or the list of numbers of a series; raises RunFailed."""
        at = self._at(text)
        if _is_number(at):
            return (number if series else finite)(str(at), self.file)
        if series and isinstance(at, list) and all(one is None or _is_number(one) for one in at):
            return [number("nan" if one is None else str(one), self.file) for one in at]
        kind = "a list of numbers" if series else "a number"
        raise RunFailed(f"'{self.path}' in '{self.file}' is {at!r:.60}, not {kind}")

    def _at(self, text: str) -> Any:
        try:
            at: Any = json.loads(text)
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
                inner = next(_paths(at, part), "")
                inner = f"; there is one at '{'.'.join([*parts[:k], inner])}'" if inner else ""
                raise RunFailed(
                    f"'{self.file}' has no '{part}' at {place}{nearest(part, keys)}; it has "
                    f"{kind or 'no keys'} there{inner}"
                )
        return at


def _paths(value: Any, key: str) -> Iterator[str]:
    """The paths of a key inside a JSON value, those in outer objects first.

    >>> [*_paths({"result": {"cycles": 4.0}}, "cycles")]
    ['result.cycles']
    """
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    parts = [(str(name), part) for name, part in inner]
    yield from (name for name, _ in parts if name == key)
    for name, part in parts:
        if isinstance(part, dict | list):
            yield from (f"{name}.{path}" for path in _paths(part, key))


def _is_number(value: Any) -> bool:
    """Whether a JSON value is a number, or a text that may stand for one."""
    return isinstance(value, (int, float, str)) and not isinstance(value, bool)
