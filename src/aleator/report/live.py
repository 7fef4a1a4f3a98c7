"""Progress as it is seen: a moving bar on a terminal, plain lines anywhere else."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

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
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


class Bars:
    """Progress as one moving line a stage, with a bar where the share is known, and its seconds."""

    def __init__(self, console: Console) -> None:
        self._progress = Progress(
            SpinnerColumn(finished_text="-"),
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=16),
            TextColumn("{task.fields[text]}", markup=False),
            TimeElapsedColumn(),
            console=console,
        )
        self._task: TaskID | None = None

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
            self._finish()
        self._progress.stop()

    def stage(self, name: str) -> None:
        """Close the line of the stage before and begin one."""
        self._finish()
        self._task = self._progress.add_task(name, total=None, text="")

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Move the bar and change the text of the stage."""
        if self._task is not None:
            self._progress.update(self._task, completed=done, total=total, text=text)

    def _finish(self) -> None:
        if self._task is not None:
            self._progress.update(self._task, total=1, completed=1)


def shown_on(console: Console) -> Bars | Lines:
    """What suits a console: bars that move on a terminal, lines elsewhere."""
    return Bars(console) if console.is_terminal else Lines(console)
