"""`aleator report`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from aleator.cli.reporting import study_of, write_compared, write_report
from aleator.cli.running import FOLDER
from aleator.cli.showing import require_report
from aleator.errors import short
from aleator.tasks.results import documents
from aleator.tasks.results.saved import from_document

IDENTIFICATION = "identification.json"


@click.command()
@click.argument("folder", type=FOLDER, metavar="DIR")
@click.option(
    "--compare",
    "other",
    type=FOLDER,
    metavar="OTHER",
    help="Put the identification in OTHER beside it: DIR/compared.html.",
)
def report(folder: Path, other: Path | None) -> None:
    """Write report.html of an answer, or of two side by side.

    DIR/report.html is a page of charts in one file that needs no network: the law, the estimates,
    measured against predicted, calibration, warnings, and how it was computed. `aleator identify`
    writes it too; this command writes it anew from DIR/identification.json, with DIR/ceiling.json
    where `aleator ceiling` has written that. No run of the simulator is made.

    With --compare it writes DIR/compared.html: both verdicts, estimates, laws and predictions side
    by side.
    """
    require_report()
    document = _read(folder)
    if other is None:
        path = write_report(document, folder, study_of(document, folder))
    else:
        path = write_compared(document, _read(other), folder, other)
    click.echo(f"Written: {short(path)}")


def _read(folder: Path) -> dict[str, Any]:
    """The document in a folder; raises AleatorError where it is none."""
    path = folder / IDENTIFICATION
    document = documents.read_json(path)
    from_document(document, path)
    return document
