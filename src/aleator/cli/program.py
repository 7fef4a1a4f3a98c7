"""The program `aleator`: its commands, its help, and how errors are reported."""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import click
from click.shell_completion import CompletionItem

from aleator.cli.starting import ended_at_once, ending, termination_heard
from aleator.errors import AleatorError, quoted


@dataclass(frozen=True)
class ProgramSettings:
    """Settings of the process of a command.

    `garbage`: how many new objects Python lets pass before it looks for unused ones again. Python's
    own 700 cost 0.7 of 7 s in `aleator identify examples/sleep_study/correlated.toml`, most of it
    while libraries are imported; the memory grew by 3 %.
    """

    garbage: int = 100_000


PROGRAM = ProgramSettings()

NO_MEMORY = AleatorError(
    "there is no memory left",
    "end other programs, or ask for fewer --workers, and give the same command again: every run "
    "that was made is kept",
)

GROUPS = {
    "start": {
        "demo": "Identify a synthetic example, and leave its files as a pattern.",
        "new": "Write a first study.toml from a table and a simulator.",
        "check": "Make the first runs, and tell what the rest will cost.",
        "sensitivity": "Tell which parameters deserve a law.",
        "box": "Find the largest box in which every experiment works.",
        "schema": "Print the JSON schema of study.toml, for editors.",
    },
    "answer": {
        "identify": "Identify the law that STUDY.toml asks for.",
        "report": "Write report.html of an answer, or of two side by side.",
        "show": "Print a stored answer again.",
        "predict": "Predict outcomes of untested conditions.",
        "pbox": "Bound predictions where hyperparameters are only bounded.",
    },
    "judge": {
        "compare": "Tell which of several models is to be believed.",
        "ceiling": "Tell how far any law could go, and where this one lacks.",
        "bootstrap": "Tell how far the estimates scatter, by a bootstrap.",
        "posterior": "Draw from the posterior of alpha, priors included.",
        "recover": "Check that the method finds a law that is known.",
    },
    "go on": {
        "next": "Tell which experiments should be made next.",
        "runs": "See, export, import or forget the runs that are kept.",
    },
}
"""The name and the help of each command by group, so that `aleator --help` imports no command."""

MODULES = {
    "report": "identify",
    "schema": "new",
    **dict.fromkeys(("check", "sensitivity", "box", "next"), "exploring"),
    **dict.fromkeys(("compare", "ceiling", "bootstrap", "posterior", "recover"), "judging"),
}
"""The module of each command that lies in a module of another name."""

COMMANDS = {name: told for group in GROUPS.values() for name, told in group.items()}
"""All commands with their help, in the order of `aleator --help`."""

LAST = """
Options: -h, --help, --version
Exit codes: 0 done, 1 a defect, 2 mend the input, 130 Ctrl-C, 143 SIGTERM
"""


@contextmanager
def misuse_as_message(ctx: click.Context) -> Iterator[None]:
    """A context that prints wrong input and errors of the operating system as one message.

    The exit code is then 2; Ctrl-C gives 130, SIGTERM 143. A defect of Aleator keeps its traceback.
    """
    heard: list[int] = []
    try:
        with termination_heard() as heard:
            yield
    except AleatorError as error:
        click.echo(f"aleator: error: {quoted(str(error))}", err=True)
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
    except (KeyboardInterrupt, click.Abort) as error:
        if isinstance(error.__context__, EOFError):  # A question met the end of the input.
            click.echo("aleator: error: the input ended before all questions were answered: "
                       "answer them, or give options (--yes takes what is proposed)",
                       err=True)  # fmt: skip
            ctx.exit(2)
        told, code = ending(heard[-1] if heard else signal.SIGINT)
        click.echo(told, err=True)
        ctx.exit(code)


class _Commands(click.Group):
    """The commands of `aleator`; each is imported only when it is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """The names of the commands, in the order of the help."""
        return [*COMMANDS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """The command of this name, imported from its module; None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        with ended_at_once():
            module = import_module(f"aleator.cli.{MODULES.get(cmd_name, cmd_name)}")
        command: click.Command = getattr(module, cmd_name)
        return command

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """The commands and options that begin with `incomplete`; no command is imported."""
        known = [
            CompletionItem(name, help=told)
            for name, told in COMMANDS.items()
            if name.startswith(incomplete)
        ]
        return [*known, *click.Command.shell_complete(self, ctx, incomplete)]

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the help on one screen, with a line for each command."""
        formatter.write(
            "Usage: aleator COMMAND ...   `aleator COMMAND --help` tells all of one.\n\n"
        )
        formatter.write(f"{(self.help or '').splitlines()[0]}\n\n")
        for group, commands in GROUPS.items():
            for k, (name, told) in enumerate(commands.items()):
                formatter.write(f"{'' if k else group:<8}{name:<13}{told}\n")
        formatter.write(LAST)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command, with errors reported as `misuse_as_message` does."""
        gc.set_threshold(PROGRAM.garbage)
        if not faulthandler.is_enabled() and sys.stderr is sys.__stderr__ and sys.stderr:
            faulthandler.enable()  # A crash of compiled code then prints where it happened.
        with suppress(OSError):  # The current folder may have been removed.
            ctx.obj = os.getcwd()
        with misuse_as_message(ctx):
            return super().invoke(ctx)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="aleator", prog_name="aleator")
def main() -> None:
    """Identify the law of a simulator's uncertain parameters from experiments.

    By maximum likelihood, with its uncertainty and a check on the simulator itself.
    """
