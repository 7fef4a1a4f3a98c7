"""`aleator schema`."""

from __future__ import annotations

import json
from pathlib import Path

import click

from aleator.cli.running import RESULT, make_place
from aleator.errors import short
from aleator.results import documents
from aleator.study.schema import study_schema


@click.command()
@click.option("--output", type=RESULT, metavar="FILE", help="Write it there.")
def schema(output: Path | None) -> None:
    """Print the JSON schema of study.toml, for editors.

    An editor that knows TOML (Even Better TOML in Visual Studio Code, Taplo in others) then offers
    the keys and marks what is wrong while you type. Its first line names the schema; `aleator new
    --schema` writes both.

    \b
      aleator schema --output study.schema.json
      #:schema study.schema.json           <- the first line of study.toml

    It has the kinds of installed plug-ins too.
    """
    text = schema_text()
    if output is None:
        click.echo(text, nl=False)
        return
    make_place(output)
    documents.write_text(text, output)
    click.echo(f"Written: {short(output)}")


def schema_text() -> str:
    """The schema as a file has it."""
    return json.dumps(study_schema(), indent=1, ensure_ascii=False) + "\n"
