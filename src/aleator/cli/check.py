"""`aleator check`."""

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
from aleator.errors import short
from aleator.study import load_study
from aleator.tasks.askable import require_askable
from aleator.tasks.documents import look_document
from aleator.tasks.expected_cost import expected_cost
from aleator.tasks.first_look import first_look, planned_look
from aleator.views import planning
from aleator.views.figures import save_check


@click.command()
@click.argument("study", type=FILE, metavar="STUDY.toml")
@OUTPUT
@SEED
@makes_runs
@click.option("--no-figures", is_flag=True, help="Draw no figure.")
def check(
    study: Path,
    output: Path | None,
    seed: int | None,
    options: RunOptions,
    no_figures: bool,
) -> None:
    """Make the first runs, and tell what the rest will cost.

    Each parameter takes five values over its limits, the others in the middle, and the corners of
    all limits follow: 5 runs an experiment for one parameter, 13 for two, 21 for three. Of many
    experiments some are looked at, evenly over the measured values, unless a run is fast. Every
    run is kept in the store.

    Tells which experiments no run comes to, which parameters have no influence, how long a run
    takes, and how many an identification will need. Writes DIR/check.json, and DIR/check.png, the
    outcome over each parameter, if matplotlib is installed.
    """
    folder, study_file = folder_of(output, study), study.absolute()
    value = load_study(study).overridden(seed)
    require_askable(value.experiments, value.inputs, value.noise, value.propagation, value.density)
    make_place(folder / "check.json", study_file)
    with running(value, options) as runner, shown(options.quiet) as progress:
        plan = planned_look(runner, value.experiments, value.inputs)
        options.say(
            f"{plan.runs:,} runs: {len(plan.x)} points under {len(plan.cases)} of "
            f"{plan.count} different conditions"
        )
        progress.stage("first runs")
        runner.progress = progress
        look = first_look(runner, value.experiments, plan, value.noise, progress)
        cost = expected_cost(
            runner, value.experiments, value.inputs, value.noise, value.propagation,
            value.density, value.verification, plan,
        )  # fmt: skip
    ended(
        "check", look_document(look, cost, options.workers or 1), planning.first_look,
        study=value, file=study_file, folder=folder, quiet=options.quiet,
        draw=None if no_figures else save_check,
    )  # fmt: skip
    if not options.quiet:
        click.echo(f"Next: aleator identify {short(study_file)}")
