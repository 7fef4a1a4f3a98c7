"""Runs that have no outcome, and the box that leaves them out."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor
from pathlib import Path

import numpy as np

from aleator.errors import SimulatorError
from aleator.types import Array, Indices

_ROOM = Path(__file__).parent


class RunFailed(Exception):
    """A run gave no outcome: `message` says why in one line, `log` is what it printed last.

    It can be pickled, so that it travels from a worker process as it was raised.

    >>> failure = RunFailed("it ended with exit code 3", "pressure too high")
    >>> print(failure)
    it ended with exit code 3; its log ends: pressure too high
    >>> failure.message, failure.log
    ('it ended with exit code 3', 'pressure too high')
    """

    def __init__(self, message: str, log: str = "") -> None:
        super().__init__(message, log)
        self.message = message
        self.log = log

    def __str__(self) -> str:
        return with_log(self.message, self.log)


def with_log(message: str, log: str) -> str:
    """A message with the end of what the run printed, if it printed anything."""
    last = " ".join(log.split())[-300:]
    return f"{message}; its log ends: {last}" if last else message


class WorkerLost(BrokenExecutor):
    """Workers were lost while they ran this very call; the executor goes on."""


class NoOutcome(SimulatorError):
    """The simulator gave no outcome at parameters `failed` (F, n) of experiments `index` (F,)."""

    def __init__(self, problem: str, remedy: str, failed: Array, index: Indices) -> None:
        super().__init__(problem, remedy)
        self.failed, self.index = failed, index


def working_box(worked: Array, failed: Array, open_ended: Sequence[int]) -> Array:
    """A box (n, 2) of points that worked (W, n), without those that failed (F, n).

    The hull of the points that worked, cut on the sides of the parameters `open_ended` where the
    fewest of these points are lost; failures between them that no side separates may remain.

    >>> worked = np.array([[-1.0], [0.0], [1.0], [2.0]])
    >>> working_box(worked, np.array([[-1.5], [-0.9]]), [0]).tolist()
    [[0.0, 2.0]]
    """
    box = np.stack([worked.min(axis=0), worked.max(axis=0)], axis=1)
    kept = worked
    middle = np.median(worked, axis=0)
    for point in failed[np.argsort(np.abs(failed - middle).max(axis=1))]:
        if np.any((point < box[:, 0]) | (point > box[:, 1])):
            continue
        sides = [
            kept[kept[:, k] > point[k]] if point[k] < middle[k] else kept[kept[:, k] < point[k]]
            for k in open_ended
        ]
        most = max(sides, key=len)
        if len(most) < 2:
            continue
        kept = most
        box = np.stack([kept.min(axis=0), kept.max(axis=0)], axis=1)
    return box


def said(error: BaseException) -> str:
    """The text of an exception, as every file can hold it; "" where it cannot tell its own.

    >>> said(ValueError("a path with \\udcff in it"))
    'a path with \\\\udcff in it'
    """
    try:
        text = str(error)
    except KeyboardInterrupt:
        raise
    except BaseException:
        return ""
    return readable(text)


def readable(text: str) -> str:
    """A text without what UTF-8 does not have: halves of a character, of names of files."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def describe(error: BaseException) -> str:
    """An exception as one line: kind, message and, where it is known, file and line of its cause.

    >>> describe(ValueError("too cold"))
    'ValueError: too cold'
    """
    if isinstance(error, RunFailed):
        return said(error)
    text = " ".join(said(error).split())
    kind = readable(type(error).__name__)
    if isinstance(error, SyntaxError):  # its own text has the place
        return f"{kind}: {text}"
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<") and _ROOM not in Path(frame.filename).parents
        if "importlib" not in frame.filename
    ]
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{kind}: {text}{place}" if text else f"{kind}{place}"
