import io
import math
import re
from dataclasses import replace

from rich.console import Console

from aleator.core.progress import RunsAhead, Standing
from aleator.views.progress import Bars, Lines, Receivers, shown_on


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
        for stage in ("response surface", "search", "response surface", "inference"):
            progress.stage(stage)
    assert without_times(file) == ["search ...", "response surface ...", "inference ..."]


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


def test_where_a_search_stands_is_told_with_what_is_expected_and_not_reached() -> None:
    ahead = (RunsAhead(0.2, 1800.0, 5400.0), RunsAhead(0.1, 2400.0, math.nan))
    standing = Standing(1200, -31.416, {"v.mean": 1.0}, 0.351, ahead)
    told = str(standing)
    for number in ("1,200", "-31.42", "0.35", "1,800", "0.2", "2,400", "0.1", "1.5 h"):
        assert number in told
    assert str(replace(standing, ahead=())).endswith("0.35 standard errors")
    near = replace(standing, ahead=(RunsAhead(0.2, 1200.0, 0.0), RunsAhead(0.1, math.inf, 1.0)))
    assert near.forecast == ""
    assert str(replace(standing, error=None)) == "1,200 runs, log-likelihood -31.42"
    out, file = console(terminal=False)
    both = Receivers((Lines(out, interval=0.0), Lines(out, interval=0.0)))
    both.stage("search")
    both.reached(standing)
    assert without_times(file) == ["search ..."] * 2 + [f"search: {told}"] * 2
    out, file = console(terminal=True)
    with shown_on(out) as bars:
        bars.stage("search")
        bars.reached(standing)
        bars.stage("inference")
    assert "1,200 runs" in file.getvalue()
