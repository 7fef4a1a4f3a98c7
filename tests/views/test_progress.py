import io
import re

from rich.console import Console

from aleator.views.progress import Bars, Lines, shown_on


def console(terminal: bool) -> tuple[Console, io.StringIO]:
    file = io.StringIO()
    return Console(file=file, width=80, force_terminal=terminal, color_system=None), file


def without_times(file: io.StringIO) -> list[str]:
    """The lines of a log, each of which begins with the time of the day."""
    found = [re.fullmatch(r"\d\d:\d\d:\d\d (.*)", line) for line in file.getvalue().splitlines()]
    return [line[1] if line else "" for line in found]


def test_without_a_terminal_there_are_plain_lines() -> None:
    out, file = console(terminal=False)
    with shown_on(out) as progress:
        assert isinstance(progress, Lines)
        progress.stage("search")
        progress.update("start 1 of 10", 1, 10)
        progress.stage("inference")
    assert without_times(file) == ["search ...", "inference ..."]


def test_a_long_stage_is_told_again() -> None:
    out, file = console(terminal=False)
    with Lines(out, interval=0.0) as progress:
        progress.stage("search")
        progress.update("start [1] of 10", 1, 10)
    assert without_times(file) == ["search ...", "search: start [1] of 10"]


def test_on_a_terminal_there_are_bars() -> None:
    out, file = console(terminal=True)
    with shown_on(out) as progress:
        assert isinstance(progress, Bars)
        progress.update("nothing has begun")
        progress.stage("response surface")
        progress.update("40 of 108 surfaces converged", 40, 108)
        progress.stage("search")
    shown = file.getvalue()
    assert "response surface" in shown
    assert "40 of 108 surfaces converged" in shown
    assert "search" in shown
