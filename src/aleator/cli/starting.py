"""Ctrl-C while modules are imported: the program ends at once, in one line."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

STOPPED = 130  # what shells report for a program ended by Ctrl-C
TOLD = "aleator: stopped by Ctrl-C"


@contextmanager
def ended_at_once() -> Iterator[None]:
    """Where Ctrl-C would raise KeyboardInterrupt, let it end this process.

    For imports: an exception there comes out of modules of others as a traceback, or as another
    one, or not at all. Nothing is open yet that would have to be closed.
    """
    try:
        plain = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        if plain:
            signal.signal(signal.SIGINT, _end)
    except ValueError:  # not the main thread, which answers Ctrl-C
        plain = False
    try:
        yield
    finally:
        if plain:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(_signum: int, _frame: object) -> None:
    os.write(2, f"{TOLD}\n".encode())
    os._exit(STOPPED)
