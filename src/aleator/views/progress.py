"""Progress on the screen: one line that changes on a terminal or in a notebook, else many lines."""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import timedelta
from html import escape
from importlib import import_module
from typing import Any, Self

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, SpinnerColumn, Task, TextColumn
from rich.progress import Progress as ProgressDisplay
from rich.text import Text

from aleator.core.progress import Progress, Standing


@dataclass(frozen=True)
class ProgressSettings:
    """Settings of the display of progress. The values are chosen by judgement.

    first: seconds until a long stage prints its second line. every: least seconds between two
    changes of the line in a notebook, whose file keeps each change. bar: width of the bar in
    characters.
    """

    first: float = 5.0
    every: float = 0.25
    bar: int = 16


PROGRESS = ProgressSettings()


class Lines:
    """Progress as plain lines: one for each stage, and more, ever less often, in a long one.

    A stage that comes again, as a search does in every round of runs, has no line of its own again.
    """

    def __init__(self, console: Console, interval: float = PROGRESS.first) -> None:
        self._console = console
        self._interval = interval
        self._stage = ""
        self._seen: set[str] = set()
        self._next = 0.0
        self._began = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: plain lines need no end."""

    def stage(self, name: str) -> None:
        """Begin a stage, and print a line with its name unless it was there before."""
        self._stage = name
        if name in self._seen:
            return
        self._seen.add(name)
        self._began = time.monotonic()
        self._next = self._began + self._interval
        self._say(f"{name} ...")

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:  # noqa: ARG002
        """Print the text if enough time has passed since the last line."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + max(self._interval, 0.5 * (now - self._began))
            self._say(f"{self._stage}: {text}")

    def reached(self, standing: Standing) -> None:
        """Show where the maximization stands, as a text about the stage."""
        self.update(str(standing))

    def _say(self, text: str) -> None:
        line = f"{time.strftime('%H:%M:%S')} {text}"
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)


class _Elapsed(ProgressColumn):
    """A column of the progress line: the time since the first stage began."""

    def __init__(self) -> None:
        super().__init__()
        self._began = time.monotonic()

    def render(self, _: Task) -> Text:
        """The elapsed time as hours, minutes and seconds."""
        return Text(str(timedelta(seconds=int(time.monotonic() - self._began))))


class Bars:
    """Progress as one line that changes: the stage, a bar, a text and the total time."""

    def __init__(self, console: Console) -> None:
        self._progress = ProgressDisplay(
            SpinnerColumn(finished_text="-"),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=PROGRESS.bar),
            TextColumn("{task.fields[text]}", markup=False),
            _Elapsed(),
            console=console,
        )
        self._task = self._progress.add_task("", total=None, text="")

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._progress.update(self._task, total=1, completed=1, text="")
        self._progress.stop()

    def stage(self, name: str) -> None:
        """Begin a stage, which replaces the previous stage on the line."""
        self._progress.refresh()
        self._progress.remove_task(self._task)
        self._task = self._progress.add_task(name, total=None, text="")

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Set the bar to `done` of `total` units, and change the text of the stage."""
        self._progress.update(self._task, completed=done, total=total, text=text)

    def reached(self, standing: Standing) -> None:
        """Show where the maximization stands, as a text about the stage."""
        self.update(str(standing))


@dataclass(frozen=True)
class Receivers:
    """Several receivers of progress as one: each gets every report."""

    each: tuple[Progress, ...]

    def stage(self, name: str) -> None:
        """Begin a stage of all receivers."""
        for one in self.each:
            one.stage(name)

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Report a text about the stage to all receivers."""
        for one in self.each:
            one.update(text, done, total)

    def reached(self, standing: Standing) -> None:
        """Report where the maximization stands to all receivers."""
        for one in self.each:
            one.reached(standing)


def shown_on(console: Console) -> Bars | Lines:
    """The display of progress for a console: a changing line on a terminal, else plain lines."""
    return Bars(console) if console.is_terminal else Lines(console)


class ProgressLine:
    """Shows the progress of a long call: `identify(..., progress=ProgressLine())`.

    In a notebook it is one line under the cell, which changes as the call goes on. In a script each
    stage prints a line to the standard error, and a long stage prints more. No widgets are needed.

    >>> from aleator import ProgressLine
    >>> line = ProgressLine()
    >>> line.stage("search")
    >>> line.update("start 3 of 10", done=3, total=10)
    """

    def __init__(self) -> None:
        self._handle = _notebook()
        self._lines = Lines(Console(stderr=True))
        self._stage, self._began, self._last = "", time.monotonic(), 0.0

    def stage(self, name: str) -> None:
        """Begin a stage of the call, which ends the previous stage."""
        if self._handle is None:
            self._lines.stage(name)
            return
        self._stage = name
        self._show("")

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Show a text about the stage, with the share `done` of `total` in a notebook.

        A notebook shows a new text at most four times a second.
        """
        if self._handle is None:
            self._lines.update(text, done, total)
        elif time.monotonic() - self._last >= PROGRESS.every:
            share = f" {done / total:.0%}" if done is not None and total else ""
            self._show(f"{share}  {text}")

    def reached(self, standing: Standing) -> None:
        """Show where the maximization stands, as a text about the stage."""
        self.update(str(standing))

    def _show(self, text: str) -> None:
        self._last = time.monotonic()
        elapsed = f"{self._last - self._began:.0f} s"
        self._handle.update(_Line(f"aleator: {elapsed}  {self._stage}{text}"))


class _Line:
    """A line of text that a notebook shows without changes of its spaces."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.text)}</pre>"


def _notebook() -> Any:
    """An object of IPython by which a line in a notebook can be changed; else None."""
    try:
        shell = import_module("IPython").get_ipython()
        if shell is None or not hasattr(shell, "kernel"):
            return None
        return import_module("IPython.display").display(_Line("aleator"), display_id=True)
    except ImportError:
        return None
