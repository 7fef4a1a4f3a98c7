"""What a program reads: a template filled in, or all names and values as JSON or CSV."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Protocol, cast

from aleator.errors import SimulatorError, nearest
from aleator.simulators.command.placeholders import BRACES, Columns, Delimiters, Text, Values


class Feed(Protocol):
    """Makes the text of an input file, or of the standard input, from the values of a run."""

    @property
    def names(self) -> tuple[str, ...] | None:
        """The conditions and parameters that it writes; None is all of them."""

    @property
    def where(self) -> str:
        """What messages call it."""

    def write(self, values: Columns) -> str:
        """The text; raises RunFailed for a value that cannot be written.

        A feed that has `names` is given values, one without them lists too.
        """


@dataclass(frozen=True)
class Template:
    """A file with placeholders, read when it is named here; UTF-8, kept byte for byte elsewhere.

    `marks` are the delimiters of the placeholders in the file.

    Raises SimulatorError if the file cannot be read.
    """

    # Not in repr, from which fingerprints are made: a study that is moved stays the same study.
    file: Path = field(repr=False)
    marks: Delimiters = BRACES
    text: Text = field(init=False)

    def __post_init__(self) -> None:
        try:
            raw = self.file.read_bytes().decode("utf-8", "surrogateescape")
        except OSError as error:
            folder = self.file.parent
            beside = [p.name for p in folder.iterdir()] if folder.is_dir() else []
            raise SimulatorError(
                f"the template {self.file} cannot be read: {error.strerror}"
                f"{nearest(self.file.name, beside)}",
                "name a file relative to the study",
            ) from None
        text = Text.parse(raw, self.marks, f"the template {self.file.name}")
        object.__setattr__(self, "text", text)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its placeholders."""
        return self.text.names

    @property
    def where(self) -> str:
        """The template by name."""
        return self.text.where

    def write(self, values: Columns) -> str:
        """The file with the values in place."""
        return self.text.fill(cast("Values", values))


@dataclass(frozen=True)
class JsonFeed:
    """One object of all names and values, numbers with every digit; a series is a list.

    >>> JsonFeed().write({"load": 0.1, "bench": "A"})
    '{"load": 0.1, "bench": "A"}\\n'
    """

    where: ClassVar[str] = "the JSON input"

    @property
    def names(self) -> None:
        """All names."""

    def write(self, values: Columns) -> str:
        """A line of JSON."""
        return json.dumps(dict(values)) + "\n"


@dataclass(frozen=True)
class CsvFeed:
    """A line of names and a line of values, numbers with every digit; of a series a line a row.

    >>> CsvFeed().write({"load": 0.1, "bench": "A, left"})
    'load,bench\\n0.1,"A, left"\\n'
    >>> CsvFeed().write({"load": 0.1, "time": [1.0, 2.0]})
    'load,time\\n0.1,1.0\\n0.1,2.0\\n'
    """

    where: ClassVar[str] = "the CSV input"

    @property
    def names(self) -> None:
        """All names."""

    def write(self, values: Columns) -> str:
        """The lines of CSV."""
        rows = next((len(value) for value in values.values() if isinstance(value, list)), 1)
        columns = (v if isinstance(v, list) else [v] * rows for v in values.values())
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(
            [values.keys(), *zip(*columns, strict=True)]
        )
        return text.getvalue()


@dataclass(frozen=True)
class InputFile:
    """A feed written to the file `name` in the folder of a run.

    Raises SimulatorError for a name that leads out of that folder.
    """

    name: str
    feed: Feed

    def __post_init__(self) -> None:
        within(self.name, "the input")


def within(name: str, what: str) -> None:
    """Raise SimulatorError unless `name` lies in the folder of a run."""
    path = Path(name)
    if not name.strip() or path.is_absolute() or ".." in path.parts or path == Path("."):
        raise SimulatorError(
            f"{what} {name!r} is not a file in the folder of a run",
            "name it relative to that folder, without '..'",
        )


def written(path: Path, feed: Feed, plain: Columns, values: Values) -> None:
    """Write the file that a run reads: of `values`, or of the `plain` ones if it names none.

    Raises RunFailed for a value that cannot be written.
    """
    text = feed.write(plain if feed.names is None else values)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)  # it may be a link to a file of the study, which stays as it is
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
