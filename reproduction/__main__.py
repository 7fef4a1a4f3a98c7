"""`python -m reproduction [FIGURE...]`: what the paper shows, computed anew."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from aleator.cli.program import misuse_as_message
from aleator.cli.running import can_draw, shown
from reproduction.context import Context
from reproduction.document import counts
from reproduction.figure import Made
from reproduction.figures import FIGURES, chosen
from reproduction.output import INDEX, reproduce

_NAMES = "\n".join(f"  {figure.name:<27} {figure.place}" for figure in FIGURES)


@click.command(
    help="Compute the figures and tables of arXiv 1908.04597 anew, and judge its claims.\n\n"
    "For each FIGURE (all without a name): DIR/FIGURE.csv with what is drawn, DIR/FIGURE.png and "
    ".svg if matplotlib is installed. DIR/claims.csv and DIR/index.md set every statement of the "
    "paper beside what was measured here, and say whether it holds. The measurements of the wet "
    "clutch are synthetic, for the authors' are not public. All figures take some minutes.\n\n"
    f"\b\nFigures:\n{_NAMES}"
)
@click.argument("figures", nargs=-1, metavar="[FIGURE...]")
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    default=Path("out/paper"),
    show_default=True,
    help="Folder of the results.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of everything random but the measurements, which are those of the example.",
)
@click.option("--quiet", is_flag=True, help="Print neither progress nor claims, only errors.")
@click.pass_context
def main(
    ctx: click.Context, figures: tuple[str, ...], output: Path, seed: int, quiet: bool
) -> None:
    """Compute the figures of the paper."""
    with misuse_as_message(ctx):
        wanted = chosen(figures)
        can_draw()
        with shown(quiet) as progress:
            made = reproduce(wanted, Context(seed, progress), output)
    if not quiet:
        console = Console()
        console.print(_table(made))
        console.print(counts([claim for m in made for claim in m.claims]))
        console.print(f"Written: {output / INDEX}", soft_wrap=True)


def _table(made: list[Made]) -> Table:
    """Every claim beside what was measured here."""
    table = Table(show_lines=False, padding=(0, 1))
    for heading, ratio in (("figure", 3), ("the paper", 6), ("here", 7), ("verdict", 2)):
        table.add_column(heading, ratio=ratio, overflow="fold")
    for m in made:
        for k, claim in enumerate(m.claims):
            name = f"{m.figure.name} ({m.seconds:.1f} s)" if k == 0 else ""
            said = f"{claim.statement} [{claim.paper}]".replace("[", "\\[")
            table.add_row(name, said, claim.ours.replace("[", "\\["), claim.verdict.value)
        table.add_section()
    return table


if __name__ == "__main__":
    main(prog_name="python -m reproduction")
