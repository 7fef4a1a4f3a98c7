"""Progress of one call's runs: how many are done, known, failed or tried again, and how fast."""

from __future__ import annotations

import time

from aleator.progress import Progress

_PATIENCE = 1.0
"""Seconds after which progress is told."""


class RunProgress:
    """Tells `progress` how `total` runs come along, `known` of which need not be run.

    >>> RunProgress.text(30, 100, known=10, failed=2, retried=0, rate=4.0)
    '30 of 100 runs, 10 of them known, 2 failed, 4 runs/s, about 18 s left'
    """

    def __init__(self, progress: Progress, total: int, known: int) -> None:
        self._progress, self._total, self._known = progress, total + known, known
        self._done = self._failed = self._retried = 0
        self._began = time.monotonic()

    def count(self, done: int, failed: int) -> None:
        """So many runs more are done; `failed` of these have no outcome."""
        self._done, self._failed = self._done + done, self._failed + failed
        seconds = time.monotonic() - self._began
        if seconds > _PATIENCE and self._done + self._known < self._total:
            text = self.text(
                self._done + self._known, self._total, self._known, self._failed, self._retried,
                self._done / seconds,
            )  # fmt: skip
            self._progress.update(text, self._done + self._known, self._total)

    def retry(self, number: int) -> None:
        """So many failed runs are tried again."""
        self._retried = number
        self._done, self._failed = self._done - number, self._failed - number

    def stopping(self, batches: int) -> None:
        """Ctrl-C came: what is at work is waited for."""
        self._progress.update(
            f"stopping: {batches} batches of runs are still at work and will be kept; Ctrl-C "
            "again leaves them"
        )

    @staticmethod
    def text(done: int, total: int, known: int, failed: int, retried: int, rate: float) -> str:
        """The line that is told."""
        parts = [f"{done:,} of {total:,} runs"]
        parts += [f"{known:,} of them known"] if known else []
        parts += [f"{failed:,} failed"] if failed else []
        parts += [f"{retried:,} tried again"] if retried else []
        parts.append(f"{rate:.3g} runs/s")
        parts.append(f"about {_duration((total - done) / rate)} left")
        return ", ".join(parts)


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400.0 else f"{seconds / 3600:.1f} h"
