"""Progress as it is seen: a moving line on a terminal, lines with their time anywhere else."""

from __future__ import annotations

import time
from datetime import timedelta
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TextColumn
from rich.text import Text

PLAIN_INTERVAL = 5.0  # s until the first plain line about a stage that takes long


class Lines:
    """Progress as plain lines: one for each stage, and more, ever rarer, of a long stage."""

    def __init__(self, console: Console, interval: float = PLAIN_INTERVAL) -> None:
        self._console = console
        self._interval = interval
        self._stage = ""
        self._next = 0.0
        self._began = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is left open."""

    def stage(self, name: str) -> None:
        """Begin a stage with a line."""
        self._stage, self._began = name, time.monotonic()
        self._next = self._began + self._interval
        self._say(f"{name} ...")

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:  # noqa: ARG002
        """Say the text if some time has passed since the last line; it tells the share itself."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + max(self._interval, 0.5 * (now - self._began))
            self._say(f"{self._stage}: {text}")

    def _say(self, text: str) -> None:
        line = f"{time.strftime('%H:%M:%S')} {text}"
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)


class _Elapsed(ProgressColumn):
    """The seconds since the first stage began."""

    def __init__(self) -> None:
        super().__init__()
        self._began = time.monotonic()

    def render(self, _: Task) -> Text:
        """As hours, minutes and seconds."""
        return Text(str(timedelta(seconds=int(time.monotonic() - self._began))))


class Bars:
    """Progress as one moving line: the stage, a bar where its share is known, and all seconds."""

    def __init__(self, console: Console) -> None:
        self._progress = Progress(
            SpinnerColumn(finished_text="-"),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=16),
            TextColumn("{task.fields[text]}", markup=False),
            _Elapsed(),
            console=console,
        )
        self._task = self._progress.add_task("", total=None, text="")

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self._progress.update(self._task, total=1, completed=1, text="")
        self._progress.stop()

    def stage(self, name: str) -> None:
        """Go on with a stage: what was told of the one before is over."""
        self._progress.refresh()
        self._progress.remove_task(self._task)
        self._task = self._progress.add_task(name, total=None, text="")

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Move the bar and change the text of the stage."""
        self._progress.update(self._task, completed=done, total=total, text=text)


def shown_on(console: Console) -> Bars | Lines:
    """What suits a console: bars that move on a terminal, lines elsewhere."""
    return Bars(console) if console.is_terminal else Lines(console)
