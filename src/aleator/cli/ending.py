"""How a command ends: its document is written, its figure drawn, and what it found is told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from aleator.cli.running import linked, units_in
from aleator.cli.showing import can_draw
from aleator.errors import short
from aleator.results import documents
from aleator.results.printed import WHOLE, Content, Depth
from aleator.study import Study
from aleator.views.terminal import terminal

Document = Mapping[str, Any]


def ended(
    name: str,
    made: Document,
    content: Callable[[Document], Content],
    *,
    study: Study,
    file: Path,
    folder: Path,
    quiet: bool,
    draw: Callable[[Document, Path], Path] | None,
    table: str | None = None,
) -> None:
    """Write name.json of what was made of a study and its `file`, and tell it.

    `content` makes of the document what is said of it. A `table` is written as name.csv; `draw`
    writes a figure of the document into the folder, where matplotlib is installed.
    """
    entry = linked({**made, **units_in(study)}, study, file, folder)
    document, files = documents.plain(entry), [folder / f"{name}.json"]
    documents.write_json(document, files[0])
    if table is not None:
        files.append(folder / f"{name}.csv")
        documents.write_text(table, files[-1])
    if draw is not None and can_draw("no figure is drawn: it needs", quiet):
        files.append(draw(document, folder))
    told(content(document), files, quiet)


def told(
    content: Content, files: Sequence[Path] = (), quiet: bool = False, depth: Depth = WHOLE
) -> None:
    """The report, or of a quiet command the verdict alone."""
    if quiet:
        click.echo(content.verdict)
    else:
        Console().print(terminal(content, [short(file) for file in files], depth))
