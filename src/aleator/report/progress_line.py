"""Progress of a call from Python: a line that is written anew in a notebook, lines elsewhere."""

from __future__ import annotations

import time
from html import escape
from importlib import import_module
from typing import Any

from rich.console import Console

from aleator.report.live import Lines

EVERY = 0.25
"""Seconds between two changes of the line: a notebook keeps each in its file while it runs."""


class ProgressLine:
    """Says where a long call is: `identify(..., progress=ProgressLine())`.

    In a notebook it is one line under the cell, which is written anew and in the end tells the
    seconds of the last stage; in a script it is a line for each stage on the standard error, and
    more of a stage that takes long. It needs no widgets.

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
        """Begin a stage; the one before is over."""
        if self._handle is None:
            self._lines.stage(name)
            return
        self._stage = name
        self._show("")

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Say something of the stage, at most four times a second."""
        if self._handle is None:
            self._lines.update(text, done, total)
        elif time.monotonic() - self._last >= EVERY:
            share = f" {done / total:.0%}" if done is not None and total else ""
            self._show(f"{share}  {text}")

    def _show(self, text: str) -> None:
        self._last = time.monotonic()
        elapsed = f"{self._last - self._began:.0f} s"
        self._handle.update(_Line(f"aleator: {elapsed}  {self._stage}{text}"))


class _Line:
    """A line of text as a notebook shows it."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.text)}</pre>"


def _notebook() -> Any:
    """Where a notebook shows a line that changes; None outside of one."""
    try:
        shell = import_module("IPython").get_ipython()
        if shell is None or not hasattr(shell, "kernel"):
            return None
        return import_module("IPython.display").display(_Line("aleator"), display_id=True)
    except ImportError:
        return None
