"""progress.html: how far a command is, in a page that a browser reads again every few seconds.

Nothing is served and no script runs: the page is one file, which a thread of the command writes
anew. The computation only leaves what it reports in memory.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from types import TracebackType
from typing import Self

from aleator.core.progress import Standing, duration
from aleator.errors import AleatorError
from aleator.results import documents
from aleator.results.printed import TextTable, cells, heads, number

PROGRESS_PAGE = "progress.html"


@dataclass(frozen=True)
class PageSettings:
    """Settings of progress.html. The values are chosen by judgement."""

    every: float = 1.0
    """The seconds between two writings of the file."""
    refresh: int = 2
    """The seconds after which a browser reads the file again."""
    old: float = 60.0
    """The age of the page, in seconds, beyond which the reader is told that the command is dead."""
    messages: int = 12
    """The number of last messages that are shown."""
    rounds: int = 12
    """The number of last rounds in the table; the chart has all of them."""
    width: int = 640
    """The width of the chart in pixels."""
    height: int = 220
    """Its height."""
    margin: int = 48
    """Its margin for labels, on each side."""


PAGE_SETTINGS = PageSettings()


class ProgressPage:
    """Receives reports on the progress of a command and shows them in a file, progress.html.

    As a context it is idle until `open` names the file; at the end the page says how the command
    ended: it is done, was stopped, or failed. The file is written whole or not at all, at most once
    a second. If it cannot be written later on, the command goes on without it.
    """

    def __init__(self, settings: PageSettings = PAGE_SETTINGS) -> None:
        self._settings = settings
        self._path: Path | None = None
        self._title = self._command = self._stage = self._text = ""
        self._share: float | None = None
        self._state, self._said = "working", ""
        self._runs: list[Callable[[], int]] = []
        self._standings: list[Standing] = []
        self._messages: deque[tuple[str, str]] = deque(maxlen=settings.messages)
        self._passing = False  # Whether the next update replaces the last message.
        self._links: list[Path] = []
        self._began = 0.0
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._writer = threading.Thread(target=self._write_often, daemon=True)

    def open(self, folder: Path, title: str, command: str) -> None:
        """Begin the page of a `command` in a folder; later calls change nothing.

        Raises AleatorError if the file cannot be written.
        """
        if self._path is not None:
            return
        self._title, self._command, self._began = title, command, time.monotonic()
        path = folder / PROGRESS_PAGE
        documents.write_text(self.text(), path)
        self._path = path
        self._writer.start()

    def counts(self, runs: Callable[[], int]) -> None:
        """Show the runs that `runs` counts, added to those of other simulators."""
        self._runs.append(runs)

    def link(self, paths: Sequence[Path]) -> None:
        """Link these files at the end."""
        self._links += paths

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Write how the command ended."""
        if self._path is None:
            return
        with self._lock:
            self._state, self._said = _ending(error)
        self._ended.set()
        self._writer.join()
        with suppress(AleatorError):
            documents.write_text(self.text(), self._path)

    def stage(self, name: str) -> None:
        """Begin a stage."""
        with self._lock:
            self._stage, self._text, self._share = name, "", None
            self._note(name)

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Keep a text about the stage, with the share `done` of `total`."""
        with self._lock:
            self._text = text
            self._share = done / total if done is not None and total else None
            self._note(f"{self._stage}: {text}", passing=True)

    def reached(self, standing: Standing) -> None:
        """Keep where the maximization stands."""
        with self._lock:
            self._standings.append(standing)
            self._text, self._share = str(standing), None
            self._note(f"{self._stage}: {standing}")

    def _note(self, text: str, passing: bool = False) -> None:
        """Keep a message; a `passing` one is replaced by the next that is passing."""
        if passing and self._passing:
            self._messages.pop()
        self._passing = passing
        self._messages.append((time.strftime("%H:%M:%S"), text))

    def _write_often(self) -> None:
        while not self._ended.wait(self._settings.every):
            assert self._path is not None
            with suppress(AleatorError):
                documents.write_text(self.text(), self._path)

    # ------------------------------------------------------------------------------- the text

    def text(self) -> str:
        """The page as HTML."""
        with self._lock:
            return "".join(self._parts())

    def _parts(self) -> Iterator[str]:
        working, title = self._state == "working", escape(self._title)
        seconds = time.monotonic() - self._began
        said = self._said or f"Working: {self._stage or 'the first run'}"
        style = (files("aleator.views") / "progress.css").read_text(encoding="utf-8")
        refresh = f'<meta http-equiv="refresh" content="{self._settings.refresh}">'
        yield (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"{refresh if working else ''}<title>{self._state}: {title}</title>"
            f"<style>{style}</style></head><body><h1>{title}</h1>"
            f'<p class="state {self._state}">{escape(said)}</p>'
        )
        if self._links and self._state == "done":
            assert self._path is not None
            folder = self._path.parent
            names = [Path(os.path.relpath(path, folder)).as_posix() for path in self._links]
            links = ", ".join(f'<a href="{escape(name)}">{escape(name)}</a>' for name in names)
            yield f"<p>Written: {links}</p>"
        rows = [
            ("command", self._command),
            ("time since the beginning", duration(seconds)),
            ("runs of the simulator", f"{sum(count() for count in self._runs):,}"),
        ]
        if working:
            share = "" if self._share is None else f" ({self._share:.0%} of this stage)"
            rows.append(("now", f"{self._text}{share}"))
        rounds = rounds_of(self._standings)
        if rounds:
            last = rounds[-1]
            if self._state != "done":  # Then the report has the numbers of the answer.
                rows.append(("log-likelihood", f"{last.log_likelihood:.2f}"))
                error = _error(last)
                rows.append(("error of the estimates", f"{error} standard errors" if error else ""))
            rows.append(("expected", last.forecast if working else ""))
        rows.append(("last writing", time.strftime("%Y-%m-%d %H:%M:%S")))
        yield _table(TextTable(heads("quantity", "~value"), [row for row in rows if row[1]]))
        if working:
            old = duration(self._settings.old)
            yield (
                "<p>The command writes this page anew every second. If the last writing is more "
                f"than {old} old, the command was killed, or its computer sleeps.</p>"
            )
        if rounds:
            yield "<h2>Estimates by round</h2>"
            yield (
                "<p>These are the estimates of the search while runs were added. The answer can "
                "differ: more is computed after the last round.</p>"
            )
            if picture := chart(rounds, self._settings):
                goals = " and ".join(f"{goal.error:g}" for goal in rounds[-1].ahead)
                yield picture
                yield f"<p>Dashed: errors of {goals}, for which the runs are forecast.</p>"
            yield _table(by_round(rounds[-self._settings.rounds :]))
        yield "<h2>Last messages</h2>"
        yield _table(TextTable(heads("time", "~message"), [*self._messages]))
        yield "</body></html>\n"


def _ending(error: BaseException | None) -> tuple[str, str]:
    """The state of a command that ended, and a sentence about it."""
    if error is None:
        return "done", "Done."
    if isinstance(error, KeyboardInterrupt):
        return "stopped", (
            "Stopped by Ctrl-C or a signal. The same command goes on from the runs that are kept."
        )
    return "failed", f"Ended by an error: {str(error) or type(error).__name__}"


def rounds_of(standings: Sequence[Standing]) -> list[Standing]:
    """The last standing after each number of runs; those with a known error, if there are any."""
    found = [each for each in standings if each.error is not None] or standings
    return [*{each.runs: each for each in found}.values()]


def by_round(rounds: Sequence[Standing]) -> TextTable:
    """The table of rounds: runs, log-likelihood, error of the estimates, and alpha."""
    names = [*rounds[-1].alpha]
    told = (">runs", ">log-likelihood", ">error of the estimates")
    columns = heads(*told, *(f">{name}" for name in names))
    rows = [
        (f"{each.runs:,}", f"{each.log_likelihood:.2f}", _error(each),
         *(number(each.alpha.get(name)) for name in names))
        for each in rounds
    ]  # fmt: skip
    return TextTable(columns, rows)


def _error(standing: Standing) -> str:
    """The error of the estimates as text; empty where it is unknown."""
    known = standing.error is not None and math.isfinite(standing.error)
    return number(standing.error, 2) if known else ""


def chart(rounds: Sequence[Standing], settings: PageSettings = PAGE_SETTINGS) -> str:
    """An SVG of the error of the estimates over runs; empty with fewer than two known errors.

    The error is on a logarithmic axis; dashed lines are the errors for which runs are forecast.
    """
    known = [
        (each.runs, math.log10(each.error))
        for each in rounds
        if each.error is not None and 0.0 < each.error < math.inf
    ]
    if len(known) < 2:
        return ""
    goals = [math.log10(goal.error) for goal in rounds[-1].ahead]
    heights = [height for _, height in known] + goals
    low, high = math.floor(min(heights)), math.ceil(max(heights) + 1e-9)
    first, last = known[0][0], max(known[-1][0], known[0][0] + 1)
    wide, tall, edge = settings.width, settings.height, settings.margin

    def at(runs: float, height: float) -> tuple[float, float]:
        x = edge + (wide - 2 * edge) * (runs - first) / (last - first)
        return x, edge / 2 + (tall - 1.5 * edge) * (high - height) / (high - low)

    def level(height: float, kind: str, text: str) -> str:
        (left, y), (right, _) = at(first, height), at(last, height)
        line = f'<line class="{kind}" x1="{left:.1f}" y1="{y:.1f}" x2="{right:.1f}" y2="{y:.1f}"/>'
        place, anchor = (left - 6, "end") if kind == "grid" else (right + 6, "start")
        return f'{line}<text x="{place:.1f}" y="{y + 4:.1f}" text-anchor="{anchor}">{text}</text>'

    lines = [level(k, "grid", f"{10.0**k:g}") for k in range(low, high + 1)]
    lines += [level(goal, "goal", f"{10.0**goal:g}") for goal in goals]
    points = [at(*each) for each in known]
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    marks = "".join(f'<circle class="mark" cx="{x:.1f}" cy="{y:.1f}" r="3"/>' for x, y in points)
    ends = "".join(
        f'<text x="{at(runs, low)[0]:.1f}" y="{tall - edge / 2:.1f}" text-anchor="middle">'
        f"{runs:,}</text>"
        for runs in (known[0][0], known[-1][0])
    )
    return (
        f'<svg viewBox="0 0 {wide} {tall}" role="img" aria-label="Error of the estimates over '
        f'runs">{"".join(lines)}<polyline class="error" points="{path}"/>{marks}{ends}'
        f'<text x="{wide / 2:.1f}" y="{tall - 6}" text-anchor="middle">error of the estimates in '
        "standard errors, over runs of the simulator</text></svg>"
    )


def _table(table: TextTable) -> str:
    return f'<div class="wide"><table>{cells(table)}</table></div>' if table.rows else ""
