"""`aleator report`."""

from __future__ import annotations

from pathlib import Path

import click

from aleator.cli.identify import study_of, write_compared, write_report
from aleator.cli.running import FOLDER, require_report
from aleator.errors import short
from aleator.results.schema import read_answer

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
    document = read_answer(folder / IDENTIFICATION)
    if other is None:
        path = write_report(document, folder, study_of(document, folder))
    else:
        path = write_compared(document, read_answer(other / IDENTIFICATION), folder, other)
    click.echo(f"Written: {short(path)}")
