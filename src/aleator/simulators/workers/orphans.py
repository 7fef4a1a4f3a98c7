"""Workers that end with the process that started them, however that ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

GRACE = 2.0
"""Seconds in which a call may tidy up: end the program that it runs, and remove its folder."""

_SIGNAL = getattr(signal, "SIGUSR1", None)  # Windows has none: nothing is tidied up there
_orphaned = threading.Event()
_working = threading.Event()


class Orphaned(BaseException):
    """Nobody waits for this run any more: the process that wanted it has ended."""


def end_with_parent() -> None:
    """Let this worker end soon after the process that started it; for its main thread.

    A call at work finds an Orphaned raised in it, and has GRACE seconds; an idle worker ends at
    once. It takes a thread that sleeps, and SIGUSR1.
    """
    if _SIGNAL is not None:
        signal.signal(_SIGNAL, _interrupt)
    threading.Thread(target=_watch, daemon=True).start()


def at_work(call: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
    """What a call returns; a worker that became an orphan meanwhile ends after it.

    >>> at_work(divmod, 7, 2)
    (3, 1)
    """
    _working.set()
    try:
        return call(*args, **kwargs)
    finally:
        _working.clear()
        if _orphaned.is_set():
            os._exit(1)


def _watch() -> None:
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    parent.join()
    _orphaned.set()
    if _working.is_set() and _SIGNAL is not None:
        # to the main thread, as nothing else ends its waiting for a program
        signal.pthread_kill(threading.main_thread().ident or 0, _SIGNAL)
        time.sleep(GRACE)
    os._exit(1)


def _interrupt(_signum: int, _frame: object) -> None:
    if _orphaned.is_set() and _working.is_set():
        raise Orphaned
