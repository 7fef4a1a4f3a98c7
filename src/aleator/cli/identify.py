"""`aleator identify` and `aleator report`: an identification, and its page of charts."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from aleator.cli.running import (
    FOLDER,
    NO_VERIFY,
    OUTPUT,
    SEED,
    STUDY,
    RunOptions,
    can_draw,
    can_report,
    folder_of,
    identified,
    linked,
    make_place,
    makes_runs,
    name_of,
    require_report,
    running,
    say,
    tell_odd_repeats,
)
from aleator.errors import AleatorError, short
from aleator.observations.gross_errors import slips_of
from aleator.results import documents
from aleator.results.answer import brief
from aleator.results.schema import IDENTIFICATION, read_answer, read_ceiling
from aleator.results.units import label
from aleator.simulators import Budget
from aleator.study import load_study
from aleator.tasks.identification import pictured
from aleator.views.figures import save_figures
from aleator.views.identification import render
from aleator.views.terminal import terminal

REPORT = "report.html"
COMPARED = "compared.html"
CEILING = "ceiling.json"
INDIVIDUALS = "individuals.csv"

Document = Mapping[str, Any]


def write_report(document: Document, folder: Path, study: Path | None = None) -> Path:
    """Write report.html of an identification into its folder.

    The page also shows ceiling.json of that folder, and the `study` file. Raises AleatorError if
    Bokeh is not installed.
    """
    from aleator.views.page import page

    path = folder / REPORT
    documents.write_text(
        page(document, _ceiling(document, folder), _study_text(document, study)), path
    )
    return path


def write_compared(document: Document, other: Document, folder: Path, beside: Path) -> Path:
    """Write compared.html, which shows two identifications under the names of their folders."""
    from aleator.views.compared import compared_page

    names = [folder.name, beside.name]
    if names[0] == names[1]:
        names = [str(folder), str(beside)]
    if names[0] == names[1]:
        raise AleatorError(f"{folder}: it is compared with itself", "name another folder")
    path = folder / COMPARED
    pair = dict(zip(names, (document, other), strict=True))
    documents.write_text(compared_page(pair), path)
    return path


def study_of(document: Document, folder: Path) -> Path | None:
    """The path of the study file that an identification's document names, or None."""
    file = documents.study_entry(document).get("file")
    return folder / file if isinstance(file, str) else None


def _ceiling(document: Document, folder: Path) -> Document | None:
    """The content of ceiling.json in the folder; None if there is none, or for another study."""
    if not (folder / CEILING).exists():
        return None
    found = read_ceiling(folder / CEILING)
    same = documents.study_entry(found).get("sha256")
    return found if same == documents.study_entry(document).get("sha256") else None


def _study_text(document: Document, study: Path | None) -> str | None:
    """The text of the study file; None if the file has changed since the identification."""
    try:
        content = b"" if study is None else study.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(content).hexdigest() != documents.study_entry(document).get("sha256"):
        return None
    return content.decode("utf-8", "replace")


@click.command()
@click.argument("folder", type=FOLDER, metavar="DIR")
@click.option(
    "--compare",
    "other",
    type=FOLDER,
    metavar="OTHER",
    help="Put the identification in OTHER beside it: DIR/compared.html.",
)
def report(folder: Path, other: Path | None) -> None:
    """Write report.html of an answer, or of two side by side.

    DIR/report.html is a page of charts in one file that needs no network: the law, the estimates,
    measured against predicted outcomes, calibration, warnings, and how all was computed. `aleator
    identify` writes it too; this command writes it anew from DIR/identification.json, and from
    DIR/ceiling.json if `aleator ceiling` has written that. No run of the simulator is made.

    With --compare it writes DIR/compared.html: both verdicts, estimates, laws and predictions side
    by side.
    """
    require_report()
    document = read_answer(folder / IDENTIFICATION)
    if other is None:
        path = write_report(document, folder, study_of(document, folder))
    else:
        path = write_compared(document, read_answer(other / IDENTIFICATION), folder, other)
    click.echo(f"Written: {short(path)}")


@click.command()
@STUDY
@OUTPUT
@SEED
@click.option(
    "--starts",
    type=click.IntRange(min=1),
    help="Starts of the gradient search [default: the study's].",
)
@NO_VERIFY
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
    """Identify the law that STUDY.toml asks for.

    Prints a report (with --quiet only the estimates and whether both verdicts are good) and writes
    DIR/identification.json. With the same seed that file is always the
    same, except for its entry "seconds". Writes DIR/report.html, a page of charts that needs no
    network, if Bokeh is installed. If matplotlib is installed, draws DIR/experiments.png (measured
    beside predicted outcomes) and DIR/calibration.png, and with measurement noise
    DIR/parameters.png. Where the parameters of single experiments are known, DIR/individuals.csv
    has a row for each experiment: mean, standard deviation and 95 % range of each parameter, with
    units. Progress goes to the standard error.

    Every run of the simulator is kept in a store, runs.sqlite beside the study, as soon as it is
    known: after Ctrl-C, a failed run or a power cut the same command goes on from there, to the
    same result. Every study in that folder begins with the runs that are there, if simulator,
    conditions and parameters are equal. (A simulator that takes arrays and is run at every node is
    an exception: its runs are not kept.) Whether the simulator is the same is judged by the source
    of its package or folder: see `aleator runs --help` if anything else that matters has changed.

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

    docs/study.md explains all keys, and `aleator schema` tells them to an editor.
    """
    folder, study_file = folder_of(output, study), study.absolute()
    value = load_study(study).overridden(seed, starts, verified=not no_verify)
    make_place(folder / IDENTIFICATION, study_file)
    tell_odd_repeats(value, options)
    for slip in slips_of(value.experiments):
        options.say(f"warning: {slip} If so, stop (Ctrl-C) and correct the table.")
    for line in () if options.quiet else value.simulator_notes():
        say(f"{value.simulator.name}, {line}")
    with (
        running(value, options) as runner,
        options.shown(folder, value.title or name_of(study)) as progress,
    ):
        budget = Budget(max_runs, max_hours)
        result = identified(
            value, runner, progress, best_law=True, budget=budget, questions=value.questions
        )
        if not no_figures:
            result = pictured(result, progress)
    simulator = {
        "name": value.simulator.name,
        "notes": value.simulator_notes(),
        "fingerprint": value.simulator.fingerprint(),
        "defaults": value.defaults_left(),
    }
    made = result.to_dict() | {"simulator": simulator}
    document = linked(made, value, study_file, folder)
    documents.write_json(document, folder / IDENTIFICATION)
    files = [folder / IDENTIFICATION]
    individuals = result.individuals.rename(columns=lambda name: label(document, name))
    if len(individuals):
        files.append(folder / INDIVIDUALS)
        documents.write_text(individuals.to_csv(lineterminator="\n"), files[-1])
    if not no_figures and can_draw(quiet=options.quiet):
        files += save_figures(document, folder)
    if not no_figures and can_report(quiet=options.quiet):
        files.append(write_report(document, folder, study_file))
    if options.watch is not None:
        options.watch.link(files[::-1])
    show_identification(document, [*map(short, files)], details=details, quiet=options.quiet)
    if any(answer.status == "interrupted" for answer in result.answers):
        raise KeyboardInterrupt  # What was computed before is written.


def show_identification(
    document: Document, files: Sequence[str] = (), *, details: bool = False, quiet: bool = False
) -> None:
    """Print the report of an identification with the names of its files.

    If `quiet`, only the estimates and the two verdicts without their reasons.
    """
    shown = terminal(brief(document)) if quiet else render(document, files, details)
    Console().print(shown)
