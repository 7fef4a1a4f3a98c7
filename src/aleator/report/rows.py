"""A table on the terminal, as wide as that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from aleator.results.printed import Column, laid_out


@dataclass(frozen=True)
class Rows:
    """A table that cuts no word (`aleator.results.printed`), with a line under its head."""

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


def written(files: Sequence[str]) -> list[Text]:
    """A line for each file; a path is never folded, so that it can be copied."""
    return [Text(f"Written: {file}", no_wrap=True, overflow="ignore") for file in files]
