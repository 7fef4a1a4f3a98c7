"""`aleator sensitivity`."""

from __future__ import annotations

from pathlib import Path

import click

from aleator.cli.ending import ended
from aleator.cli.running import (
    FILE,
    OUTPUT,
    SEED,
    RunOptions,
    folder_of,
    make_place,
    makes_runs,
    running,
)
from aleator.cli.showing import shown
from aleator.study import load_study
from aleator.tasks.documents import sensitivity_document
from aleator.tasks.screen import FIRST_RUNS, screen
from aleator.views import planning
from aleator.views.figures import save_sensitivity


@click.command()
@click.argument("study", type=FILE, metavar="STUDY.toml")
@OUTPUT
@SEED
@click.option(
    "--runs",
    type=click.IntRange(min=4),
    help=f"Runs an experiment [default: {FIRST_RUNS} a parameter, and more until the expansions "
    "are good].",
)
@click.option(
    "--experiments",
    metavar="ID,ID,...",
    help="Only these experiments [default: all].",
)
@makes_runs
@click.option("--no-figures", is_flag=True, help="Draw no figure.")
def sensitivity(
    study: Path,
    output: Path | None,
    seed: int | None,
    runs: int | None,
    experiments: str | None,
    no_figures: bool,
    options: RunOptions,
) -> None:
    """Tell which parameters deserve a law.

    These are the ones whose scatter moves the outcome. Tells also which ones act alike.

    Expands the outcome of every experiment in the parameters and takes Sobol' indices from the
    coefficients. A parameter is varied by its law where STUDY.toml states all of it, uniformly
    over its limits or box where something is to be identified. To screen a parameter, make it a
    constant with limits.

    Writes DIR/sensitivity.json (all), DIR/sensitivity.csv (a row for each experiment and
    parameter) and DIR/sensitivity.png if matplotlib is installed.
    """
    folder, study_file = folder_of(output, study), study.absolute()
    value = load_study(study).overridden(seed)
    make_place(folder / "sensitivity.json", study_file)
    ids = None if experiments is None else [name.strip() for name in experiments.split(",")]
    with running(value, options) as runner, shown(options.quiet) as progress:
        progress.stage("sensitivity")
        runner.progress = progress
        found = screen(
            runner,
            value.experiments,
            value.inputs,
            only=ids,
            runs=runs,
            seed=value.seed,
            progress=progress,
        )
    ended(
        "sensitivity",
        {**sensitivity_document(found), "runs": runner.runs, "seed": value.seed},
        planning.sensitivity, study=value, file=study_file, folder=folder, quiet=options.quiet,
        draw=None if no_figures else save_sensitivity,
        table=found.table().to_csv(index=False, lineterminator="\n"),
    )  # fmt: skip
