"""`aleator predict`: distributions, probabilities or limits of untested conditions."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd

from aleator.cli.running import (
    FILE,
    RESULT,
    RunOptions,
    make_place,
    makes_runs,
    require_at_most_one,
    running,
    show_answer,
    shown,
    units_in,
)
from aleator.core.types import Indices
from aleator.errors import AleatorError, short
from aleator.observations.experiments import Conditions
from aleator.results import documents
from aleator.results.printed import Content, number
from aleator.results.schema import read_answer
from aleator.results.units import label
from aleator.simulators import Runner
from aleator.study import Study, load_study
from aleator.tasks.event_points import SAMPLE
from aleator.tasks.identification import Identification
from aleator.tasks.prediction import compared
from aleator.tasks.probability import Tolerance
from aleator.tasks.session import SAME, Session
from aleator.views import predictions


def expected_runs(document: Mapping[str, Any], runner: Runner) -> Iterator[str]:
    """A note on how many runs the response surfaces of new conditions will take.

    As many are expected for each condition as each experiment of the study took.
    """
    surface = document.get("surface") or {}
    if not (surface.get("runs") and surface.get("experiments")):
        return
    each = max(round(surface["runs"] / surface["experiments"]), 1)
    count = len(runner.cases)
    of = "the new condition" if count == 1 else f"each of {count} new conditions"
    runs = f"{each} runs" if count == 1 else f"{each} runs each"
    known = None if runner.cache is None else runner.cache.at_start
    took = ""
    if known is not None and known.runs:
        second = known.seconds / known.runs
        took = f", {number(second, 2)} s a run, {number(count * each * second, 2)} s in all"
    yield (
        f"note: a surface is made for {of}: {runs}{took}, if it needs as many as in "
        "the identification and none is stored"
    )


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


@dataclass(frozen=True)
class PredictionRequest:
    """The options that say what to predict: a probability, limits, or by default a distribution.

    At most one of `above`, `below`, `between`, `tolerance` and `reliability` is not None; else
    AleatorError is raised.
    """

    above: float | None
    below: float | None
    between: tuple[float, float] | None
    response: str | None
    tolerance: tuple[float, float] | None
    reliability: float | None
    confidence: float
    side: str
    checks: int

    def __post_init__(self) -> None:
        names = ("above", "below", "between", "tolerance", "reliability")
        require_at_most_one({f"--{name}": getattr(self, name) for name in names})

    @property
    def limits(self) -> Tolerance | None:
        """The tolerance limits or the design value that the options request, or None."""
        if self.tolerance is not None:
            return Tolerance(*self.tolerance)
        if self.reliability is not None:
            return Tolerance(self.reliability, self.confidence, self.side)
        return None

    @property
    def distribution(self) -> bool:
        """Whether the whole distribution is predicted, for lack of any other request."""
        return self.limits is None and not any(
            part is not None for part in (self.above, self.below, self.between)
        )

    def table(self, answer: Identification, conditions: Conditions, **how: Any) -> pd.DataFrame:
        """The table of predictions, a row for each new condition.

        `how` are arguments that predictions of distributions, probabilities and limits share.
        """
        if self.distribution:
            return answer.predict(conditions, **how)
        how["response"] = self.response
        if self.limits is not None:
            return answer.tolerance(conditions, **vars(self.limits), **how)
        return answer.probability(
            conditions, above=self.above, below=self.below, between=self.between,
            checks=self.checks, **how,
        )  # fmt: skip

    def content(self, table: pd.DataFrame, outcome: str) -> Content:
        """The table of probabilities or limits, ready to be printed, with its title."""
        columns = table.to_dict("list")
        if self.limits is None:
            return predictions.probabilities(columns, f"Probability of {outcome} {self._event}")
        limits = self.limits
        if limits.side == "both":
            words = f"Limits that hold {limits.content:g} of {outcome}"
        else:
            words = (
                f"Value that {outcome} is {_SIDES[limits.side]} with reliability {limits.content:g}"
            )
        return predictions.limits(columns, f"{words}, with confidence {limits.confidence:g}")

    @property
    def _event(self) -> str:
        if self.between is not None:
            return f"between {self.between[0]:g} and {self.between[1]:g}"
        return f"above {self.above:g}" if self.above is not None else f"below {self.below:g}"


_SIDES = {"upper": "below", "lower": "above"}


def takes_request(command: Callable[..., Any]) -> Callable[..., Any]:
    """A decorator for a command: adds options that reach it as one PredictionRequest, `request`."""

    @click.option("--above", type=float, metavar="X", help="Probability of outcomes above X.")
    @click.option("--below", type=float, metavar="X", help="Probability of outcomes below X.")
    @click.option(
        "--between", type=float, nargs=2, metavar="A B", help="Probability of outcomes between."
    )
    @click.option("--response", metavar="NAME", help="Of this response, where there are several.")
    @click.option(
        "--tolerance",
        type=float,
        nargs=2,
        metavar="P C",
        help="Two limits that hold the share P of the outcomes with confidence C (0.95 0.95).",
    )
    @click.option(
        "--reliability",
        type=float,
        metavar="R",
        help="The design value: the outcome stays on one side of it with probability R (0.999).",
    )
    @click.option(
        "--confidence",
        type=float,
        default=0.95,
        show_default=True,
        metavar="C",
        help="Confidence of the design value.",
    )
    @click.option(
        "--side",
        type=click.Choice(["upper", "lower"]),
        default="upper",
        show_default=True,
        help="The design value is an upper limit (of a load) or a lower one (of a strength).",
    )
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


@click.command()
@click.argument("identification", type=FILE, metavar="IDENTIFICATION.json")
@click.option(
    "--conditions",
    type=FILE,
    required=True,
    metavar="NEW.csv",
    help="Table of new conditions, written as the study's table is; it needs no outcomes.",
)
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
    conditions: Path,
    output: Path | None,
    study: Path | None,
    of: str | None,
    no_noise: bool,
    no_uncertainty: bool,
    request: PredictionRequest,
    options: RunOptions,
) -> None:
    """Predict outcomes of untested conditions.

    Takes the law from IDENTIFICATION.json and the simulator from its study file. For each row of
    NEW.csv: mean, standard deviation, skewness, kurtosis and quantiles of the outcome as it would
    be measured, noise included. With transform = "log", mean and standard deviation are those of
    the logarithm. --output writes a file with the conditions, in which the quantiles are of the
    logarithm too.

    Predictions include the uncertainty of alpha, the hyperparameters: they are a mixture over laws
    that the experiments leave plausible, by the intervals and correlations in IDENTIFICATION.json.
    The file has a 95 % interval of each quantile, too. With --no-uncertainty alpha is taken at its
    estimate.

    With --above, --below or --between: the probability of such an outcome, with a 95 % interval
    and the standard error of the computation, however rare it is. If a response surface stands for
    the simulator, fresh runs all over the law look for regions of failure that the surface lacks.
    More runs are made where the surface leaves open which outcomes are in the event. If the last
    runs still change the probability, the status is "unsettled". `unseen` is the probability of a
    region that the runs do not exclude. `at_estimate` is the probability at the estimate of alpha
    alone, without its uncertainty; the 95 % interval does not belong to it.

    With --tolerance: limits of the outcome; with --reliability: a design value. All are in the unit
    of the outcome, and predict the measured value. To judge whether something fails, the true
    value matters: predict it with --no-noise.

    If experiments have several observations, NEW.csv has a row for each prediction; rows with the
    same id are one new experiment. With --of the rows are further measurements of an experiment
    that was measured; the law of the parameters is then conditional on its own observations.
    """
    new, document = conditions.absolute(), read_answer(identification)
    value = load_study(study or documents.study_file(document, identification))
    if value.sha256 != documents.study_entry(document).get("sha256"):
        click.echo(f"aleator: note: {value.file} has changed since the identification", err=True)
    table = value.read_conditions(Path(short(new)), measured=of is not None)
    if output is not None:
        make_place(output, value.file)
    with (
        running(value, options, table) as runner,
        running(value, options) if of or value.inputs.levels else nullcontext() as measured,
        shown(options.quiet) as progress,
    ):
        answer = _identification(value, document, table, runner, measured, of)
        draws = None if no_uncertainty else answer.draws()
        for note in expected_runs(document, runner):
            options.say(note)
        runner.progress = progress
        found = request.table(
            answer, table, of=SAME if of is not None and of == value.table.id else of,
            noise=not no_noise, uncertainty=draws or False, progress=progress,
        )  # fmt: skip
    if runner.fresh:
        options.say(f"note: {runner.fresh} runs of the simulator were made")
    if draws is not None and draws.fixed.size:
        names = ", ".join(answer.session.hyperparameters[k].name for k in draws.fixed.tolist())
        options.say(f"note: the identification tells no uncertainty of {names}, taken as estimated")
    for note in untested(value, table):
        options.say(note)
    if output is not None:
        row = found["row"].to_numpy() - 1 if "row" in found else _rows_of(found, table)
        for name in reversed([name for name in table.conditions if name not in found]):
            found.insert(1, name, table.conditions[name].to_numpy()[row])
        _write(found, document, value.file, output)
        click.echo(f"Written: {short(output)}")
    else:
        found["id"] = _labels(found, table)
        _show(found, request, value)


def _show(found: pd.DataFrame, request: PredictionRequest, value: Study) -> None:
    """Print the predictions, a table for each response."""
    responses = value.experiments.observations.responses
    parts = {str(name): part for name, part in found.groupby("response", sort=False)} if (
        "response" in found
    ) else {responses[0].name: found}  # fmt: skip
    for response in responses:
        part = parts.get(response.name)
        if part is None:
            continue
        name = label(units_in(value), response.name)
        if request.distribution:
            columns, transform = part.to_dict("list"), str(response.transform)
            show_answer(predictions.distributions(columns, name, transform))
        else:
            show_answer(request.content(part, name))


def _write(found: pd.DataFrame, document: Mapping[str, Any], study: Path, output: Path) -> None:
    """Write the predictions as CSV, or as JSON if the name of the file ends in .json."""
    if output.suffix.lower() == ".json":
        rows = found.to_dict("records")
        entry, file = documents.study_entry(document), os.path.relpath(study, output.parent)
        told = {"title": document.get("title"), "study": {**entry, "file": file}, "rows": rows}
        documents.write_json(told, output)
    else:
        documents.write_text(found.to_csv(index=False, lineterminator="\n"), output)


def _identification(
    value: Study,
    document: Mapping[str, Any],
    table: Conditions,
    runner: Runner,
    measured: Runner | None,
    of: str | None,
) -> Identification:
    """The identification of a document, joined with its simulator so that it can predict.

    `runner` runs the simulator under new conditions, `measured` under those of the study.
    """
    found = Identification.from_document(document)
    if of is not None and not found.observations:
        raise AleatorError(
            f"--of {of}: one outcome says too little of the parameters of its experiment",
            "predict new experiments: leave the option out",
        )

    def made(conditions: object) -> Runner:
        return runner if conditions is table or measured is None else measured

    session = Session.again(
        found, value.file, value.inputs, value.noise, value.experiments, value.propagation,
        value.density, made,
    )  # fmt: skip
    return replace(found, session=session)


def _rows_of(found: pd.DataFrame, table: Conditions) -> Indices:
    """For each prediction, the index of its row in the table; each experiment has one row."""
    place = {name: int(row) for row, name in enumerate(table.ids)}
    return np.array([place[name] for name in found["id"]], dtype=np.intp)


def _labels(found: pd.DataFrame, table: Conditions) -> list[str]:
    """The label of each prediction: the id of its experiment.

    If experiments have several rows, the conditions that vary between rows follow the id.
    """
    if "row" not in found:
        return [str(name) for name in found["id"]]
    cells = table.conditions.iloc[found["row"].to_numpy() - 1]
    varying = [name for name in cells if len(set(cells[name])) > 1]
    words = [
        ", ".join(f"{name} {number(v) if isinstance(v, float) else v}" for name, v in row.items())
        for row in cells[varying].to_dict("records")
    ]
    return [f"{name}, {word}" for name, word in zip(found["id"], words, strict=True)]
