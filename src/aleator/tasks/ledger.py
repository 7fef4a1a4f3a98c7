"""What an identification takes, by stage."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from aleator.progress import Progress
from aleator.simulators import Runner


class Ledger:
    """Seconds and simulator runs by stage, noted while a progress is told of them."""

    def __init__(self, runner: Runner, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self.runs: dict[str, int] = {}
        self.progress = progress
        self._runner = runner
        self._last = ""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage, and note what it takes; a stage may come again, or go on."""
        if name != self._last:
            self.progress.stage(name)
        self._last = name
        began, before = time.perf_counter(), self._runner.runs
        try:
            yield
        finally:
            seconds, runs = time.perf_counter() - began, self._runner.runs - before
            self.seconds[name] = self.seconds.get(name, 0.0) + seconds
            self.runs[name] = self.runs.get(name, 0) + runs
