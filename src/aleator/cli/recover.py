"""`aleator recover`."""

from __future__ import annotations

import os
from pathlib import Path

import click

from aleator.cli.ending import told
from aleator.cli.running import (
    FILE,
    FOLDER,
    RESULT,
    SEED,
    RunOptions,
    identified,
    linked,
    make_place,
    makes_runs,
    running,
)
from aleator.cli.showing import shown
from aleator.errors import AleatorError, nearest
from aleator.progress import Progress
from aleator.report import recovery
from aleator.results import documents
from aleator.simulators import Runner
from aleator.study import Study, load_study
from aleator.tasks.identification import load
from aleator.tasks.recover import recover as recover_law

RECOVERY = "recovery.json"


@click.command()
@click.argument("study", type=FILE, metavar="STUDY.toml")
@click.option(
    "--replicates",
    type=click.IntRange(min=2),
    default=40,
    show_default=True,
    help="Number of virtual data sets.",
)
@click.option(
    "--output",
    type=FOLDER,
    metavar="DIR",
    help="Write DIR/recovery.json, with every replicate.",
)
@SEED
@click.option(
    "--law",
    type=RESULT,
    metavar="IDENTIFICATION.json",
    help="Take the true law from there [default: the study is identified first].",
)
@click.option(
    "--truth",
    multiple=True,
    metavar="NAME=VALUE",
    help="The true value of one hyperparameter, such as v.sd=0.03; may be given several times.",
)
@makes_runs
def recover(
    study: Path,
    replicates: int,
    output: Path | None,
    seed: int | None,
    law: Path | None,
    truth: tuple[str, ...],
    options: RunOptions,
) -> None:
    """Check that the method finds a law that is known.

    Draws virtual outcomes of the study's experiments from the simulator under a true law,
    identifies each virtual data set as if it were measured, and tells for each hyperparameter the
    bias with its Monte Carlo error, the scatter, and how often the 95 % interval holds the truth.
    Data sets are identified in as many processes as there are processors, or in N by --workers N.
    """
    value, study_file = load_study(study).overridden(seed, verified=False), study.absolute()
    if output is not None:
        make_place(output / RECOVERY, study_file)
    with running(value, options) as runner, shown(options.quiet) as progress:
        alpha = _truth(value, runner, law, truth, progress)
        found = recover_law(
            runner,
            value.experiments,
            value.inputs,
            alpha,
            noise=value.noise,
            propagation=value.propagation,
            density=value.density,
            search=value.search,
            replicates=replicates,
            seed=value.seed,
            workers=options.workers or os.cpu_count() or 1,
            progress=progress,
        )
    files = []
    document = {"title": value.title, "seed": value.seed, **recovery.document(found)}
    if output is not None:
        document = linked(document, value, study_file, output)
        documents.write_json(document, output / RECOVERY)
        files.append(output / RECOVERY)
    told(recovery, document, files, options.quiet)


def _truth(
    study: Study, runner: Runner, law: Path | None, given: tuple[str, ...], progress: Progress
) -> dict[str, float]:
    """The true alpha: what is given by name, the rest from a law that was or is now identified."""
    free = [h.name for h in study.hyperparameters if h.free]
    values: dict[str, float] = {}
    for entry in given:
        name, _, text = entry.partition("=")
        if name not in free:
            raise AleatorError(
                f"--truth {entry}: the study identifies no '{name}'{nearest(name, free)}",
                f"it identifies {', '.join(free)}",
            )
        try:
            values[name] = float(text)
        except ValueError:
            raise AleatorError(
                f"--truth {entry}: '{text}' is not a number", f"write --truth {name}=0.1"
            ) from None
    if law is not None:
        return {**load(law).values, **values}
    if set(free) <= set(values):
        return values
    result = identified(study, runner, progress)
    return {**{name: value.estimate for name, value in result.alpha.items()}, **values}
