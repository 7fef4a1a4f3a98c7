"""`aleator new`."""

from __future__ import annotations

import os
from pathlib import Path

import click

from aleator.cli.asking import Questions, at_terminal
from aleator.cli.choosing import (
    Asked,
    chosen_offer,
    chosen_outcomes,
    chosen_parameters,
    chosen_table,
)
from aleator.cli.running import FILE, RESULT
from aleator.cli.schema import schema_text
from aleator.errors import AleatorError, short
from aleator.results import documents
from aleator.study.offers import bound
from aleator.study.proposal import proposed, roles_of
from aleator.study.proposal_text import notes, study_text
from aleator.study.proposed_laws import laws_for
from aleator.study.roles import count_of, sheet_of

SCHEMA = "study.schema.json"


@click.command()
@click.argument("table", type=FILE, metavar="[TABLE.csv]", required=False)
@click.option("--function", metavar="FILE.py:NAME", help="A Python function is the simulator.")
@click.option("--fmu", type=FILE, metavar="FILE.fmu", help="An FMU is the simulator.")
@click.option(
    "--command",
    metavar="TEXT",
    help="A program is the simulator: './spring {force} {stiffness}' prints the outcome.",
)
@click.option(
    "--outcome", multiple=True, metavar="COLUMN", help="The measured column; may be several."
)
@click.option("--id", metavar="COLUMN", help="Rows with the same value are one experiment.")
@click.option(
    "--parameter",
    "parameters",
    multiple=True,
    metavar="NAME[=LOW:HIGH]",
    help="It differs between experiments, within limits; NAME=NUMBER is a constant.",
)
@click.option(
    "--series", is_flag=True, help="A run serves all rows of an experiment: arrays of times."
)
@click.option(
    "--output",
    type=RESULT,
    default="study.toml",
    show_default=True,
    metavar="FILE.toml",
    help="The study file that is written.",
)
@click.option("--schema", is_flag=True, help="Write study.schema.json beside it, for editors.")
@click.option("--yes", is_flag=True, help="Ask nothing: take what is proposed.")
@click.option("--force", is_flag=True, help="Replace the study file if it is there.")
def new(
    table: Path | None,
    function: str | None,
    fmu: Path | None,
    command: str | None,
    outcome: tuple[str, ...],
    id: str | None,
    parameters: tuple[str, ...],
    series: bool,
    output: Path,
    schema: bool,
    yes: bool,
    force: bool,
) -> None:
    """Write a first study.toml from a table and a simulator.

    Asks for what the options do not say, and proposes an answer: the columns by what the
    simulator takes, a law for each parameter that a function has no default for, limits of a
    factor of three about a default or an FMU's start value. Nothing is simulated. Where no terminal
    is at hand, it takes what it proposes.

    \b
      aleator new springs.csv --function model.py:spring
      aleator new springs.csv --function model.py:spring --parameter stiffness=1:3
      aleator new tanks.csv --fmu tank.fmu --id tank --outcome level
      aleator new springs.csv --command './spring {force} {stiffness}'

    What cannot be known is left as a line that says FILL IN.
    """
    questions = Questions(at_terminal() and not yes)
    _require_free(output, force, questions)
    asked = Asked(questions, output.parent)
    path = chosen_table(asked, table)
    sheet = sheet_of(path)
    offer = bound(chosen_offer(asked, function, fmu, command), sheet.names)
    outcomes = chosen_outcomes(asked, sheet, offer, outcome)
    roles = roles_of(sheet, offer, outcomes)
    named = asked.id(sheet, roles, id)
    most = laws_for(count_of(sheet.table, named), len(sheet.table))
    laws = chosen_parameters(asked, offer, roles, most, parameters)
    file = Path(os.path.relpath(path.absolute(), output.parent)).as_posix()
    proposal = proposed(sheet, file, _title(path), offer, outcomes, named, laws, series)
    if schema:
        documents.write_text(schema_text(), output.with_name(SCHEMA))
    documents.write_text(study_text(proposal, SCHEMA if schema else None), output)
    for line in notes(proposal):
        click.echo(f"  {line}")
    click.echo(f"Written: {short(output)}")
    if proposal.incomplete:
        click.echo(f"Fill in: {', '.join(proposal.incomplete)}")
        if lacking := [p.name for p in proposal.parameters if not p.complete]:
            said = " ".join(f"--parameter {name}=LOW:HIGH" for name in lacking)
            click.echo(f"Or add to the same command: {said} --force")
    click.echo(f"Next: aleator check {short(output)}")


def _require_free(output: Path, force: bool, questions: Questions) -> None:
    """A file that is there is replaced only if the user says so."""
    if not output.exists() or force or questions.agreed(f"{short(output)} is there. Replace it?"):
        return
    raise AleatorError(
        f"{short(output)} is there already", "--output another name, or --force to replace it"
    )


def _title(table: Path) -> str:
    words = table.stem.replace("_", " ").replace("-", " ")
    return words[:1].upper() + words[1:]
