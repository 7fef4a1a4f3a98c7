"""How a command ends: its document is written, its figure drawn, and what it found is told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import click
from rich.console import Console, RenderableType

from aleator.cli.running import can_draw, linked, units_in
from aleator.errors import short
from aleator.results import documents
from aleator.study import Study

Document = Mapping[str, Any]


class Told(Protocol):
    """How a document is told: a module of `report`."""

    def verdict(self, document: Document, /) -> str:
        """A line."""

    def render(self, document: Document, files: Sequence[str], /) -> RenderableType:
        """A page, with the files that were written."""


def ended(
    name: str,
    made: Document,
    report: Told,
    *,
    study: Study,
    file: Path,
    folder: Path,
    quiet: bool,
    draw: Callable[[Document, Path], Path] | None,
    table: str | None = None,
) -> None:
    """Write name.json of what was made of a study and its `file`, and tell it.

    A `table` is written as name.csv; `draw` writes a figure of the document into the folder, where
    matplotlib is installed.
    """
    entry = linked({**made, **units_in(study)}, study, file, folder)
    document, files = documents.plain(entry), [folder / f"{name}.json"]
    documents.write_json(document, files[0])
    if table is not None:
        files.append(folder / f"{name}.csv")
        documents.write_text(table, files[-1])
    if draw is not None and can_draw("no figure is drawn: it needs", quiet):
        files.append(draw(document, folder))
    told(report, document, files, quiet)


def told(report: Told, document: Document, files: Sequence[Path], quiet: bool) -> None:
    """The page, or of a quiet command the verdict alone."""
    if quiet:
        click.echo(report.verdict(document))
    else:
        Console().print(report.render(document, [short(file) for file in files]))
