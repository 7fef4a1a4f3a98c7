"""The interface by which a long computation reports its progress."""

from __future__ import annotations

from datetime import timedelta
from typing import Protocol


class Progress(Protocol):
    """Receives reports on the progress of a computation, which has one named stage after the other.

    Both methods return at once and do not change the result. They raise no exception except, like
    any line of Python, KeyboardInterrupt.
    """

    def stage(self, name: str) -> None:
        """Begin the stage `name`, such as "search"; the stage before it is complete."""

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Report `text` about the present stage, with `done` of `total` steps made, if known."""


def duration(seconds: float) -> str:
    """A duration as a short text, in seconds, minutes or hours.

    >>> duration(50.0), duration(600.0), duration(9000.0)
    ('50 s', '10 min', '2.5 h')
    """
    minute, hour = (timedelta(**{unit: 1}).total_seconds() for unit in ("minutes", "hours"))
    if seconds < 1.5 * minute:
        return f"{seconds:.0f} s"
    return f"{seconds / minute:.0f} min" if seconds < 1.5 * hour else f"{seconds / hour:.1f} h"


class Silent:
    """A progress receiver that ignores all reports: the default of functions with this argument.

    >>> Silent().stage("search")
    >>> Silent().update("start 3 of 10", done=3, total=10)
    """

    def stage(self, name: str) -> None:
        """Ignore the beginning of a stage."""

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Ignore a report of progress."""
