"""`aleator demo`: a synthetic example, from its table and its simulator to a report."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import click

from aleator.cli.identify import REPORT, identify
from aleator.cli.running import output_option
from aleator.errors import AleatorError, short
from aleator.results import documents
from aleator.results.schema import IDENTIFICATION

STUDY = "study.toml"
WRITTEN = {
    STUDY: "the question: table, simulator, laws, noise",
    "cells.csv": "the table: a row for each measured capacity",
    "model.py": "the simulator, a Python function",
    "new.csv": "conditions that were not tested",
    "make_cells.py": "the script that drew the table",
}
"""The files of the example and what each of them is."""

QUESTION = """\
A synthetic example: nobody has cycled these battery cells, a script drew the table from a known
law. The capacity of 18 cells fades as they are cycled, and each cell fades at its own rate. What is
the law of that rate, the parameter `fade`?
"""


@click.command()
@output_option("Folder of the example [default: aleator-demo].")
def demo(output: Path | None) -> None:
    """Identify a synthetic example, and leave its files as a pattern.

    Writes a table, a simulator and study.toml of battery cells into DIR, then does what `aleator
    identify` does: prints the answer, and writes it with its report into DIR/out. A file of DIR
    that has another content is not replaced. Takes some five seconds of a processor.
    """
    folder = output or Path("aleator-demo").absolute()
    write_example(folder)
    click.echo(QUESTION)
    for name, told in WRITTEN.items():
        click.echo(f"  {short(folder / name):<30}{told}")
    study, answer = short(folder / STUDY), folder / "out"
    click.echo(f"\n$ aleator identify {study} --output {short(answer)}\n")
    click.get_current_context().invoke(identify, study=Path(study), output=answer)
    click.echo("\nNext:")
    if (answer / REPORT).exists():
        click.echo(f"  open {short(answer / REPORT)} in a browser")
    new, identification = short(folder / "new.csv"), short(answer / IDENTIFICATION)
    click.echo(
        f'  aleator predict {identification} --at {new} --event "capacity < 80" --no-noise\n'
        f"  edit {study}, and identify again with the command above\n"
        "  aleator new TABLE.csv    writes a first study of your own table"
    )


def write_example(folder: Path) -> None:
    """Write the files of the example into a folder.

    Raises AleatorError, and writes nothing, if one of them is there with another content.
    """
    source = files("aleator.cli") / "battery"
    texts = {name: (source / name).read_text(encoding="utf-8") for name in WRITTEN}
    for name, text in texts.items():
        place = folder / name
        if place.exists() and (not place.is_file() or place.read_bytes() != text.encode()):
            raise AleatorError(
                f"{short(place)} is there already, and is not that of the example",
                "choose another folder with --output, or identify the study that is there: "
                f"aleator identify {short(folder / STUDY)}",
            )
    for name, text in texts.items():
        documents.write_text(text, folder / name)
