"""Signals that must not come between two steps."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def signals_held() -> Iterator[None]:
    """Let the handlers of this process, Ctrl-C's say, answer at the end of the block.

    The signals themselves are not blocked: a process that is started in the block would inherit
    that, and be deaf.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # handlers are called in the main thread only
        return
    signals: list[int] = [*signal.valid_signals()]
    handlers = {one: to for one in signals if callable(to := signal.getsignal(one))}
    came: list[int] = []

    def note(signum: int, _frame: object) -> None:
        came.append(signum)

    try:
        for signum in handlers:
            signal.signal(signum, note)
        yield
    finally:
        for signum, handler in handlers.items():
            signal.signal(signum, handler)
        for signum in came:
            handlers[signum](signum, None)
