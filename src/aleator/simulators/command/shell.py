"""A text for a shell with values in it, none of which the shell can take for more than a value."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence

from aleator.errors import SimulatorError
from aleator.simulators.command.placeholders import Text, Value, Values

# What may stand before a word that is neither in quotes nor in a here-document: whole quotes, and
# names of variables; no escape, comment or substitution, which nest.
_BARE = re.compile(
    r"""(?: [^"'`\\$#<] | <(?!<) | \$\w | '[^']*' | "(?: [^"`\\$] | \$\w )*" )*""", re.VERBOSE
)
# What has its words read once more, by a shell that sees no quotes.
_TWICE = re.compile(
    r"\b(?: eval | trap | ssh | rsh | su | watch | parallel | (?:ba|da|k|z|a)?sh \s+ -\w*c) \b"
    r"| \| \s* (?:\S*/)? (?:ba|da|k|z|a)?sh \b",
    re.VERBOSE,
)
_SHELL = re.compile(r"(?:ba|da|k|z|a)?sh")
_SCRIPT = re.compile(r"-\w*c")
# What no shell gives a meaning, wherever it stands; letters and digits beside.
_PLAIN = frozenset("@%+=:,./-_")


def filled(text: Text, values: Values) -> str:
    """The text with the values in place: quoted, where they stand bare.

    Between quotes, in a here-document, and wherever this is not certain, stand numbers and texts of
    letters, digits and @%+=:,./-_ only. Raises SimulatorError for another text there.

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
        before += "x"  # whatever it is, it opens nothing
    return written


def script(program: str, arguments: Sequence[str]) -> int | None:
    """Which of the arguments a shell that is started as the program reads as its script, if any.

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
