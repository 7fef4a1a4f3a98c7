"""Where a program's outcome is found in what it wrote."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from aleator.errors import SimulatorError, nearest
from aleator.simulators import surroundings
from aleator.simulators.command.child import STDERR, STDOUT, read_text
from aleator.simulators.command.feeds import within
from aleator.simulators.command.numbers import finite, number
from aleator.simulators.failure import RunFailed, describe
from aleator.simulators.function import FunctionSimulator
from aleator.simulators.loading import load_function

_STREAMS = {"stdout": STDOUT, "stderr": STDERR}


Series = float | list[float]
"""The outcome of a series: a number for each row, or one for all of them."""


class Output(Protocol):
    """Finds the outcome of a run that ended well."""

    @property
    def file(self) -> str | None:
        """The file that it reads, in the folder of the run; None where it is not known."""

    def read(self, folder: Path) -> float:
        """The outcome; raises RunFailed where there is none."""

    def series(self, folder: Path) -> Series:
        """The outcome of a whole experiment; raises RunFailed where there is none."""

    def fingerprint(self) -> str:
        """A text that changes when another number may be found."""


@dataclass(frozen=True)
class OutputFile:
    """A file in the folder of a run, or what was printed: "stdout" or "stderr".

    As it is: the file holds nothing but the number, or for a series numbers between white space.
    Raises SimulatorError for a name that leads
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
            if surroundings.cause(error):
                raise
            wrote = [p.name for p in folder.iterdir() if p.name not in (STDOUT, STDERR)]
            what = "wrote no file" if isinstance(error, FileNotFoundError) else "left unreadable"
            raise RunFailed(
                f"it {what} '{self.file}'{nearest(self.file, wrote)}; its folder holds "
                f"{', '.join(sorted(wrote)[:8]) or 'nothing'}"
            ) from None

    def read(self, folder: Path) -> float:
        """The number that the file holds."""
        return finite(self.text(folder).strip(), self.file)

    def series(self, folder: Path) -> Series:
        """The numbers that the file holds."""
        return [number(text, self.file) for text in self.text(folder).split()]

    def fingerprint(self) -> str:
        """Every choice by name."""
        return repr(self)


@dataclass(frozen=True)
class RegexOutput(OutputFile):
    """The one group of a regular expression; `match` counts from 0, and -1 is the last.

    `^` and `$` match at every line. Of a series every match is a number.

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
        return finite(found[self.match], self.file)

    def series(self, folder: Path) -> Series:
        """The numbers in the group of every match."""
        found = re.findall(self.regex, self.text(folder), re.MULTILINE)
        return [number(text, self.file) for text in found]


@dataclass(frozen=True)
class HookOutput:
    """A Python function "module.py:name": its folder and what it printed to the outcome.

    It is called as `function(folder: Path, stdout: str) -> float`; for a series it returns an array
    of a number for each row, or a number. `base` is the folder that the
    reference is relative to. Raises SimulatorError if there is no such function.
    """

    reference: str
    base: Path = Path(".")

    def __post_init__(self) -> None:
        object.__setattr__(self, "base", self.base.absolute())
        load_function(self.reference, self.base)

    @property
    def file(self) -> None:
        """Not known: the function opens what it needs."""

    def read(self, folder: Path) -> float:
        """What the function returns."""
        found = self._called(folder)
        if isinstance(found, (bool, str, bytes)):
            raise self._wrong(found, "a number")
        try:
            value = float(found)
        except (TypeError, ValueError, OverflowError):
            raise self._wrong(found, "a number") from None
        return finite(repr(value), f"the output hook {self.reference}")

    def series(self, folder: Path) -> Series:
        """What the function returns."""
        found = self._called(folder)
        try:
            values = np.asarray(found, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise self._wrong(found, "an array of numbers") from None
        if values.ndim > 1:
            raise self._wrong(found, "a number for each row")
        listed: Series = values.tolist()
        return listed

    def _called(self, folder: Path) -> Any:
        function = load_function(self.reference, self.base)
        try:
            return function(folder, read_text(folder / STDOUT))
        except Exception as error:
            raise RunFailed(f"the output hook {self.reference} raised {describe(error)}") from error

    def _wrong(self, found: object, wanted: str) -> RunFailed:
        return RunFailed(f"the output hook {self.reference} returned {found!r:.60}, not {wanted}")

    def fingerprint(self) -> str:
        """The hash of the function's source and of the modules beside it."""
        return FunctionSimulator(load_function(self.reference, self.base)).fingerprint()
