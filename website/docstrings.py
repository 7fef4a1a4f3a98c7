"""Docstrings of the package as reStructuredText.

They are plain text: sentences with names in backticks, equations and code on indented lines, lists,
and examples behind `>>>`. Nothing in them is markup by accident: a `|u|` is two bars and a letter.
"""

import re
from textwrap import dedent
from typing import Any

from sphinx.application import Sphinx

import aleator

QUOTED = re.compile(r"(``[^`]+``|`[^`]+`)")
LONG = re.compile(r"""=("[^"]{40,}"|'[^']{40,}')""")
RESULTS = {
    "aleator.Identification",
    "aleator.Posterior",
    "aleator.results.values.Consistency",
}
PUBLIC = set(aleator.__all__)
MARKS = re.compile(r"([\\*|_])")


def quoted(name: str) -> str:
    """A name as code; one that the reference has leads there."""
    return f":py:obj:`{name} <aleator.{name}>`" if name in PUBLIC else f"``{name}``"


def sentence(line: str) -> str:
    """A line of text: names as code, every other character as it is."""
    return "".join(
        quoted(part.strip("`")) if part.startswith("`") else MARKS.sub(r"\\\1", part)
        for part in QUOTED.split(line)
    )


def paragraph(text: str) -> str:
    """One paragraph, equation or example."""
    if text.startswith(">>>"):
        return text
    if text.startswith(" "):
        return "::\n\n" + "\n".join(f"    {line}" for line in dedent(text).splitlines())
    bullet = text.startswith("- ")
    return "\n".join(
        line[:2] + sentence(line[2:]) if bullet else sentence(line) for line in text.splitlines()
    )


def restructured(text: str) -> str:
    """The whole docstring. Names are quoted over the ends of lines, so lines are joined first."""
    parts = re.split(r"\n\s*\n", text.strip("\n"))
    return "\n\n".join(map(paragraph, parts)) + "\n"


def process(
    _app: Sphinx, _what: str, _name: str, _thing: object, _options: Any, lines: list[str]
) -> None:
    """What autodoc calls with the lines of a docstring, to be changed in place."""
    lines[:] = restructured("\n".join(lines)).splitlines()


def sign(
    _app: Sphinx, what: str, name: str, _thing: object, _options: Any, signature: str, returns: str
) -> tuple[str, str] | None:
    """What autodoc calls with a signature.

    Nobody makes a result, so how is not told; a default of half a line or more is left out.
    """
    if signature is None:
        return None
    made = what == "class" and (name.startswith("aleator.tasks") or name in RESULTS)
    return ("", "") if made else (LONG.sub("=...", signature), returns)


def setup(app: Sphinx) -> dict[str, Any]:
    """Join Sphinx."""
    app.connect("autodoc-process-docstring", process)
    app.connect("autodoc-process-signature", sign)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
