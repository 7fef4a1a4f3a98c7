"""The command line: parse, call, print."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from aleator import clutch as wet_clutch
from aleator.errors import AleatorError, nearest
from aleator.identification import Identification
from aleator.identify import identify as identify_law
from aleator.plot import save_figures
from aleator.prediction import predict as predict_outcomes
from aleator.progress import Progress, Silent
from aleator.recovery import recover as recover_law
from aleator.report import documents, live, recovery, terminal
from aleator.simulate import Runner, keeping
from aleator.study import Study, load_study

RUNS = "runs.csv"
IDENTIFICATION = "identification.json"
STOPPED = 130  # what shells report for a program ended by Ctrl-C

_FILE = click.Path(path_type=Path)
_SEED = click.option(
    "--seed", type=click.IntRange(min=0), help="Seed of everything random [default: the study's]."
)


class _Commands(click.Group):
    """Commands whose misuse is one message and exit code 2; a defect keeps its traceback."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except AleatorError as error:
            click.echo(f"aleator: error: {error}", err=True)
            ctx.exit(2)
        except KeyboardInterrupt:
            click.echo("aleator: stopped by Ctrl-C", err=True)
            ctx.exit(STOPPED)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="aleator", prog_name="aleator")
def main() -> None:
    """Identify the probability law of a simulator's uncertain parameters.

    A table of experiments and a simulator go in; the law of the uncertain parameters that best
    explains the measured outcomes comes out, by maximum likelihood, with its uncertainty and a
    check on the simulator itself.

    Exit codes: 0 done, 1 a defect of Aleator or of its surroundings, 2 something in the input or
    on the command line is to be mended (the message says what and how), 130 stopped by Ctrl-C.
    """


@main.command()
@click.argument("study", type=_FILE, metavar="STUDY.toml")
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder of the results [default: out/ and the name of the study's folder].",
)
@_SEED
@click.option(
    "--starts", type=click.IntRange(min=1), help="Starts of the search [default: the study's]."
)
@click.option("--no-verify", is_flag=True, help="Leave out the Monte Carlo check on the simulator.")
@click.option("--keep-runs", is_flag=True, help=f"Write DIR/{RUNS} also when all goes well.")
@click.option("--no-figures", is_flag=True, help="Draw no figures.")
@click.option("--quiet", is_flag=True, help="Print neither progress nor report, only errors.")
def identify(
    study: Path,
    output: Path | None,
    seed: int | None,
    starts: int | None,
    no_verify: bool,
    keep_runs: bool,
    no_figures: bool,
    quiet: bool,
) -> None:
    """Identify the law that STUDY.toml asks for.

    Prints a report and writes DIR/identification.json; for one seed that file is always the same,
    but for its "seconds". Draws DIR/experiments.png (each outcome in its predicted distribution)
    and DIR/calibration.png if matplotlib is installed. Progress goes to the standard error.

    Every completed run of the simulator is kept: if a run fails, or Ctrl-C comes, the runs are
    written to DIR/runs.csv, and the next identification into DIR does not repeat them as long as
    simulator, conditions and parameters are the same. Only the simulator's own package or folder
    is looked at for that: delete the file if anything else that matters has changed.

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
      title = "", seed = 0
      [experiments] id = "id", conditions = every other column, transform = "none" or "log"
                    (both outcomes, measured and simulated, are then in the original unit),
                    delimiter = ",", decimal = "."
      [simulator]   vectorized = false: called once a run with numbers; true: with arrays
      [parameters.NAME] law = "truncated_normal" (box, mean, sd), "normal" (mean, sd) or
                    "constant" (value); each a number, or to be identified within
                    {lower = ..., upper = ..., start = ...}
      [noise]       sd: normal measurement noise, a number or {lower = ..., upper = ...}
      [propagation] method = "response_surface" (tolerance = 0.005, max_runs = 1000, nodes)
                    or "collocation" (nodes, moments = "quadrature" or "expansion", degree)
      [density]     kind = "maximum_entropy" (order = 4) or "gaussian"
      [search]      starts = 10
      [verification] samples = 1000 simulator runs an experiment; 0 = off
    """
    value = load_study(study).overridden(seed, starts, verified=not no_verify)
    folder = output or Path("out") / _name_of(study)
    documents.make_folder(folder)
    runner = value.runner()
    with keeping(runner, folder / RUNS, _say), _shown(quiet) as progress:
        result = _identified(value, runner, progress)
    if keep_runs:
        runner.save(folder / RUNS)
    document = documents.linked(
        result.to_dict(), value.title, study, value.sha256, _outcome_of(value), folder
    )
    documents.write_json(document, folder / IDENTIFICATION)
    files = [str(folder / IDENTIFICATION), *([str(folder / RUNS)] if keep_runs else [])]
    if not no_figures:
        files += _figures(document, folder)
    if not quiet:
        Console().print(terminal.render(document, files))


@main.command()
@click.argument("identification", type=_FILE, metavar="IDENTIFICATION.json")
@click.option(
    "--conditions",
    type=_FILE,
    required=True,
    metavar="NEW.csv",
    help="Table of new conditions, written as the study's table is; it needs no outcomes.",
)
@click.option(
    "--output", type=_FILE, metavar="FILE.csv", help="Write the predictions there, not printed."
)
@click.option(
    "--study",
    type=_FILE,
    metavar="STUDY.toml",
    help="The study file, if it is no longer where the identification says.",
)
@click.option("--quiet", is_flag=True, help="Do not show progress.")
def predict(
    identification: Path, conditions: Path, output: Path | None, study: Path | None, quiet: bool
) -> None:
    """Predict the outcome's distribution for conditions that were never tested.

    Takes the law from IDENTIFICATION.json and the simulator from its study file. For each row of
    NEW.csv: mean, standard deviation, skewness, kurtosis and quantiles of the outcome as it would
    be measured, noise included; of its logarithm where the study says transform = "log". A file
    holds the conditions too.
    """
    document = documents.read_json(identification)
    alpha = documents.estimates(document, identification)
    value = load_study(study or documents.study_file(document, identification))
    if value.sha256 != (document.get("study") or {}).get("sha256"):
        click.echo(f"aleator: note: {value.file} has changed since the identification", err=True)
    table = value.read_conditions(conditions)
    with _shown(quiet) as progress:
        progress.stage("prediction")
        runner = value.runner(table)
        found = predict_outcomes(
            runner,
            table,
            value.inputs,
            alpha,
            noise=value.noise,
            propagation=value.propagation,
            density=value.density,
            progress=progress,
        )
    if output is not None:
        for name in reversed([name for name in table.conditions if name not in found]):
            found.insert(1, name, table.conditions[name].to_numpy())
        documents.write_text(found.to_csv(index=False, lineterminator="\n"), output)
        click.echo(f"Written: {output}")
    else:
        Console().print(terminal.render_predictions(found.to_dict("list"), _outcome_of(value)))


@main.command()
@click.argument("study", type=_FILE, metavar="STUDY.toml")
@click.option(
    "--replicates",
    type=click.IntRange(min=2),
    default=40,
    show_default=True,
    help="Number of virtual data sets.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes that identify at once; the answer is the same [default: one a core].",
)
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write DIR/recovery.json, with every replicate.",
)
@_SEED
@click.option(
    "--law",
    type=_FILE,
    metavar="IDENTIFICATION.json",
    help="Take the true law from there [default: the study is identified first].",
)
@click.option(
    "--truth",
    multiple=True,
    metavar="NAME=VALUE",
    help="The true value of one hyperparameter, such as v.sd=0.03; may be given several times.",
)
@click.option("--quiet", is_flag=True, help="Do not show progress.")
def recover(
    study: Path,
    replicates: int,
    workers: int | None,
    output: Path | None,
    seed: int | None,
    law: Path | None,
    truth: tuple[str, ...],
    quiet: bool,
) -> None:
    """Check that the method finds a law that is known.

    Draws virtual outcomes of the study's experiments from the simulator under a true law,
    identifies each virtual data set as if it were measured, and tells for each hyperparameter the
    bias with its Monte Carlo error, the scatter, and how often the 95 % interval holds the truth.
    """
    value = load_study(study).overridden(seed, verified=False)
    with _shown(quiet) as progress:
        runner = value.runner()
        alpha = _truth(value, runner, law, truth, progress)
        found = recover_law(
            runner,
            value.model,
            value.search,
            alpha,
            replicates=replicates,
            seed=value.seed,
            workers=workers or os.cpu_count() or 1,
            progress=progress,
        )
    files = []
    document = {"title": value.title, "seed": value.seed, **recovery.document(found)}
    if output is not None:
        documents.write_json(document, output / "recovery.json")
        files.append(str(output / "recovery.json"))
    Console().print(recovery.render(document, files))


@main.group()
def clutch() -> None:
    """The wet clutch, Aleator's benchmark with synthetic measurements."""


@clutch.command()
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Seed of the measurements.")
@click.option(
    "--kind",
    type=click.Choice(["realistic", "model"]),
    default="realistic",
    show_default=True,
    help="A bench richer than the model (temperature, wear), or the model itself at a known law.",
)
@click.option("--output", type=_FILE, metavar="FILE.csv", help="Write it there, not printed.")
def bench(seed: int, kind: str, output: Path | None) -> None:
    """Measure the shifting time of 108 engagements on the virtual test bench.

    The measurements are synthetic: those of the clutch's authors are not public. The same seed
    gives the same table.
    """
    text = wet_clutch.measure(seed, kind=kind).to_csv(index=False, lineterminator="\n")
    if output is None:
        click.echo(text, nl=False)
    else:
        documents.write_text(text, output)
        click.echo(f"Written: {output}")


@contextmanager
def _shown(quiet: bool) -> Iterator[Progress]:
    """Progress on the standard error, or none."""
    with nullcontext(Silent()) if quiet else live.shown_on(Console(stderr=True)) as progress:
        yield progress


def _say(text: str) -> None:
    click.echo(f"aleator: {text}", err=True)


def _identified(study: Study, runner: Runner, progress: Progress) -> Identification:
    runner.progress = progress
    return identify_law(
        runner,
        study.experiments,
        study.inputs,
        noise=study.noise,
        propagation=study.propagation,
        density=study.density,
        search=study.search,
        verification=study.verification,
        seed=study.seed,
        progress=progress,
    )


def _outcome_of(study: Study) -> str:
    """What the likelihood sees of an experiment, as reports and figures call it."""
    name = study.experiments.outcome_name
    return f"log({name})" if study.experiments.transform == "log" else name


def _figures(document: dict[str, Any], folder: Path) -> list[str]:
    """Draw the figures, or say what they need."""
    if importlib.util.find_spec("matplotlib") is None:
        _say("no figures are drawn: they need matplotlib, pip install 'aleator[plot]'")
        return []
    return [str(path) for path in save_figures(document, folder)]


def _name_of(study: Path) -> str:
    """What a study is called: its file, or its folder if the file is just study.toml."""
    return study.resolve().parent.name if study.stem == "study" else study.stem


def _truth(
    study: Study, runner: Runner, law: Path | None, given: tuple[str, ...], progress: Progress
) -> dict[str, float]:
    """The true alpha: what is given by name, the rest from a law that was or is now identified."""
    free = [h.name for h in study.model.hyperparameters if h.free]
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
        return {**documents.estimates(documents.read_json(law), law), **values}
    if set(free) <= set(values):
        return values
    result = _identified(study, runner, progress)
    runner.know(runner.completed)  # the recovery needs the same response surfaces
    return {**{name: value.estimate for name, value in result.alpha.items()}, **values}
