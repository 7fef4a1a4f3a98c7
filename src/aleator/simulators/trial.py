"""Python functions that end the process they run in: the first run is tried, a later end said."""

from __future__ import annotations

import faulthandler
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

APART = 10.0
"""Seconds after which the trial of a slower run is broken off: how that ends is not known then."""
_PAUSE = 0.001
_RETURNED = 77
_WATCH = 'read -r _ || printf "%s\\n" "$1" >&2'
"""A line comes when all is well; the end of the pipe without one is that of its writer."""


def ending(call: Callable[[], object]) -> str | None:
    """How a call ends its process, tried in a copy of this one; None where it does not.

    A call that returns or raises ends nothing. What it prints is not shown, and what it changes in
    memory is lost. None as well where it takes longer than `APART`, and on systems without the
    cheap copies of Linux: nobody knows there.

    >>> ending(lambda: 1.0)
    >>> ending(lambda: os._exit(3)) if sys.platform == "linux" else "exit code 3"
    'exit code 3'
    """
    if sys.platform != "linux":
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads: a copy that waits is ended
        copy = os.fork()
    if not copy:
        _end_with(call)
    try:
        until = time.monotonic() + APART
        while time.monotonic() < until:
            if os.waitid(os.P_PID, copy, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None:
                break
            time.sleep(_PAUSE)
        else:
            return None
    finally:
        os.kill(copy, signal.SIGKILL)  # to one that has ended it does nothing
        status = os.waitpid(copy, 0)[1]
    if os.WIFSIGNALED(status):
        return f"signal {os.WTERMSIG(status)}, {signal.strsignal(os.WTERMSIG(status))}"
    code = os.waitstatus_to_exitcode(status)
    return None if code == _RETURNED else f"exit code {code}"


@contextmanager
def watched(words: str) -> Iterator[None]:
    """Have `words` written to the standard error if this process ends before the block does.

    By a shell that waits for a line of this process; the exit code stays what ended the process.
    On systems without a POSIX shell nothing is written.
    """
    if os.name != "posix":
        yield
        return
    watcher = subprocess.Popen(
        ["/bin/sh", "-c", _WATCH, "sh", words], stdin=subprocess.PIPE, start_new_session=True
    )
    try:
        yield
    finally:
        watcher.communicate(b"\n")


def _end_with(call: Callable[[], object]) -> None:
    try:
        faulthandler.disable()
        with open(os.devnull, "w") as nowhere:
            sys.stdout = sys.stderr = nowhere
            for shown in (1, 2):
                os.dup2(nowhere.fileno(), shown)
            call()
    finally:
        os._exit(_RETURNED)
