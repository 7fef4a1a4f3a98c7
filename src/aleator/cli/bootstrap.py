"""`aleator bootstrap`."""

from __future__ import annotations

from pathlib import Path

import click

from aleator.cli.ending import told
from aleator.cli.running import (
    FILE,
    OUTPUT,
    SEED,
    RunOptions,
    folder_of,
    identified,
    linked,
    make_place,
    makes_runs,
    running,
    units_in,
)
from aleator.cli.showing import shown
from aleator.results import documents
from aleator.study import load_study
from aleator.tasks.bootstrap import FILE as FINISHED
from aleator.tasks.bootstrap import NONPARAMETRIC, PARAMETRIC
from aleator.tasks.bootstrap import bootstrap as resample
from aleator.views import uncertainty


@click.command()
@click.argument("study", type=FILE, metavar="STUDY.toml")
@click.option(
    "--replicates",
    type=click.IntRange(min=2),
    default=200,
    show_default=True,
    help="Number of data sets.",
)
@click.option(
    "--parametric/--experiments",
    default=True,
    show_default=True,
    help="Draw data under the identified law, or draw experiments with replacement.",
)
@OUTPUT
@SEED
@makes_runs
def bootstrap(
    study: Path,
    replicates: int,
    parametric: bool,
    output: Path | None,
    seed: int | None,
    options: RunOptions,
) -> None:
    """Tell how far the estimates scatter, by a bootstrap.

    The study is identified, by the runs in its store where they are known; then other data are
    drawn and the maximum of each is climbed to on the same surfaces, without a run, or by a fast
    simulator itself. Prints standard errors, biases and 95 % intervals; writes DIR/bootstrap.json,
    and DIR/bootstrap.csv with every replicate. Finished replicates are kept in
    DIR/bootstrap.jsonl: after Ctrl-C, and for more replicates, the same command goes on from there.
    With --workers N processes do the work.
    """
    folder, study_file = folder_of(output, study), study.absolute()
    value = load_study(study).overridden(seed, verified=False)
    make_place(folder / "bootstrap.json", study_file)
    with running(value, options) as runner, shown(options.quiet) as progress:
        found = resample(
            identified(value, runner, progress, consistency=False),
            replicates=replicates,
            kind=PARAMETRIC if parametric else NONPARAMETRIC,
            seed=value.seed,
            workers=options.workers or 1,
            folder=folder,
            progress=progress,
        )
    entry = linked({**units_in(value), **found.to_dict()}, value, study_file, folder)
    document = documents.plain(entry)
    documents.write_json(document, folder / "bootstrap.json")
    documents.write_text(found.replicates().to_csv(), folder / "bootstrap.csv")
    files = [folder / name for name in ("bootstrap.json", "bootstrap.csv", FINISHED)]
    told(uncertainty.bootstrap(document), files, options.quiet)
