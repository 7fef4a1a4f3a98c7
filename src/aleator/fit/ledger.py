"""The runs and seconds of each stage of an identification."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from aleator.core.progress import Progress
from aleator.simulators import Runner

SURFACE, SEARCH = "response surface", "search"
"""The names of two stages in the account of runs and seconds."""


class Ledger:
    """An account of the seconds and simulator runs of each stage, with a progress display."""

    def __init__(self, runner: Runner, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self.runs: dict[str, int] = {}
        self.progress = progress
        self._runner = runner
        self._last = ""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage of the work and count its seconds and runs; a stage may be repeated."""
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
