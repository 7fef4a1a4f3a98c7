"""`aleator predict`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from aleator.cli.running import FILE, RunOptions, makes_runs, running
from aleator.cli.showing import shown
from aleator.report import terminal
from aleator.study import load_study
from aleator.tasks.predict import predict as predict_outcomes
from aleator.tasks.results import documents


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
    "--output", type=FILE, metavar="FILE.csv", help="Write the predictions there, not printed."
)
@click.option(
    "--study",
    type=FILE,
    metavar="STUDY.toml",
    help="The study file, if it is no longer where the identification says.",
)
@makes_runs
def predict(
    identification: Path,
    conditions: Path,
    output: Path | None,
    study: Path | None,
    options: RunOptions,
) -> None:
    """Predict the outcome's distribution for conditions that were never tested.

    Takes the law from IDENTIFICATION.json and the simulator from its study file. For each row of
    NEW.csv: mean, standard deviation, skewness, kurtosis and quantiles of the outcome as it would
    be measured, noise included. With transform = "log", mean and standard deviation are those of
    the logarithm. --output writes a file with the conditions, in which the quantiles are of the
    logarithm too.
    """
    document = documents.read_json(identification)
    alpha = documents.estimates(document, identification)
    value = load_study(study or documents.study_file(document, identification))
    if value.sha256 != documents.study_entry(document).get("sha256"):
        click.echo(f"aleator: note: {value.file} has changed since the identification", err=True)
    table = value.read_conditions(conditions)
    with running(value, options, table) as runner, shown(options.quiet) as progress:
        progress.stage("prediction")
        found = predict_outcomes(
            runner,
            table,
            value.inputs,
            alpha,
            noise=value.one_noise,
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
        name, transform = value.experiments.outcome_name, value.experiments.transform
        Console().print(terminal.render_predictions(found.to_dict("list"), name, transform))
