"""`aleator report`."""

from __future__ import annotations

from pathlib import Path

import click

from aleator.cli.reporting import study_of, write_report
from aleator.cli.running import FOLDER
from aleator.cli.showing import require_report
from aleator.errors import short
from aleator.tasks.results import documents
from aleator.tasks.results.saved import from_document

IDENTIFICATION = "identification.json"


@click.command()
@click.argument("folder", type=FOLDER, metavar="DIR")
def report(folder: Path) -> None:
    """Write DIR/report.html of the identification in DIR.

    A page of charts in one file that needs no network: the law, the estimates, measured against
    predicted, calibration, warnings, and how it was computed. `aleator identify` writes it too;
    this command writes it anew, with DIR/ceiling.json where `aleator ceiling` has written that.
    No run of the simulator is made.
    """
    require_report()
    path = folder / IDENTIFICATION
    document = documents.read_json(path)
    from_document(document, path)
    click.echo(f"Written: {short(write_report(document, folder, study_of(document, folder)))}")
