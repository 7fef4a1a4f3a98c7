"""Where a program's outcome is found in what it wrote."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from aleator.errors import SimulatorError, nearest
from aleator.simulators.command.child import STDERR, STDOUT, read_text
from aleator.simulators.command.feeds import within
from aleator.simulators.failure import RunFailed, describe
from aleator.simulators.function import FunctionSimulator
from aleator.simulators.loading import load_function

_STREAMS = {"stdout": STDOUT, "stderr": STDERR}


class Output(Protocol):
    """Finds the outcome of a run that ended well."""

    @property
    def file(self) -> str | None:
        """The file that it reads, in the folder of the run; None where it is not known."""

    def read(self, folder: Path) -> float:
        """The outcome; raises RunFailed where there is none."""

    def fingerprint(self) -> str:
        """A text that changes when another number may be found."""


@dataclass(frozen=True)
class OutputFile:
    """A file in the folder of a run, or what was printed: "stdout" or "stderr".

    As it is: the file holds nothing but the number. Raises SimulatorError for a name that leads
    out of the folder.
    """

    file: str = "stdout"

    def __post_init__(self) -> None:
        within(self.file, "the output file")

    def text(self, folder: Path) -> str:
        """What the file holds; raises RunFailed if there is no such file."""
        path = folder / _STREAMS.get(self.file, self.file)
        try:
            return read_text(path)
        except OSError as error:
            wrote = [p.name for p in folder.iterdir() if p.name not in (STDOUT, STDERR)]
            what = "wrote no file" if isinstance(error, FileNotFoundError) else "left unreadable"
            raise RunFailed(
                f"it {what} '{self.file}'{nearest(self.file, wrote)}; its folder holds "
                f"{', '.join(sorted(wrote)[:8]) or 'nothing'}"
            ) from None

    def read(self, folder: Path) -> float:
        """The number that the file holds."""
        return number(self.text(folder).strip(), self.file)

    def fingerprint(self) -> str:
        """Every choice by name."""
        return repr(self)


@dataclass(frozen=True)
class RegexOutput(OutputFile):
    """The one group of a regular expression; `match` counts from 0, and -1 is the last.

    `^` and `$` match at every line.

    Raises SimulatorError for an expression that is wrong or does not have exactly one group.
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

    def read(self, folder: Path) -> float:
        """The number in the group."""
        found = re.findall(self.regex, self.text(folder), re.MULTILINE)
        if not -len(found) <= self.match < len(found):
            raise RunFailed(
                f"the regex {self.regex!r} matches {len(found)} times in '{self.file}', "
                f"match {self.match} is wanted"
                if found
                else f"the regex {self.regex!r} matches nothing in '{self.file}'"
            )
        return number(found[self.match], self.file)


@dataclass(frozen=True)
class CsvOutput(OutputFile):
    """A cell of a table. A column by name has its header in the first line after `skip` lines.

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
        rows, column = self._rows(folder), self.column
        if isinstance(column, str):
            header = [cell.strip() for cell in rows[0]] if rows else []
            if column not in header:
                raise RunFailed(
                    f"'{self.file}' has no column '{column}'{nearest(column, header)}; it has "
                    f"{', '.join(header[:8]) or 'no header'}"
                )
            column, rows = header.index(column), rows[1:]
        if not -len(rows) <= self.row < len(rows):
            raise RunFailed(f"'{self.file}' has {len(rows)} rows, row {self.row} is wanted")
        cells = rows[self.row]
        if not -len(cells) <= column < len(cells):
            raise RunFailed(
                f"row {self.row} of '{self.file}' has {len(cells)} columns, column "
                f"{self.column!r} is wanted"
            )
        return number(cells[column].strip(), self.file)

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
    """A place in a JSON document: keys and positions from 0, with points between them."""

    path: str = ""

    def read(self, folder: Path) -> float:
        """The number at that place."""
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
        if isinstance(at, bool) or not isinstance(at, (int, float, str)):
            raise RunFailed(f"'{self.path}' in '{self.file}' is {at!r:.60}, not a number")
        return number(str(at), self.file)


@dataclass(frozen=True)
class HookOutput:
    """A Python function "module.py:name": its folder and what it printed to one number.

    It is called as `function(folder: Path, stdout: str) -> float`. `base` is the folder that the
    reference is relative to. Raises SimulatorError if there is no such function.
    """

    reference: str
    base: Path = Path(".")

    def __post_init__(self) -> None:
        load_function(self.reference, self.base)

    @property
    def file(self) -> None:
        """Not known: the function opens what it needs."""

    def read(self, folder: Path) -> float:
        """What the function returns."""
        function = load_function(self.reference, self.base)
        try:
            found = function(folder, read_text(folder / STDOUT))
        except Exception as error:
            raise RunFailed(f"the output hook {self.reference} raised {describe(error)}") from error
        wrong = f"the output hook {self.reference} returned {found!r:.60}, not a number"
        if isinstance(found, (bool, str, bytes)):
            raise RunFailed(wrong)
        try:
            value = float(found)
        except (TypeError, ValueError, OverflowError):
            raise RunFailed(wrong) from None
        return number(repr(value), f"the output hook {self.reference}")

    def fingerprint(self) -> str:
        """The hash of the function's source and of the modules beside it."""
        return FunctionSimulator(load_function(self.reference, self.base)).fingerprint()


def number(text: str, where: str) -> float:
    """A finite number as programs write it; Fortran's 1.0D+3 too. Raises RunFailed.

    >>> number("1.5D+03", "result.txt")
    1500.0
    """
    try:
        # Python would take 1_000 for a number, which is no program's way of writing one.
        value = float(re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", text.replace("_", "?")))
    except ValueError:
        shown = f"'{text[:60]}'" if text else "empty"
        raise RunFailed(f"the outcome in '{where}' is {shown}, not a number") from None
    if value != value or value in (float("inf"), float("-inf")):
        raise RunFailed(f"the outcome in '{where}' is {text}, which is not finite")
    return value
