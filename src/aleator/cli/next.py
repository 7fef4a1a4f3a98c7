"""`aleator next`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from aleator.cli.ending import told
from aleator.cli.running import (
    FILE,
    FOLDER,
    SEED,
    RunOptions,
    identified,
    linked,
    make_place,
    makes_runs,
    running,
    units_in,
)
from aleator.cli.showing import shown
from aleator.errors import AleatorError
from aleator.report import next as report
from aleator.results import documents
from aleator.study import Study, load_study
from aleator.tasks.next_experiment import (
    Predicted,
    next_experiments,
    require_enough_candidates,
    require_free,
)

QUANTILE = 0.95
"""What is predicted where nobody says."""


@click.command()
@click.argument("study", type=FILE, metavar="STUDY.toml")
@click.option(
    "--candidates",
    type=FILE,
    required=True,
    metavar="NEW.csv",
    help="Table of experiments that could be made, written as the study's is, without outcomes.",
)
@click.option(
    "--count",
    type=click.IntRange(min=1),
    default=5,
    show_default=True,
    help="Number of experiments to choose.",
)
@click.option(
    "--for",
    "about",
    metavar="NAME|all",
    help="The hyperparameter to know better, or all together "
    "[default: the standard deviation that is least known for its size].",
)
@click.option(
    "--for-prediction",
    type=FILE,
    metavar="CONDITIONS.csv",
    help="Know better what is predicted under these conditions: a quantile or a probability.",
)
@click.option(
    "--quantile", type=float, help=f"The quantile that is predicted [default: {QUANTILE:g}]."
)
@click.option("--above", type=float, help="The limit whose probability above is predicted.")
@click.option("--below", type=float, help="The limit whose probability below is predicted.")
@click.option(
    "--repeat",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="How often a candidate may be chosen.",
)
@click.option(
    "--laws",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Plan for the mean over so many laws that the experiments leave possible; 1: for the "
    "identified one.",
)
@click.option("--output", type=FOLDER, metavar="DIR", help="Write DIR/next.json and DIR/next.csv.")
@SEED
@makes_runs
def next(
    study: Path,
    candidates: Path,
    count: int,
    about: str | None,
    for_prediction: Path | None,
    quantile: float | None,
    above: float | None,
    below: float | None,
    repeat: int,
    laws: int,
    output: Path | None,
    seed: int | None,
    options: RunOptions,
) -> None:
    """Tell which experiments should be made next.

    Identifies the law of STUDY.toml (runs that are kept are not made again) and computes what each
    row of NEW.csv would tell of a hyperparameter or a prediction: its standard error after that
    experiment. Then the set of experiments that tell most together, and how often all experiments
    would have to be repeated for the same. Rows with one id are one experiment. Nothing is
    measured; runs of the simulator are made for the candidates.
    """
    value, study_file = load_study(study).overridden(seed, verified=False), study.absolute()
    table = value.read_conditions(candidates)
    # what is wrong here is told before a slow simulator is run
    require_enough_candidates(count, len(table.ids), repeat)
    require_free(about, value.hyperparameters)
    wanted = _predicted(value, for_prediction, quantile, above, below)
    if wanted is not None and about is not None:
        raise AleatorError("--for and --for-prediction contradict each other", "leave one out")
    if output is not None:
        make_place(output / "next.json", study_file)
    with running(value, options) as runner, shown(options.quiet) as progress:
        found = identified(value, runner, progress)
        with running(value, replace(options, quiet=True), table) as others:
            plan = next_experiments(
                found,
                table,
                count,
                about=about if wanted is None else wanted,
                repeat=repeat,
                laws=laws,
                simulator=others,
                progress=progress,
            )
    document = documents.plain(
        {"title": value.title, "seed": value.seed, **units_in(value), **plan.to_dict()}
    )
    files = []
    if output is not None:
        document = linked(document, value, study_file, output)
        documents.write_json(document, output / "next.json")
        text = plan.table().to_csv(index_label="id", lineterminator="\n")
        documents.write_text(text, output / "next.csv")
        files = [output / "next.json", output / "next.csv"]
    told(report, document, files, options.quiet)


def _predicted(
    study: Study,
    conditions: Path | None,
    quantile: float | None,
    above: float | None,
    below: float | None,
) -> Predicted | None:
    """What is to be predicted; a quantile unless a limit is given."""
    limits = {"--quantile": quantile, "--above": above, "--below": below}
    if conditions is None:
        for option, given in limits.items():
            if given is not None:
                raise AleatorError(
                    f"{option} says what to predict, but not under which conditions",
                    "add --for-prediction CONDITIONS.csv",
                )
        return None
    if above is None and below is None and quantile is None:
        quantile = QUANTILE
    return Predicted(study.read_conditions(conditions), quantile, below, above)
