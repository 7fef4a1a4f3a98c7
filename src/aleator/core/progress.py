"""The interface by which a long computation reports its progress."""

from __future__ import annotations

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


class Silent:
    """A progress receiver that ignores all reports: the default of functions with this argument.

    >>> Silent().stage("search")
    >>> Silent().update("start 3 of 10", done=3, total=10)
    """

    def stage(self, name: str) -> None:
        """Ignore the beginning of a stage."""

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Ignore a report of progress."""
