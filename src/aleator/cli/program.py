"""The program: its group of commands, and what they share."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from aleator.cli.running import say
from aleator.errors import AleatorError
from aleator.progress import Progress, Silent
from aleator.report import live
from aleator.simulators import Runner
from aleator.study import Study
from aleator.tasks.identify import identify as identify_law
from aleator.tasks.result import Identification

STOPPED = 130  # what shells report for a program ended by Ctrl-C

FILE = click.Path(path_type=Path)
SEED = click.option(
    "--seed", type=click.IntRange(min=0), help="Seed of everything random [default: the study's]."
)


@contextmanager
def misuse_told(ctx: click.Context) -> Iterator[None]:
    """Misuse is one message and exit code 2, Ctrl-C is 130; a defect keeps its traceback."""
    try:
        yield
    except AleatorError as error:
        click.echo(f"aleator: error: {error}", err=True)
        ctx.exit(2)
    except KeyboardInterrupt:
        click.echo("aleator: stopped by Ctrl-C", err=True)
        ctx.exit(STOPPED)


class _Commands(click.Group):
    """Commands that tell misuse in one message."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command."""
        with misuse_told(ctx):
            return super().invoke(ctx)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="aleator", prog_name="aleator")
def main() -> None:
    """Identify the probability law of a simulator's uncertain parameters.

    A table of experiments and a simulator go in; the law of the uncertain parameters that best
    explains the measured outcomes comes out, by maximum likelihood, with its uncertainty and a
    check on the simulator itself.

    Exit codes: 0 done, 1 a defect of Aleator or of its surroundings, 2 something in the input or
    on the command line is to be mended (the message says what and how), 130 stopped by Ctrl-C.
    """


@contextmanager
def shown(quiet: bool) -> Iterator[Progress]:
    """Progress on the standard error, or none."""
    with nullcontext(Silent()) if quiet else live.shown_on(Console(stderr=True)) as progress:
        yield progress


def can_draw(missing: str = "no figures are drawn: they need", quiet: bool = False) -> bool:
    """Whether matplotlib is there; says what is `missing` where it is not, unless `quiet`."""
    found = importlib.util.find_spec("matplotlib") is not None
    if not (found or quiet):
        say(f"{missing} matplotlib, pip install 'aleator[plot]'")
    return found


def identified(study: Study, runner: Runner, progress: Progress) -> Identification:
    """The identification that a study asks for."""
    runner.progress = progress
    return identify_law(
        runner,
        study.experiments,
        study.inputs,
        noise=study.noise,
        propagation=study.propagation,
        density=study.density,
        search=study.search,
        verification=study.verification,
        seed=study.seed,
        progress=progress,
    )


def outcome_of(study: Study) -> str:
    """What the likelihood sees of an experiment, as reports and figures call it."""
    name = study.experiments.outcome_name
    return f"log({name})" if study.experiments.transform == "log" else name


def name_of(study: Path) -> str:
    """What a study is called: its file, or its folder if the file is just study.toml."""
    return study.resolve().parent.name if study.stem == "study" else study.stem
