"""Texts with placeholders for conditions and parameters: `--pressure {pressure:.3f}`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from aleator.errors import SimulatorError
from aleator.simulators.failure import RunFailed

Value = float | str
Values = Mapping[str, Value]
Columns = Mapping[str, Value | list[Value]]
"""Values of a run by name, with a list where one varies within an experiment."""


@dataclass(frozen=True)
class Delimiters:
    """What stands before and after a placeholder.

    Raises SimulatorError where one is empty or has a space, a colon, or a letter or digit.

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
        """A regular expression with the groups `name` and `spec`; it ends within the line."""
        opening, closing = re.escape(self.opening), re.escape(self.closing)
        inside = rf"(?!{opening}|{closing})"
        name, spec = rf"(?:{inside}[^:\n])+", rf"(?:{inside}[^\n])*"
        return rf"{opening}(?P<name>{name})(?::(?P<spec>{spec}))?{closing}"


BRACES = Delimiters()


@dataclass(frozen=True)
class Placeholder:
    """A name and how its value is written: a format of Python, or "" for every digit."""

    name: str
    spec: str = ""

    def write(self, value: Value) -> str:
        """The value as text; raises RunFailed for a format that the value does not have.

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
    """A text cut into what stays and what is filled in; `where` is what messages call it.

    Cost: one join a fill.

    >>> text = Text.parse("--load {load:.2f} {{as is}}", escapes=True)
    >>> text.names, text.fill({"load": 0.125})
    (('load',), '--load 0.12 {as is}')
    """

    pieces: tuple[str | Placeholder, ...]
    where: str

    @classmethod
    def parse(
        cls, text: str, marks: Delimiters = BRACES, where: str = "the text", escapes: bool = False
    ) -> Text:
        """Find the placeholders; with `escapes` a doubled delimiter stands for the delimiter.

        Raises SimulatorError for a format that no number has.
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
        """The names of the placeholders, each once, as they come first."""
        named = (piece.name for piece in self.pieces if isinstance(piece, Placeholder))
        return tuple(dict.fromkeys(named))

    def fill(self, values: Values) -> str:
        """The text with the values written in."""
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
            raise SimulatorError(
                f"{where}: the placeholder {match[0]} has a format that no number has",
                "write one such as .6g or 12.4e; where no placeholder is meant, double the braces "
                "in a command, or choose other delimiters for a file",
            ) from None
    return found
