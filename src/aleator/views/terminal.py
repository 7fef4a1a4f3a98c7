"""Reports printed on a terminal, in its width, with or without color."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.text import Text

from aleator.errors import quoted
from aleator.results.printed import (
    WHOLE,
    Column,
    Content,
    Depth,
    Sentence,
    TextTable,
    laid_out,
    paragraphs,
)

STYLES = {
    "strong": "bold", "finding": "bold", "warning": "bold yellow", "good": "bold green",
    "bad": "bold red", "open": "bold yellow",
}  # fmt: skip


def terminal(content: Content, files: Sequence[str] = (), depth: Depth = WHOLE) -> RenderableType:
    """A content as a report for the terminal, with the names of the written `files` at its end.

    `depth` says how much of the content is shown. Verdicts come last, before the files.
    """
    shown = [part for part in paragraphs(content, depth) if part]
    last = shown.pop() if content.verdicts else []
    lines: list[RenderableType] = []
    for paragraph in shown:
        lines += [line for part in paragraph for line in _part(part)]
        lines += [] if paragraph is shown[0] else [Text()]
    lines += [line for part in last for line in _part(part)]
    return Group(*lines, *written(files))


def written(files: Sequence[str]) -> list[Text]:
    """A line for each written file; a path is not broken into lines, so that it can be copied."""
    return [Text(f"Written: {file}", no_wrap=True, overflow="ignore") for file in files]


@dataclass(frozen=True)
class TerminalTable:
    """A table as wide as the terminal at most, with a line under its head; no word is cut."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        head, body = laid_out(self.columns, self.rows, options.max_width)
        for line in head:
            yield Text(line, style="bold")
        if head:
            yield Text(("-" if options.ascii_only else "─") * max(map(len, [*head, *body])))
        for line in body:
            yield Text(line)


def _part(part: Sentence | TextTable) -> list[RenderableType]:
    """The lines of a table, or of a sentence with a color up to its colon."""
    if isinstance(part, TextTable):
        title = [Text(), Text(part.title, style="bold")] if part.folded else []
        return [*title, TerminalTable(part.columns, part.rows)]
    said = quoted(str(part))
    text = Text(said)
    end = said.find(":") if part.kind != "strong" else len(text)
    text.stylize(STYLES.get(part.kind, ""), 0, end if end >= 0 else len(text))
    return [text]
