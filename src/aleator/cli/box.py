"""`aleator box`."""

from __future__ import annotations

from pathlib import Path

import click

from aleator.cli.ending import told
from aleator.cli.running import (
    FILE,
    FOLDER,
    SEED,
    RunOptions,
    linked,
    make_place,
    makes_runs,
    running,
    units_in,
)
from aleator.cli.showing import shown
from aleator.errors import short
from aleator.results import documents
from aleator.study import load_study
from aleator.tasks.box import feasible_box
from aleator.tasks.documents import box_document
from aleator.views import planning


@click.command()
@click.argument("study", type=FILE, metavar="STUDY.toml")
@click.option(
    "--output",
    type=FOLDER,
    metavar="DIR",
    help="Write DIR/box.json.",
)
@SEED
@makes_runs
def box(
    study: Path,
    output: Path | None,
    seed: int | None,
    options: RunOptions,
) -> None:
    """Find the largest box in which every experiment works.

    Looks within the boxes and limits that STUDY.toml states: make them as wide as physics allows.
    A run that raises, or returns no finite number, counts as a failure and does not stop the
    search. Tells for every side of the box which experiment limits it, and where it failed.
    """
    value, study_file = load_study(study).overridden(seed), study.absolute()
    if output is not None:
        make_place(output / "box.json", study_file)
    with running(value, options) as runner, shown(options.quiet) as progress:
        progress.stage("feasible box")
        found = feasible_box(
            runner, value.experiments, value.inputs, seed=value.seed, progress=progress
        )
    answer = {**box_document(found), **units_in(value)}
    told(planning.box(answer), quiet=options.quiet)
    if output is not None:
        documents.write_json(linked(answer, value, study_file, output), output / "box.json")
        click.echo(f"Written: {short(output / 'box.json')}")
