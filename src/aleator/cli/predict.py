"""`aleator predict`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd
from rich.console import Console

from aleator.cli.deciding import Asked, asks
from aleator.cli.predict_notes import expected_runs, held, made_runs, untested
from aleator.cli.running import (
    FILE,
    RESULT,
    RunOptions,
    make_place,
    makes_runs,
    running,
    units_in,
)
from aleator.cli.showing import shown
from aleator.errors import AleatorError, short
from aleator.inference.alpha_draws import AlphaDraws, alpha_draws, estimated
from aleator.observations.experiments import Conditions
from aleator.report import terminal
from aleator.results import documents
from aleator.results.printed import number
from aleator.results.result import Result
from aleator.results.schema import read_answer
from aleator.results.units import label
from aleator.results.values import QUANTILES, in_order
from aleator.simulators import Runner
from aleator.study import Study, load_study
from aleator.tasks.session import OWN, Session
from aleator.types import Indices


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
@asks
@makes_runs
def predict(
    identification: Path,
    conditions: Path,
    output: Path | None,
    study: Path | None,
    of: str | None,
    no_noise: bool,
    no_uncertainty: bool,
    asked: Asked,
    options: RunOptions,
) -> None:
    """Predict outcomes of untested conditions.

    Takes the law from IDENTIFICATION.json and the simulator from its study file. For each row of
    NEW.csv: mean, standard deviation, skewness, kurtosis and quantiles of the outcome as it would
    be measured, noise included. With transform = "log", mean and standard deviation are those of
    the logarithm. --output writes a file with the conditions, in which the quantiles are of the
    logarithm too.

    The uncertainty of alpha is part of it: a mixture over laws that the experiments leave
    plausible, by the intervals and correlations in IDENTIFICATION.json. The file has a 95 %
    interval of each quantile, too. With --no-uncertainty alpha is taken at its estimate.

    With --above, --below or --between: the probability of such an outcome, with a 95 % interval
    and the standard error of the computation, however rare it is. By a surface, fresh runs of the
    simulator all over the law look for regions of failure that the surface does not have, and more
    are made where it leaves open which outcomes are in the event. Where the last of them still
    change the probability the status is "unsettled", and `unseen` is the probability of a region
    that they do not exclude. `at_estimate` is of the estimate alone; the interval is not its.

    With --tolerance limits of the outcome, with --reliability a design value. All are in the unit
    of the outcome, and of what is measured; --no-noise asks for the true value, as whether
    something fails does.

    Of experiments with several observations NEW.csv has a row for each prediction; rows with the
    same id are one new experiment. With --of they are further measurements of an experiment that
    was measured, under the law that its own observations leave of its parameters.
    """
    new, document = conditions.absolute(), read_answer(identification)
    value = load_study(study or documents.study_file(document, identification))
    if value.sha256 != documents.study_entry(document).get("sha256"):
        click.echo(f"aleator: note: {value.file} has changed since the identification", err=True)
    table = value.read_conditions(Path(short(new)))
    if output is not None:
        make_place(output, value.file)
    with (
        running(value, options, table) as runner,
        running(value, options) if of else nullcontext() as measured,
        shown(options.quiet) as progress,
    ):
        session = _session(value, document, table, runner, measured, of)
        draws = _draws(document, session, no_uncertainty)
        for note in expected_runs(document, runner):
            options.say(note)
        runner.progress = progress
        who = OWN if of is not None and of == value.table.id else of
        if asked.distribution:
            found = session.predict(table, draws, QUANTILES, progress, who, not no_noise)
        else:
            ground = session.ground(table, draws.estimate, who, not no_noise)
            found = asked.table(ground, draws, progress)
    for note in (*made_runs(runner), *held(draws, session), *untested(value, table)):
        options.say(note)
    if output is not None:
        row = found["row"].to_numpy() - 1 if "row" in found else _rows_of(found, table)
        for name in reversed([name for name in table.conditions if name not in found]):
            found.insert(1, name, table.conditions[name].to_numpy()[row])
        _write(found, document, value.file, output)
        click.echo(f"Written: {short(output)}")
    else:
        found["id"] = _labels(found, table)
        _show(found, asked, value)


def _show(found: pd.DataFrame, asked: Asked, value: Study) -> None:
    """Print a table for each response."""
    responses = value.experiments.observations.responses
    parts = {str(name): part for name, part in found.groupby("response", sort=False)} if (
        "response" in found
    ) else {responses[0].name: found}  # fmt: skip
    for response in responses:
        part = parts.get(response.name)
        if part is None:
            continue
        if asked.distribution:
            columns, transform = part.to_dict("list"), str(response.transform)
            Console().print(
                terminal.render_predictions(
                    columns, label(units_in(value), response.name), transform
                )
            )
        else:
            Console().print(asked.rendered(part, label(units_in(value), response.name)))


def _write(found: pd.DataFrame, document: Mapping[str, Any], study: Path, output: Path) -> None:
    """Write a table as CSV, or as JSON where the file is called so."""
    if output.suffix.lower() == ".json":
        rows = found.to_dict("records")
        entry, file = documents.study_entry(document), os.path.relpath(study, output.parent)
        told = {"title": document.get("title"), "study": {**entry, "file": file}, "rows": rows}
        documents.write_json(told, output)
    else:
        documents.write_text(found.to_csv(index=False, lineterminator="\n"), output)


def _session(
    value: Study,
    document: Mapping[str, Any],
    table: Conditions,
    runner: Runner,
    measured: Runner | None,
    of: str | None,
) -> Session:
    """What predicts; `measured` runs the experiments that were measured."""
    found = Result.from_document(document)
    if of is not None and not found.observations:
        raise AleatorError(
            f"--of {of}: one outcome says too little of the parameters of its experiment",
            "predict new experiments: leave the option out",
        )

    def made(asked: object) -> Runner:
        return runner if asked is table or measured is None else measured

    return Session.again(
        found, value.file, value.inputs, value.noise, value.experiments, value.propagation,
        value.density, made,
    )  # fmt: skip


def _draws(document: Mapping[str, Any], session: Session, known: bool) -> AlphaDraws:
    """Plausible alphas by the document, or the estimate alone where it counts as known."""
    found, hyperparameters = Result.from_document(document), session.hyperparameters
    if known:
        return AlphaDraws.at(in_order(found.alpha, hyperparameters))
    return alpha_draws(
        estimated(found.alpha, found.correlation_names, found.correlation, hyperparameters)
    )


def _rows_of(found: pd.DataFrame, table: Conditions) -> Indices:
    """The row of the table of each prediction, where each experiment has one."""
    place = {name: int(row) for row, name in enumerate(table.ids)}
    return np.array([place[name] for name in found["id"]], dtype=np.intp)


def _labels(found: pd.DataFrame, table: Conditions) -> list[str]:
    """The ids, and of experiments with several rows the conditions that vary."""
    if "row" not in found:
        return [str(name) for name in found["id"]]
    cells = table.conditions.iloc[found["row"].to_numpy() - 1]
    varying = [name for name in cells if len(set(cells[name])) > 1]
    words = [
        ", ".join(f"{name} {number(v) if isinstance(v, float) else v}" for name, v in row.items())
        for row in cells[varying].to_dict("records")
    ]
    return [f"{name}, {word}" for name, word in zip(found["id"], words, strict=True)]
