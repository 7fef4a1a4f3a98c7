"""How a long computation says where it is, without knowing who listens."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Listens to a computation: one `stage` after the other, any number of `update` in each.

    Both return at once, raise nothing of their own and change nothing in the result. They may raise
    KeyboardInterrupt, as any line of Python may.
    """

    def stage(self, name: str) -> None:
        """Begin the stage `name`, such as "search"; the one before is over."""

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Say `text` about the stage; `done` of `total` is its share where that is known."""


class Silent:
    """A Progress that says nothing: the default of every function that takes one.

    >>> Silent().stage("search")
    >>> Silent().update("start 3 of 10", done=3, total=10)
    """

    def stage(self, name: str) -> None:
        """Say nothing."""

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Say nothing."""
