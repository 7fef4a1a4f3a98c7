"""Inputs of a program: texts with placeholders, input files, and commands for a shell."""

from __future__ import annotations

import csv
import io
import json
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Protocol, cast

from aleator.errors import SimulatorError
from aleator.simulators.protocol import RunFailed, require_file

Value = float | str
Values = Mapping[str, Value]
Columns = Mapping[str, Value | list[Value]]
"""The values of a run by name, with a list for a condition that varies within an experiment."""


@dataclass(frozen=True)
class Delimiters:
    """The marks before and after a placeholder.

    Raises SimulatorError for a mark that is empty or has a space, a colon, a letter, a digit or an
    underscore.

    >>> Text.parse("{keep} $x$", Delimiters("$", "$")).names
    ('x',)
    """

    opening: str = "{"
    closing: str = "}"

    def __post_init__(self) -> None:
        for mark in (self.opening, self.closing):
            if not mark or any(c.isalnum() or c.isspace() or c in "_:" for c in mark):
                raise SimulatorError(
                    f"the delimiter {mark!r} cannot mark a placeholder",
                    'take signs that the text has nowhere else, such as ["{{", "}}"] or ["$", "$"]',
                )

    @property
    def pattern(self) -> str:
        """A regular expression for a placeholder in one line, with the groups `name` and `spec`."""
        opening, closing = re.escape(self.opening), re.escape(self.closing)
        inside = rf"(?!{opening}|{closing})"
        name, spec = rf"(?:{inside}[^:\n])+", rf"(?:{inside}[^\n])*"
        return rf"{opening}(?P<name>{name})(?::(?P<spec>{spec}))?{closing}"


@dataclass(frozen=True)
class Placeholder:
    """The name of a value, and its format in Python's notation; "" writes all digits."""

    name: str
    spec: str = ""

    def write(self, value: Value) -> str:
        """The value as text. Raises RunFailed if the format does not suit the value.

        >>> Placeholder("x").write(0.1), Placeholder("x", ".3e").write(0.1)
        ('0.1', '1.000e-01')
        """
        try:
            if isinstance(value, str):
                return format(value, self.spec)
            whole = self.spec.endswith(("d", "x", "o", "b", "c")) and float(value).is_integer()
            return format(int(value) if whole else float(value), self.spec)
        except ValueError:
            raise RunFailed(
                f"the value {value!r} of '{self.name}' cannot be written with the format "
                f"'{self.spec}'"
            ) from None


@dataclass(frozen=True)
class Text:
    """A text divided into plain pieces and placeholders; `where` is its name in messages.

    >>> text = Text.parse("--load {load:.2f} {{as is}}", escapes=True)
    >>> text.names, text.fill({"load": 0.125})
    (('load',), '--load 0.12 {as is}')
    """

    pieces: tuple[str | Placeholder, ...]
    where: str

    @classmethod
    def parse(
        cls,
        text: str,
        marks: Delimiters = Delimiters(),
        where: str = "the text",
        escapes: bool = False,
    ) -> Text:
        """Find the placeholders in a text; with `escapes` a doubled mark stands for one mark.

        Raises SimulatorError for a format that suits no number.
        """
        doubled = "|".join(re.escape(2 * mark) for mark in (marks.opening, marks.closing))
        pattern = f"(?P<doubled>{doubled})|{marks.pattern}" if escapes else marks.pattern
        pieces: list[str | Placeholder] = []
        end = 0
        for match in re.finditer(pattern, text):
            pieces.append(text[end : match.start()])
            end = match.end()
            if escapes and match["doubled"]:
                pieces.append(match["doubled"][: len(match["doubled"]) // 2])
            else:
                pieces.append(_placeholder(match, where))
        pieces.append(text[end:])
        return cls(tuple(piece for piece in pieces if piece), where)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the placeholders in the order of their first appearance."""
        named = (piece.name for piece in self.pieces if isinstance(piece, Placeholder))
        return tuple(dict.fromkeys(named))

    def fill(self, values: Values) -> str:
        """The text with the values in place of the placeholders."""
        return "".join(
            piece if isinstance(piece, str) else piece.write(values[piece.name])
            for piece in self.pieces
        )


def _placeholder(match: re.Match[str], where: str) -> Placeholder:
    name, spec = match["name"].strip(), match["spec"] or ""
    found = Placeholder(name, spec)
    if spec and not spec.endswith("s"):
        try:
            found.write(1.0)
        except RunFailed:
            if not name.isidentifier():
                raise SimulatorError(
                    f"{where}: what stands between braces is no name: {match[0]:.40}",
                    "write {NAME} where the value of a condition or parameter goes; where braces "
                    "mean something else, double them in a command, or choose other delimiters "
                    "for a file",
                ) from None
            raise SimulatorError(
                f"{where}: the placeholder {match[0]} has a format that no number has",
                "write one such as .6g or 12.4e; where no placeholder is meant, double the braces "
                "in a command, or choose other delimiters for a file",
            ) from None
    return found


# Shell text after which a word is certainly neither in quotes nor in a here-document. It may have
# closed quotes and variables, but no escape, comment or substitution, because these can be nested.
_BARE = re.compile(
    r"""(?: [^"'`\\$#<] | <(?!<) | \$\w | '[^']*' | "(?: [^"`\\$] | \$\w )*" )*""", re.VERBOSE
)
# Commands that pass their arguments to another shell, which does not see the quotes.
_TWICE = re.compile(
    r"\b(?: eval | trap | ssh | rsh | su | watch | parallel | (?:ba|da|k|z|a)?sh \s+ -\w*c) \b"
    r"| \| \s* (?:\S*/)? (?:ba|da|k|z|a)?sh \b",
    re.VERBOSE,
)
_SHELL = re.compile(r"(?:ba|da|k|z|a)?sh")
_SCRIPT = re.compile(r"-\w*c")
# Besides letters and digits, these characters have no special meaning in any shell.
_PLAIN = frozenset("@%+=:,./-_")


def filled(text: Text, values: Values) -> str:
    """The text for a shell with the values in place; a value outside of quotes is quoted.

    Inside quotes, in a here-document, and wherever this is uncertain, a value must be a number or a
    text of letters, digits and @%+=:,./-_. Raises SimulatorError for any other text there.

    >>> text = Text.parse("solve {bench} > '{bench}.txt'")
    >>> filled(text, {"bench": "B2"})
    "solve B2 > 'B2.txt'"
    >>> filled(text, {"bench": "$(touch X)"})
    Traceback (most recent call last):
        ...
    aleator.errors.SimulatorError: a shell would read what ...
    """
    written, before = "", ""
    twice = any(isinstance(piece, str) and _TWICE.search(piece) for piece in text.pieces)
    for piece in text.pieces:
        if isinstance(piece, str):
            written, before = written + piece, before + piece
            continue
        value = values[piece.name]
        bare = not twice and _BARE.fullmatch(before) is not None
        if not (bare or _is_plain(value)):
            raise _read_by_the_shell(piece.name, str(value))
        shown = piece.write(value)
        written += shlex.quote(shown) if bare else shown
        before += "x"  # This letter stands for the value, which opens no quotes.
    return written


def script(program: str, arguments: Sequence[str]) -> int | None:
    """The position of the argument that is a script, if the program is a shell; else None.

    >>> script("bash", ["-ec", "solve $1", "solve", "B2"]), script("python3", ["-c", "print(1)"])
    (1, None)
    """
    if _SHELL.fullmatch(program) is None:
        return None
    given = (k for k, word in enumerate(arguments[:-1], start=1) if _SCRIPT.fullmatch(word))
    return next(given, None)


def _is_plain(value: Value) -> bool:
    return not isinstance(value, str) or (
        value != "" and all(sign.isalnum() or sign in _PLAIN for sign in value)
    )


def _read_by_the_shell(name: str, value: str) -> SimulatorError:
    variable = re.sub(r"\W", "_", name, flags=re.ASCII).upper()
    return SimulatorError(
        f"a shell would read what the value {value!r:.60} of '{name}' says",
        f'write environment = {{{variable} = "{{{name}}}"}} and "${variable}" in the command, '
        "in place of the placeholder; or leave out its quotes, or the shell",
    )


class Feed(Protocol):
    """Makes the text of an input file, or of the standard input, from the values of a run."""

    @property
    def names(self) -> tuple[str, ...] | None:
        """The conditions and parameters that the text contains; None means all of them."""

    @property
    def where(self) -> str:
        """The name of the input in messages."""

    def write(self, values: Columns) -> str:
        """The text of an input file. Raises RunFailed for a value that cannot be written.

        A file that lists `names` gets single numbers; one that gets everything takes series, too.
        """


@dataclass(frozen=True)
class Template:
    """An input file with placeholders, read when it is created; bytes that are not UTF-8 are kept.

    `marks` are the delimiters of the placeholders in the file.

    Raises SimulatorError if the file cannot be read.
    """

    # The path is left out of repr and so of the fingerprint: a study may be moved.
    file: Path = field(repr=False)
    marks: Delimiters = Delimiters()
    text: Text = field(init=False)

    def __post_init__(self) -> None:
        require_file(self.file, f"the template {self.file}")
        try:
            raw = self.file.read_bytes().decode("utf-8", "surrogateescape")
        except OSError as error:
            raise SimulatorError(
                f"the template {self.file} cannot be read: {error.strerror}", "name another file"
            ) from None
        text = Text.parse(raw, self.marks, f"the template {self.file.name}")
        object.__setattr__(self, "text", text)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the placeholders in the file."""
        return self.text.names

    @property
    def where(self) -> str:
        """The word "template" with the name of the file, for messages."""
        return self.text.where

    def write(self, values: Columns) -> str:
        """The text of the file with the values in place of the placeholders."""
        return self.text.fill(cast("Values", values))


@dataclass(frozen=True)
class JsonFeed:
    """An input in JSON: one object with all values by name and all digits; a series is a list.

    >>> JsonFeed().write({"load": 0.1, "bench": "A"})
    '{"load": 0.1, "bench": "A"}\\n'
    """

    where: ClassVar[str] = "the JSON input"

    @property
    def names(self) -> None:
        """None, which means that all values are written."""

    def write(self, values: Columns) -> str:
        """The values as one line of JSON."""
        return json.dumps(dict(values)) + "\n"


@dataclass(frozen=True)
class CsvFeed:
    """An input in CSV: a line of names and a line of values, or for a series a line for each row.

    All digits of the values are written.

    >>> CsvFeed().write({"load": 0.1, "bench": "A, left"})
    'load,bench\\n0.1,"A, left"\\n'
    >>> CsvFeed().write({"load": 0.1, "time": [1.0, 2.0]})
    'load,time\\n0.1,1.0\\n0.1,2.0\\n'
    """

    where: ClassVar[str] = "the CSV input"

    @property
    def names(self) -> None:
        """None, which means that all values are written."""

    def write(self, values: Columns) -> str:
        """The values as lines of CSV."""
        rows = next((len(value) for value in values.values() if isinstance(value, list)), 1)
        columns = (v if isinstance(v, list) else [v] * rows for v in values.values())
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(
            [values.keys(), *zip(*columns, strict=True)]
        )
        return text.getvalue()


@dataclass(frozen=True)
class InputFile:
    """An input that is written to the file `name` in the folder of a run.

    Raises SimulatorError for a name that leads out of that folder.
    """

    name: str
    feed: Feed

    def __post_init__(self) -> None:
        within(self.name, "the input")


def within(name: str, what: str) -> None:
    """Raise SimulatorError unless `name` is a file inside the folder of a run."""
    path = Path(name)
    if not name.strip() or path.is_absolute() or ".." in path.parts or path == Path("."):
        raise SimulatorError(
            f"{what} {name!r} is not a file in the folder of a run",
            "name it relative to that folder, without '..'",
        )


def write_input(path: Path, feed: Feed, plain: Columns, values: Values) -> None:
    """Write an input file: a template takes `values` for its placeholders, others take all `plain`.

    Raises RunFailed for a value that cannot be written.
    """
    text = feed.write(plain if feed.names is None else values)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)  # If it is a link, the file of the study must not be changed.
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
