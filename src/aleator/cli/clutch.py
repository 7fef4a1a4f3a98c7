"""`aleator clutch`: the benchmark that comes with the program."""

from __future__ import annotations

from pathlib import Path

import click

from aleator import clutch as wet_clutch
from aleator.cli.running import FILE, make_place
from aleator.results import documents


@click.group()
def clutch() -> None:
    """The wet clutch: a benchmark with synthetic measurements."""


@clutch.command()
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Seed of the measurements.")
@click.option(
    "--kind",
    type=click.Choice(["realistic", "model"]),
    default="realistic",
    show_default=True,
    help="A bench richer than the model (temperature, wear), or the model itself at a known law.",
)
@click.option("--output", type=FILE, metavar="FILE.csv", help="Write it there, not printed.")
def bench(seed: int, kind: str, output: Path | None) -> None:
    """Measure the shifting time of 108 engagements on the virtual test bench.

    The measurements are synthetic: those of the clutch's authors are not public. The same seed
    gives the same table.
    """
    text = wet_clutch.measure(seed, kind=kind).to_csv(index=False, lineterminator="\n")
    if output is None:
        click.echo(text, nl=False)
    else:
        make_place(output)
        documents.write_text(text, output)
        click.echo(f"Written: {output}")
