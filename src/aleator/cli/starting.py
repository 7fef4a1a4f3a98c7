"""How Ctrl-C and SIGTERM end the program, also while modules are imported."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


def ending(signum: int) -> tuple[str, int]:
    """The message and the exit code of a program that a signal ended."""
    name = "Ctrl-C" if signum == signal.SIGINT else signal.Signals(signum).name
    return f"aleator: stopped by {name}", 128 + signum


@contextmanager
def termination_heard() -> Iterator[list[int]]:
    """A context in which SIGTERM ends a command as Ctrl-C does; yields the signals received.

    A batch system sends SIGTERM when the time of a job is over.
    """
    heard: list[int] = []

    def end(signum: int, frame: FrameType | None) -> None:
        heard.append(signum)
        answer = signal.getsignal(signal.SIGINT)  # SIGINT may be ignored, without a handler.
        if not callable(answer):
            raise KeyboardInterrupt
        answer(signum, frame)

    with _handled(signal.SIGTERM, signal.SIG_DFL, end):
        yield heard


@contextmanager
def ended_at_once() -> Iterator[None]:
    """A context in which Ctrl-C ends the process at once and raises no KeyboardInterrupt.

    It is for imports. During an import other modules may print KeyboardInterrupt as a traceback,
    turn it into another exception, or swallow it. No file is open yet, so that nothing is lost.
    """
    with _handled(signal.SIGINT, signal.default_int_handler, _end):
        yield


@contextmanager
def _handled(signum: int, default: Any, handler: Any) -> Iterator[None]:
    """A context in which `handler` handles a signal that has its `default` handler now."""
    plain = signal.getsignal(signum) is default
    if plain:
        try:
            signal.signal(signum, handler)
        except ValueError:  # Only the main thread can handle signals.
            plain = False
    try:
        yield
    finally:
        if plain:
            signal.signal(signum, default)


def _end(signum: int, _frame: object) -> None:
    told, code = ending(signum)
    os.write(2, f"{told}\n".encode())
    os._exit(code)
