"""The program: its group of commands, each imported when it is used."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import click

from aleator.cli.starting import ended_at_once, ending, termination_heard
from aleator.errors import AleatorError

NO_MEMORY = AleatorError(
    "there is no memory left",
    "end other programs, or ask for fewer --workers, and give the same command again: every run "
    "that was made is kept",
)

COMMANDS = {
    "new": "Write a first study.toml from a table and a simulator.",
    "check": "Make the first runs: what do they reach, and what will the rest cost?",
    "identify": "Identify the law that STUDY.toml asks for.",
    "report": "Write report.html of an identification, or of two side by side.",
    "predict": "Predict outcomes of untested conditions: distribution, probability, limits.",
    "bootstrap": "Tell how far the estimates scatter, by estimating again from other data.",
    "compare": "Tell which of several models of the same experiments is to be believed.",
    "next": "Tell which experiments should be made next.",
    "posterior": "Draw from the posterior of alpha: what experiments and priors say of it "
    "together.",
    "ceiling": "Tell the log-likelihood of the best of all laws, and where the identified one "
    "lacks mass.",
    "recover": "Check that the method finds a law that is known.",
    "sensitivity": "Tell which parameters deserve a law: whose scatter moves the outcome, and "
    "whose acts alike.",
    "box": "Find the largest box of the parameters in which every experiment has an outcome.",
    "runs": "See, take away, bring in or forget the runs that are kept.",
    "clutch": "The wet clutch, Aleator's benchmark with synthetic measurements.",
}
"""The commands as `aleator --help` lists them, which imports none of them."""


@contextmanager
def misuse_told(ctx: click.Context) -> Iterator[None]:
    """Misuse, and what the machine refuses, is one message and exit code 2, Ctrl-C is 130.

    SIGTERM is 143. A defect keeps its traceback.
    """
    heard: list[int] = []
    try:
        with termination_heard() as heard:
            yield
    except AleatorError as error:
        click.echo(f"aleator: error: {error}", err=True)
        ctx.exit(2)
    except OSError as error:
        from aleator.simulators.surroundings import cause

        if (prevented := cause(error, "the command cannot go on")) is None:
            raise
        click.echo(f"aleator: error: {prevented}", err=True)
        ctx.exit(2)
    except MemoryError:
        click.echo(f"aleator: error: {NO_MEMORY}", err=True)
        ctx.exit(2)
    except (KeyboardInterrupt, click.Abort):
        told, code = ending(heard[-1] if heard else signal.SIGINT)
        click.echo(told, err=True)
        ctx.exit(code)


class _Commands(click.Group):
    """Commands that are imported when they are used, and tell misuse in one message."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Their names, the most used first."""
        return [*COMMANDS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """The command of that name, in the module of that name."""
        if cmd_name not in COMMANDS:
            return None
        with ended_at_once():
            command: click.Command = getattr(import_module(f"aleator.cli.{cmd_name}"), cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """A line for each command."""
        with formatter.section("Commands"):
            formatter.write_dl([*COMMANDS.items()])

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
    on the command line is to be mended (the message says what and how), 130 stopped by Ctrl-C,
    143 by SIGTERM.
    """
