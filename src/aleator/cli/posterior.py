"""`aleator posterior`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

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
from aleator.errors import short
from aleator.inference.posterior import SAMPLER, installed
from aleator.report import posterior as report
from aleator.results import documents
from aleator.study import load_study
from aleator.tasks.posterior import posterior as drawn


@click.command()
@click.argument("study", type=FILE, metavar="STUDY.toml")
@click.option(
    "--draws",
    type=click.IntRange(min=10),
    default=1000,
    show_default=True,
    help="Draws of each chain.",
)
@click.option(
    "--chains", type=click.IntRange(min=2), default=4, show_default=True, help="Number of chains."
)
@SEED
@OUTPUT
@makes_runs
def posterior(
    study: Path,
    draws: int,
    chains: int,
    seed: int | None,
    output: Path | None,
    options: RunOptions,
) -> None:
    """Draw from the posterior of alpha, priors included.

    The study is identified first (without the check on the simulator). Then the No-U-Turn sampler
    draws values of alpha by the exact score of the likelihood; a slow simulator is not run for
    them. What is believed beforehand stands beside the limits in STUDY.toml, and is flat between
    them where nothing does:

    \b
      mean = {lower = 0.5, upper = 1.5, prior = {law = "normal", mean = 1.0, sd = 0.1}}

    Prints mean, standard deviation and 95 % interval of each hyperparameter, with R-hat and the
    effective sample size, and whether the chains converged. Writes DIR/posterior.nc, which ArviZ
    and xarray read, DIR/posterior.csv, a row for each draw, and DIR/posterior.json. Needs
    the packages of the extra bayes, which are told where they are missing.
    docs/statistics/posterior.md explains it.
    """
    for package in (SAMPLER, "arviz_stats", "arviz_base", "h5netcdf"):
        installed(package)
    folder, study_file = folder_of(output, study), study.absolute()
    value = load_study(study).overridden(seed, verified=False)
    make_place(folder / "posterior.json", study_file)
    with running(value, options) as runner, shown(options.quiet) as progress:
        found = identified(value, runner, progress)
        made = drawn(found, draws, chains, value.seed, progress)
    document = linked({**units_in(value), **made.to_dict()}, value, study_file, folder)
    paths = [folder / f"posterior.{kind}" for kind in ("nc", "csv", "json")]
    made.save(paths[0])
    documents.write_text(made.frame().to_csv(index=False), paths[1])
    documents.write_json(document, paths[2])
    if options.quiet:
        click.echo(made.verdict)
    else:
        Console().print(report.render(document, [short(path) for path in paths]))
