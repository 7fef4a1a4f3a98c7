"""Ctrl-C and SIGTERM: how the program ends, and at once while modules are imported."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


def ending(signum: int) -> tuple[str, int]:
    """What the program says when a signal ended it, and the exit code that shells report then."""
    name = "Ctrl-C" if signum == signal.SIGINT else signal.Signals(signum).name
    return f"aleator: stopped by {name}", 128 + signum


@contextmanager
def termination_heard() -> Iterator[list[int]]:
    """Let SIGTERM, which a batch system sends when the time is up, end a command as Ctrl-C does.

    Yields the signals that came.
    """
    heard: list[int] = []

    def end(signum: int, frame: FrameType | None) -> None:
        heard.append(signum)
        answer = signal.getsignal(signal.SIGINT)  # ignored in the background of a shell
        if not callable(answer):
            raise KeyboardInterrupt
        answer(signum, frame)

    try:
        plain = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
        if plain:
            signal.signal(signal.SIGTERM, end)
    except ValueError:  # not the main thread, which answers signals
        plain = False
    try:
        yield heard
    finally:
        if plain:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


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


def _end(signum: int, _frame: object) -> None:
    told, code = ending(signum)
    os.write(2, f"{told}\n".encode())
    os._exit(code)
