"""`aleator identify`."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from aleator.cli.reporting import write_report
from aleator.cli.running import (
    FILE,
    OUTPUT,
    SEED,
    RunOptions,
    described,
    folder_of,
    identified,
    linked,
    make_place,
    makes_runs,
    running,
)
from aleator.cli.showing import can_draw, can_report, say, shown
from aleator.errors import short
from aleator.inference.check import Check
from aleator.laws import LogNormal
from aleator.results import documents
from aleator.results.answer import answer
from aleator.search import GradientMultistart
from aleator.simulators import Budget
from aleator.study import load_study
from aleator.study.experiments import ExperimentsSection
from aleator.study.keys import in_toml
from aleator.study.sections import StudyFile
from aleator.surrogates import ResponseSurface
from aleator.tasks.pictures import pictured
from aleator.views.figures import save_figures
from aleator.views.identification import render

IDENTIFICATION = "identification.json"


def _defaults(choice: type, *names: str) -> str:
    """The keys of some fields with their defaults, as a study file writes them."""
    known = inspect.signature(choice).parameters
    return ", ".join(f"{name} = {in_toml(known[name].default)}" for name in names)


HELP = f"""Identify the law that STUDY.toml asks for.

Prints a report and writes DIR/identification.json; for one seed that file is always the same,
but for its "seconds". Writes DIR/report.html, a page of charts that needs no network, if Bokeh
is installed. Draws DIR/experiments.png (what was measured beside what is predicted)
and DIR/calibration.png if matplotlib is installed, and with measurement noise
DIR/parameters.png. Progress goes to the standard error.

Every run of the simulator is kept in a store, runs.sqlite beside the study, as soon as it is
known: after Ctrl-C, a failed run or a power cut the same command goes on from there, to the
same result. Every study in that folder reuses a run if simulator, conditions and parameters
are equal. (Of a simulator that takes arrays, and is run at every node, none are kept.) Whether the
simulator is the same is judged by the source of its package or folder: see `aleator runs --help`
if anything else that matters has changed.

\b
A study file (paths are relative to it; all keys but these have defaults):
  [experiments]
  file = "experiments.csv"      # a header, then a row for each experiment
  outcome = "shifting_time"     # the measured column; the others are conditions
  [simulator]
  function = "model.py:shifting_time"   # takes conditions and parameters by name
  [parameters.friction]
  law = "truncated_normal"
  box = [0.05, 0.20]

\b
Further keys, with their defaults:
  {_defaults(StudyFile, "title", "seed")}
  [experiments] id = "id" (rows with the same id are one experiment), conditions = every
                other column, transform = "none" or "log" (both outcomes, measured and
                simulated, are then in the original unit),
                {_defaults(ExperimentsSection, "delimiter", "decimal")};
                outcomes = [...] for several, response = the column
                that says which, censored = {{column, right, left, upper}} for bounds
  [simulator]   vectorized = false: called once a run with numbers; true: with arrays.
                Instead of function: command (a program) or fmu
  [parameters.NAME] law = "truncated_normal", "beta" (box, mean, sd), "normal" (mean,
                sd), "uniform" (box; or mean, sd), "gamma", "lognormal" (mean, sd,
                {_defaults(LogNormal, "lower")}), "scipy" (distribution, args; mean, sd),
                "mixture" (components, shares) or "constant" (value); mean, sd and
                value each a number, or to be identified within {{lower = ...,
                upper = ..., start = ..., prior = {{law = ...}}}}; mean and sd may
                follow columns of the table: mean = "1 + temperature"
  [correlation] a.b: of the parameters a and b, a number or {{lower = ..., upper = ...}}
  [derived]     a = "b * load": parameters from others and from conditions
  [noise]       sd: measurement noise, a number, {{lower = ..., upper = ...}} or a
                column; relative; kind = "normal" or "student_t" (df);
                [noise.RESPONSE] for each response
  [propagation] method = "response_surface" (tolerance: as exact as the answer needs;
                {_defaults(ResponseSurface, "max_runs")}, nodes, surfaces =
                "none", "own" or "shared": left out, none if vectorized) or
                "collocation" (nodes, moments = "quadrature" or "expansion", degree)
  [density]     left out, or kind = "automatic": the exact likelihood, by level sets
                without noise, by an integral over individual parameters with it.
                Without noise one of moments may be chosen: "maximum_entropy"
                (order), "gaussian" or "gaussian_mixture"
  [search]      method = "gradient" ({_defaults(GradientMultistart, "starts", "evaluations")}),
                "genetic", "differential_evolution" or "cmaes"
  [verification] samples: runs of each row or series, at most, for the check on the
                simulator, 0 for none. Left out: up to {Check().most} where surfaces stand
                for it
docs/study.md explains them all.
"""


@click.command(help=HELP)
@click.argument("study", type=FILE, metavar="STUDY.toml")
@OUTPUT
@SEED
@click.option(
    "--starts",
    type=click.IntRange(min=1),
    help="Starts of the gradient search [default: the study's].",
)
@click.option("--no-verify", is_flag=True, help="Leave out the check on the simulator.")
@makes_runs
@click.option(
    "--max-runs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Make at most about N new runs: end with the best answer so far.",
)
@click.option(
    "--max-hours",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="H",
    help="Begin no more runs after so many hours.",
)
@click.option("--no-figures", is_flag=True, help="Draw no figures, and write no report.html.")
@click.option(
    "--details",
    is_flag=True,
    help="Report all surfaces, what other densities than a chosen one would change, and where the "
    "time went, too.",
)
def identify(
    study: Path,
    output: Path | None,
    seed: int | None,
    starts: int | None,
    no_verify: bool,
    max_runs: int | None,
    max_hours: float | None,
    no_figures: bool,
    details: bool,
    options: RunOptions,
) -> None:
    """Identify the law that STUDY.toml asks for; `HELP` says how."""
    folder, study_file = folder_of(output, study), study.absolute()
    value = load_study(study).overridden(seed, starts, verified=not no_verify)
    make_place(folder / IDENTIFICATION, study_file)
    for line in () if options.quiet else value.told():
        say(f"{value.simulator.name}, {line}")
    with running(value, options) as runner, shown(options.quiet) as progress:
        budget = Budget(max_runs, max_hours)
        result = identified(value, runner, progress, best_law=True, budget=budget)
        if not no_figures:
            result = pictured(result, progress)
    called = {"simulator": described(value)}
    document = linked(result.to_dict() | called, value, study_file, folder)
    documents.write_json(document, folder / IDENTIFICATION)
    files = [short(folder / IDENTIFICATION)]
    if not no_figures:
        files += _figures(document, folder, options.quiet)
        files += _report(document, folder, study_file, options.quiet)
    if options.quiet:
        click.echo(answer(document).verdict)
    else:
        Console().print(render(document, files, details))


def _figures(document: dict[str, Any], folder: Path, quiet: bool) -> list[str]:
    """Draw the figures, or say what they need."""
    return [short(path) for path in save_figures(document, folder)] if can_draw(quiet=quiet) else []


def _report(document: dict[str, Any], folder: Path, study: Path, quiet: bool) -> list[str]:
    """Write report.html, or say what it needs."""
    if not can_report(quiet=quiet):
        return []
    return [short(write_report(document, folder, study))]
