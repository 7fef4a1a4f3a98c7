"""A time limit for a call of a Python function."""

from __future__ import annotations

import faulthandler
import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from aleator.errors import SimulatorError
from aleator.simulators.failure import RunFailed

GRACE = 3.0
"""Time limits after which a worker whose function does not even hear the first one is ended."""


def checked_limit(seconds: float | None) -> float | None:
    """A time limit that can be one. Raises SimulatorError for others."""
    if seconds is not None and not 0.0 < seconds < math.inf:
        raise SimulatorError(
            f"timeout = {seconds:g} is no time", "give seconds, or leave it out: no limit"
        )
    return seconds


@contextmanager
def limited(seconds: float | None) -> Iterator[None]:
    """Raise RunFailed in what takes longer than so many seconds; None is no limit.

    Python code is stopped where it is, as by Ctrl-C, and again if it goes on. Compiled code that
    does not return ends its worker after three times the limit and a second; nothing can end it in
    this process. Needs the main thread, and a system with SIGALRM: elsewhere there is no limit.
    Cost: some microseconds.

    >>> with limited(0.01):
    ...     while True:
    ...         pass
    Traceback (most recent call last):
        ...
    aleator.simulators.failure.RunFailed: it was stopped after its 0.01 s
    """
    main = threading.current_thread() is threading.main_thread()
    if seconds is None or not main or not hasattr(signal, "setitimer"):
        yield
        return
    at_work = True

    def expire(_signum: int, _frame: object) -> None:
        if at_work:
            raise RunFailed(f"it was stopped after its {seconds:g} s")

    before = signal.signal(signal.SIGALRM, expire)
    try:
        signal.setitimer(signal.ITIMER_REAL, seconds, seconds)
        with _ended_worker(GRACE * seconds + 1.0):
            yield
    finally:
        at_work = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _ended_worker(seconds: float) -> Iterator[None]:
    """End this process after so many seconds, whatever it does, if it is a worker."""
    if multiprocessing.parent_process() is None:
        yield
        return
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
