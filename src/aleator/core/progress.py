"""Interface by which a long computation reports its progress."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Receives the progress of a computation: one `stage` after the other, each with `update`s.

    Both methods return at once and do not change the result. They raise nothing but, like any line
    of Python, KeyboardInterrupt.
    """

    def stage(self, name: str) -> None:
        """Begin the stage `name`, such as "search"; the one before is over."""

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Report `text` about the stage, of which `done` of `total` is complete, if known."""


class Silent:
    """A Progress that ignores everything: the default of every function with that argument.

    >>> Silent().stage("search")
    >>> Silent().update("start 3 of 10", done=3, total=10)
    """

    def stage(self, name: str) -> None:
        """Ignore the beginning of a stage."""

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Ignore a report of progress."""
