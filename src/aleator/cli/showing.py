"""What a command tells its user while it works, and how."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import click
from rich.console import Console

from aleator.errors import AleatorError, installing
from aleator.progress import Progress, Silent
from aleator.views.progress import shown_on


def say(text: str) -> None:
    """A note on the standard error."""
    click.echo(f"aleator: {text}", err=True)


@contextmanager
def shown(quiet: bool) -> Iterator[Progress]:
    """Progress on the standard error, or none."""
    with nullcontext(Silent()) if quiet else shown_on(Console(stderr=True)) as progress:
        yield progress


def can_draw(missing: str = "no figures are drawn: they need", quiet: bool = False) -> bool:
    """Whether matplotlib is there; says what is `missing` where it is not, unless `quiet`."""
    found = importlib.util.find_spec("matplotlib") is not None
    if not (found or quiet):
        say(f"{missing} matplotlib (pip install matplotlib)")
    return found


def can_report(quiet: bool = False) -> bool:
    """Whether Bokeh is there, which draws the charts of report.html; says so where it is not."""
    try:
        require_report()
    except AleatorError as error:
        if not quiet:
            say(f"no report.html is written: {error.problem}. {error.remedy}")
        return False
    return True


def require_report() -> None:
    """Raise AleatorError where Bokeh is not installed, which draws the charts of report.html."""
    try:
        importlib.import_module("bokeh")
    except ModuleNotFoundError:
        raise AleatorError(
            "report.html needs bokeh, which is not installed", installing("report")
        ) from None
