"""`aleator ceiling`."""

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
    identified,
    make_place,
    makes_runs,
    running,
)
from aleator.cli.showing import shown
from aleator.study import load_study
from aleator.tasks.ceiling import ceiling as best_possible
from aleator.tasks.ceiling import require_one_law
from aleator.tasks.documents import ceiling_document
from aleator.views import models
from aleator.views.figures import save_ceiling


@click.command()
@click.argument("study", type=FILE, metavar="STUDY.toml")
@OUTPUT
@click.option(
    "--replicates",
    type=click.IntRange(min=0),
    default=99,
    show_default=True,
    help="Data sets drawn from the identified law, at most; 0 for no p value.",
)
@click.option("--no-verify", is_flag=True, help="Leave out the check on the simulator.")
@SEED
@makes_runs
@click.option("--no-figures", is_flag=True, help="Draw no figure.")
def ceiling(
    study: Path,
    output: Path | None,
    replicates: int,
    no_verify: bool,
    seed: int | None,
    no_figures: bool,
    options: RunOptions,
) -> None:
    """Tell how far any law could go, and where this one lacks.

    Identifies the law of STUDY.toml first; with the runs in its store none is repeated. Then finds
    the law, of any shape, under which the experiments are most likely, tells whether its
    log-likelihood is higher than chance explains, by data drawn from the identified law, and where
    the identified law lacks mass.

    Where surfaces stand for the simulator it is run at the points of that law. Needs measurement
    noise. Constants, and noise that was identified, are held at their estimates.
    Writes DIR/ceiling.json, and DIR/ceiling.png if matplotlib is installed.
    """
    folder, study_file = folder_of(output, study), study.absolute()
    value = load_study(study).overridden(seed, verified=False)
    require_one_law(value.inputs)
    make_place(folder / "ceiling.json", study_file)
    with running(value, options) as runner, shown(options.quiet) as progress:
        identification = identified(value, runner, progress, consistency=False)
        found = best_possible(
            identification,
            replicates=replicates,
            verify=not no_verify,
            seed=value.seed,
            progress=progress,
        )
    ended(
        "ceiling", {**ceiling_document(found), "seed": value.seed}, models.ceiling,
        study=value, file=study_file, folder=folder, quiet=options.quiet,
        draw=None if no_figures else save_ceiling,
    )  # fmt: skip
