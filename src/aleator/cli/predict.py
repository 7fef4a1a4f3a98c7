"""`aleator predict`: distributions, probabilities or limits of untested conditions."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from aleator.cli.running import (
    FILE,
    RESULT,
    RunOptions,
    joined,
    make_place,
    makes_runs,
    require_at_most_one,
    require_folder,
    running,
    show_answer,
    tell_expected_runs,
    units_in,
)
from aleator.core.arithmetic import share_of
from aleator.errors import AleatorError, count, short
from aleator.inference.diagnostics import plausible_warnings
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.outcome_question import Tolerance
from aleator.observations.experiments import Conditions, conditions_at
from aleator.observations.noise import noise_columns
from aleator.results import documents
from aleator.results.printed import Content
from aleator.results.schema import answer_file, read_answer
from aleator.results.units import label
from aleator.results.values import PlausibleLaws
from aleator.simulators import Runner
from aleator.study import Study, load_study
from aleator.tasks.event_points import SAMPLE
from aleator.tasks.identification import Identification
from aleator.tasks.prediction import compared
from aleator.tasks.session import Runners, runners_like
from aleator.views import predictions


def untested(value: Study, table: Conditions, named: int = 5) -> list[str]:
    """Notes on the rows of new conditions that lie beyond those of the study's experiments.

    The first `named` rows have a note each; one more note counts the rest.
    """
    tested, new = value.experiments.table, table.table
    columns = [*table.conditions, *value.inputs.covariates]
    levels = value.inputs.levels.values()
    names = [n for n in dict.fromkeys(columns) if n in tested and n in new and n not in levels]
    found = compared(tested[names], new[names])
    every = [
        f"note: beyond the tested conditions: {place}: {why}"
        for place, why in zip(table.places, found.why, strict=True)
        if why
    ]
    rest = len(every) - named
    return every if rest <= 0 else [*every[:named], f"note: and {rest} more rows"]


def without_values(found: pd.DataFrame, runner: Runner) -> Iterator[str]:
    """Notes on new conditions whose runs fail, with the simulator's reason, or are infinite."""
    rows = int(np.sum(found["status"] == "runs_failed")) if "status" in found else 0
    if rows:
        kept, (_, straight) = runner.failures, runner.lost
        failure = (kept if len(kept) else straight).frequent_failure()
        silent = "the simulated outcome is no number, or has no logarithm"
        why = failure.message if failure else silent
        yield f"note: runs fail in {rows} of {count(len(found), 'row')}, most often: {why}"
    numbers = found.select_dtypes(np.number).drop(columns="beyond", errors="ignore")
    endless = int(np.isinf(numbers).any(axis=1).sum())
    if endless:
        yield (
            f"note: the simulator returns infinity in {endless} of {count(len(found), 'row')}; "
            "see whether the conditions are possible"
        )


def _drawn(plausible: PlausibleLaws | None) -> Iterator[str]:
    """Notes on how plausible laws were drawn, where normal draws do not agree with the likelihood.

    None for an answer of an earlier version, of which this is not known.
    """
    if plausible is None:
        return
    if plausible.status == "by_likelihood":
        yield (
            "note: the laws that the experiments leave plausible were drawn by the likelihood "
            f"(effective number {plausible.effective:.0f}): normal draws do not agree with it"
        )
    for warning in plausible_warnings(plausible):
        yield f"warning: {warning.message}. Remedy: {warning.remedy}"


@dataclass(frozen=True)
class PredictionRequest:
    """The options that say what to predict: a probability, limits, or by default a distribution.

    `event` and `tolerance` contradict each other; `side` and `outcome` are for the tolerance. Else
    AleatorError is raised.
    """

    event: str | None
    tolerance: tuple[float, float] | None
    side: str
    outcome: str | None
    checks: int

    def __post_init__(self) -> None:
        require_at_most_one({"--event": self.event, "--tolerance": self.tolerance})
        for name, default in (("side", "both"), ("outcome", None)):
            if getattr(self, name) != default and self.tolerance is None:
                raise AleatorError(
                    f"--{name} says which tolerance limits are meant", "add --tolerance 0.95 0.95"
                )
        try:
            _ = self.limits
        except AleatorError as error:
            raise AleatorError(
                f"--tolerance: {error.problem}",
                "write --tolerance 0.95 0.90: the content, then the confidence",
            ) from None

    @property
    def limits(self) -> Tolerance | None:
        """The tolerance limits that the options request, or None."""
        return None if self.tolerance is None else Tolerance(*self.tolerance, self.side)

    def table(self, answer: Identification, at: Conditions, **how: Any) -> pd.DataFrame:
        """The table of predictions, a row for each new condition.

        `how` are arguments that predictions of distributions, probabilities and limits share.
        """
        if self.event is not None:
            return answer.probability(self.event, at, checks=self.checks, **how)
        if self.limits is not None:
            limits = self.limits
            return answer.tolerance(
                limits.content, limits.confidence, at, side=limits.side, outcome=self.outcome, **how
            )
        return answer.predict(at, **how)

    def content(self, table: pd.DataFrame, document: Mapping[str, Any]) -> Content:
        """The table of one outcome, ready to be printed, with its title.

        `document` has the units and the transform of each outcome.
        """
        columns, limits, name = table.to_dict("list"), self.limits, str(table["outcome"].iloc[0])
        shown = label(document, name)
        if self.event is not None:
            event = OutcomeEvent.of(self.event, [name], document["units"])
            return predictions.probabilities(columns, " ".join(filter(None, [
                f"Probability of {event}", document["units"].get(name)])))  # fmt: skip
        if limits is None:
            return predictions.distributions(columns, shown, document["responses"][name])
        words = {
            "both": f"Limits that hold {limits.content:g} of {shown}",
            "upper": f"Value that {shown} is below with reliability {limits.content:g}",
            "lower": f"Value that {shown} is above with reliability {limits.content:g}",
        }[limits.side]
        return predictions.limits(columns, f"{words}, with confidence {limits.confidence:g}")


def _shares(_: object, __: object, given: tuple[str, str] | None) -> tuple[float, float] | None:
    """The two shares of an option, each written as 0.95 or 95%."""
    if given is None:
        return None
    content, confidence = map(share_of, given)
    if content is None or confidence is None:
        raise click.BadParameter(f"'{' '.join(given)}': write two shares, as 0.95 0.9 or 95% 90%")
    return content, confidence


def takes_request(command: Callable[..., Any]) -> Callable[..., Any]:
    """A decorator for a command: adds options that reach it as one PredictionRequest, `request`."""

    @click.option(
        "--event",
        metavar="EVENT",
        help='Probability of this event: "travel > 26" or "20 < travel < 26", with the name of an '
        "outcome, or of a parameter, and values in its unit.",
    )
    @click.option(
        "--tolerance",
        callback=_shares,
        nargs=2,
        metavar="P C",
        help="Two limits that hold the share P of the outcomes with confidence C (0.95 0.95).",
    )
    @click.option(
        "--side",
        type=click.Choice(["both", "upper", "lower"]),
        default="both",
        show_default=True,
        help="One tolerance limit only, the design value for a reliability: an upper limit (of a "
        "load) or a lower one (of a strength).",
    )
    @click.option("--outcome", metavar="NAME", help="Tolerance limits of this outcome, not of all.")
    @click.option(
        "--checks",
        type=click.IntRange(min=0),
        default=SAMPLE.checks,
        show_default=True,
        metavar="N",
        help="Runs of the simulator for each row that a probability by a surface is held against.",
    )
    @functools.wraps(command)
    def collected(**given: Any) -> Any:
        chosen = {field.name: given.pop(field.name) for field in fields(PredictionRequest)}
        return command(request=PredictionRequest(**chosen), **given)

    return collected


class _At(click.ParamType[Any]):
    """The type of --at: NAME=VALUES, a pair of texts; else the path of a table."""

    name = "at"

    def convert(self, value: Any, param: Any, ctx: Any) -> Path | tuple[str, str]:
        name, sign, cells = str(value).partition("=")
        if not sign:
            found: Path = FILE.convert(value, param, ctx)
            return found
        return name.strip(), cells

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> Any:
        return FILE.shell_complete(ctx, param, incomplete)


AT = click.option(
    "--at",
    type=_At(),
    multiple=True,
    metavar="NAME=VALUE|NEW.csv",
    help="A condition with its value, or values (force=50,60); several times for several "
    "conditions. Where the study's table has decimal commas they are taken here too, and "
    "semicolons between values: force=7,5;8. Or a table of conditions, written as the study's "
    "table is; it needs no outcomes [default: the conditions of the experiments, each once].",
)
"""The option --at; `requested_conditions` makes conditions of it."""


def requested_conditions(
    value: Study, at: Sequence[Path | tuple[str, str]], of: str | None
) -> Conditions:
    """The conditions that --at gives: a table, values by name, or those of the experiments.

    Values have the decimal sign of the study's table; a semicolon separates those with a comma.
    """
    if not at:
        columns = [*value.taken, *value.inputs.columns, *noise_columns(value.noise)]
        return conditions_at(value.experiments, of, dict.fromkeys(columns))
    tables = [one for one in at if isinstance(one, Path)]
    if tables and len(at) > 1:
        raise AleatorError(
            f"--at {short(tables[0].absolute())} is a table, and --at is given {len(at)} times",
            "give one table, or values: --at force=50 --at angle=3",
        )
    if tables:
        table = Path(short(tables[0].absolute()))
        return value.read_conditions(table, measured=of is not None)
    stated: dict[str, list[str]] = {}
    between = ";" if value.table.decimal == "," else ","
    for name, cells in (one for one in at if not isinstance(one, Path)):
        if name in stated:
            raise AleatorError(
                f"--at {name}=... is given twice", f"list the values: --at '{name}=1{between}2'"
            )
        stated[name] = [cell.strip() for cell in cells.split(between)]
    try:
        return value.stated_conditions(stated)
    except AleatorError as error:
        raise AleatorError(f"--at: {error.problem}", error.remedy) from None


@click.command()
@click.argument("identification", type=FILE, metavar="IDENTIFICATION.json")
@AT
@click.option(
    "--output",
    type=RESULT,
    metavar="FILE",
    help="Write the table there (.csv or .json), not printed.",
)
@click.option(
    "--study",
    type=FILE,
    metavar="STUDY.toml",
    help="The study file, if it is no longer where the identification says.",
)
@click.option(
    "--of",
    metavar="ID|COLUMN",
    help="Predict further measurements of this experiment, or of those that a column names.",
)
@click.option("--no-noise", is_flag=True, help="Predict what is simulated, without errors.")
@click.option(
    "--no-uncertainty",
    is_flag=True,
    help="Take alpha at its estimate, as if it were known exactly.",
)
@takes_request
@makes_runs
def predict(
    identification: Path,
    at: tuple[Any, ...],
    output: Path | None,
    study: Path | None,
    of: str | None,
    no_noise: bool,
    no_uncertainty: bool,
    request: PredictionRequest,
    options: RunOptions,
) -> None:
    """Predict outcomes of untested conditions.

    Takes the law from IDENTIFICATION.json, or from the file of this name in a folder, and the
    simulator from its study file. For each row of the conditions --at: mean, standard deviation,
    median and 95 % range of the outcome as it would be measured, noise included. With transform =
    "log", mean and standard deviation are those of the logarithm. --output writes a file with
    skewness and kurtosis too, in which the quantiles are of the logarithm, too: its column `scale`
    says so. A note, and the entry "beyond" of a JSON file, name conditions that lie outside the
    range of the experiments, and how far.

    Predictions include the uncertainty of alpha, the hyperparameters: they are a mixture over laws
    that the experiments leave plausible, by the intervals and correlations in IDENTIFICATION.json.
    The file has a 95 % interval of each quantile, too. With --no-uncertainty alpha is taken at its
    estimate.

    With --event: its probability, with a 95 % interval and the standard error of the computation,
    however rare it is. It is the mean over the plausible laws. The interval holds 95 % of them, and
    is widened to contain this mean and `at_estimate`, the probability at the estimate of alpha
    alone, which files have. If a response surface stands for the simulator, fresh runs all over the
    law look for regions of failure that the surface lacks. More runs are made where the surface
    leaves open which outcomes are in the event. If the last runs still change the probability, the
    status is "unsettled". `unseen` is the largest probability of a region that the runs all over
    the law do not exclude, in all their rounds. Those of --checks do not count: they lie near the
    event that the surface shows, and lower +-. The event may be one of a parameter ("gap > 15"):
    the share of its law there, or with --of the probability for one experiment. It takes no run,
    and only the conditions that the law follows.

    With --tolerance: limits of the outcome, or with --side one limit, a design value. All are in
    the unit of the outcome, and predict the measured value. The life that 90 % exceed (B10, L10)
    with 90 % confidence is --tolerance 0.9 0.9 --side lower. To judge whether something fails, the
    true value matters: predict it with --no-noise if [noise] is the error of a measurement. If it
    stands for an error of the model or for scatter of the part itself, keep it.

    If experiments have several observations, NEW.csv has a row for each prediction; rows with the
    same id are one new experiment. With --of the rows are further measurements of an experiment
    that was measured; the law of the parameters is then conditional on its own observations. With
    levels an experiment belongs to the group that the conditions name, or to a new one.
    """
    folder = None if output is None else output.parent
    require_folder(options, folder)
    at = tuple(one.absolute() if isinstance(one, Path) else one for one in at)
    identification = answer_file(identification)
    document = read_answer(identification)
    value = load_study(study or documents.study_file(document, identification))
    if value.sha256 != documents.study_entry(document).get("sha256"):
        click.echo(f"aleator: note: {value.file} has changed since the identification", err=True)
    asked = value
    if request.event is not None:
        simulated = value.experiments.observations.names
        event = OutcomeEvent.of(request.event, simulated, value.units, value.inputs.names)
        asked = value.for_event(event)
    table = requested_conditions(asked, at, of)
    if output is not None:
        make_place(output, value.file)
    for note in untested(value, table):  # Before the runs, which may fail there.
        options.say(note)
    with (
        running(value, options) as measured,
        options.shown(folder, value.title) as progress,
    ):
        like = runners_like(measured, value.experiments)
        runner = like(table) if asked is value else asked.runner(table)
        answer = _identification(
            value, document, lambda at: runner if at is table else like(at), of
        )
        draws = None if no_uncertainty else answer.draws()
        if asked is value:
            event_asked = request.event is not None
            tell_expected_runs(options, answer.surface, runner, "new condition", event=event_asked)
        if options.watch is not None:
            options.watch.counts(lambda: runner.runs)
        runner.progress = progress
        found = request.table(
            answer, table, of=of, noise=not no_noise, uncertainty=not no_uncertainty,
            progress=progress,
        )  # fmt: skip
    if draws is not None and draws.fixed.size:
        names = ", ".join(answer.session.hyperparameters[k].name for k in draws.fixed.tolist())
        options.say(f"note: the identification tells no uncertainty of {names}, taken as estimated")
    for note in _drawn(answer.plausible) if draws is not None else ():
        options.say(note)
    for note in without_values(found, runner):
        options.say(note)
    made = {
        "title": document.get("title"), **units_in(value), "request": vars(request),
        "beyond": found.attrs["beyond"], "plausible": found.attrs.get("plausible"),
        "rows": found.to_dict("records"),
    }  # fmt: skip
    if output is None:
        for content in predicted(made):
            show_answer(content)
        return
    if output.suffix.lower() == ".json":
        file = os.path.relpath(value.file, output.parent)
        entry = {**documents.study_entry(document), "file": file}
        documents.write_json({**made, "study": entry}, output)
    else:
        outcomes = [label(made, name) for name in found["outcome"]]
        written = _labelled(found, made).assign(outcome=outcomes)
        documents.write_text(written.to_csv(index=False, lineterminator="\n"), output)
    if options.watch is not None:
        options.watch.link([output])
    click.echo(f"Written: {short(output)}")


def predicted(document: Mapping[str, Any]) -> Iterator[Content]:
    """The reports of predictions, one for each outcome, from the content of their JSON file."""
    request, found = PredictionRequest(**document["request"]), pd.DataFrame(document["rows"])
    found = found.assign(**dict.fromkeys(found.columns[found.isna().all()], np.nan))
    if "beyond" in found:  # JSON has no infinity, which stands for conditions of another kind.
        found["beyond"] = found["beyond"].fillna(np.inf)
    for _, part in found.groupby("outcome", sort=False):
        yield request.content(_labelled(part, document), document)


def _labelled(found: pd.DataFrame, document: Mapping[str, Any]) -> pd.DataFrame:
    """The predictions with the units of the conditions in the heads of their columns."""
    conditions = [*found.columns][: [*found.columns].index("outcome")]
    return found.rename(columns={name: label(document, name) for name in conditions})


def _identification(
    value: Study,
    document: Mapping[str, Any],
    runner: Runners,
    of: str | None,
) -> Identification:
    """The identification of a document, joined with its simulator so that it can predict."""
    if of is not None and not document.get("observations"):
        raise AleatorError(
            f"--of {of}: one outcome says too little of the parameters of its experiment",
            "predict new experiments: leave the option out",
        )
    return joined(value, document, runner)
