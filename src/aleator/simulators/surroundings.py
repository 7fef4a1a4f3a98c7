"""Causes outside a simulator that end a run: the machine, a time limit, the end of a process."""

from __future__ import annotations

import errno
import faulthandler
import math
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from aleator.errors import SimulatorError, SurroundingsError
from aleator.simulators.protocol import RunFailed

_PACKAGE = Path(__file__).parents[1]

_ERRORS = frozenset(
    {
        errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO,  # errors of disks
        errno.EAGAIN, errno.ENOMEM, errno.EMFILE, errno.ENFILE,  # errors of processes and memory
        errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH,  # errors of servers
    }
)  # fmt: skip

_REFUSED = (
    r"errors?|fail\w*|denied|refused|expired|invalid|missing|exceeded|unavailable|unreachable|"
    r"cannot|can't|could\ not|unable|not\ (?:be|available|found|valid)|is\ down|in\ use|timed\ out"
)
STOP_ON = (
    r"(?xi) no\ space\ left\ on\ device | disk\ quota\ exceeded | too\ many\ open\ files"
    r"| resource\ temporarily\ unavailable | cannot\ fork"
    rf"| \b(?:licen[cs](?:e|es|ing)|flexnet|flexlm)\b [^\n.;]{{0,60}} \b(?:{_REFUSED})\b"
    rf"| \b(?:{_REFUSED})\b [^\n.;]{{0,60}} \blicen[cs](?:e|es|ing)\b"
    r"| \bno\ (?:\w+\ ){0,3} licen[cs]es?\b"
)
"""The texts that a program prints if a disk is full, processes run out, or a license is refused."""

_NOT_MADE = "a run could not be made"
_GO_ON = "every run that was made is kept, and this one is not taken for a failure"
_REMEDY = f"mend that, and give the same command again: {_GO_ON}"


def cause(error: BaseException, what: str = _NOT_MADE) -> SurroundingsError | None:
    """The error for a run that the machine prevented; None if the run itself is at fault.

    The machine is at fault for errors of disks, processes, open files and servers, and for memory
    that Aleator itself could not get. A simulator that needs too much memory has failed. The
    message begins with `what`.

    >>> print(cause(OSError(errno.ENOSPC, "No space left on device", "/tmp/run")))
    a run could not be made: No space left on device: '/tmp/run'
      Remedy: mend that, and give the same command again: ...
    >>> cause(FileNotFoundError(errno.ENOENT, "No such file")) is None
    True
    """
    for one in _chain(error):
        if isinstance(one, SurroundingsError):
            return one
        if isinstance(one, OSError) and one.errno in _ERRORS:
            return prevented(one, what)
        if isinstance(one, MemoryError) and _is_ours(one):
            return SurroundingsError(f"{what}: there is no memory left", _REMEDY)
    return None


def prevented(error: OSError, what: str = _NOT_MADE) -> SurroundingsError:
    """The error for a call that the operating system refused, for any reason."""
    place = f": {error.filename!r}" if error.filename else ""
    return SurroundingsError(f"{what}: {error.strerror or error}{place}", _REMEDY)


def require_pattern(stop_on: str) -> None:
    """Raise SimulatorError if `stop_on` is no valid regular expression."""
    try:
        re.compile(stop_on)
    except re.error as error:
        raise SimulatorError(
            f"stop_on = {stop_on!r} is no regular expression: {error}",
            "in TOML write it between single quotes, such as '(?i)license'",
        ) from None


def printed(log: str, stop_on: str = STOP_ON) -> SurroundingsError | None:
    """The error for a failed run whose output shows that the machine is at fault; else None.

    The machine is at fault if the output `log` matches the regular expression `stop_on`.

    >>> str(printed("begun\\nERROR: could not connect to license server\\n")).splitlines()[0]
    'a run could not be made; it said: ERROR: could not connect to license server'
    >>> printed("There is NO WARRANTY; see the license\\npressure too high") is None
    True
    """
    found = re.search(stop_on, log) if stop_on else None
    if found is None:
        return None
    line = log[log.rfind("\n", 0, found.start()) + 1 :].partition("\n")[0].strip()
    return SurroundingsError(
        f"{_NOT_MADE}; it said: {line[:300]}",
        f"{_REMEDY}; where it is one nevertheless, say by stop_on what is none",
    )


def require_space(folder: Path) -> None:
    """Raise SurroundingsError if the disk has no free byte: an outcome on it may be incomplete."""
    if full := full_disk(folder, 0):
        raise full


def full_disk(folder: Path, most: int = 2**20) -> SurroundingsError | None:
    """The error for a disk with at most `most` free bytes; None for any other disk.

    With less than a MiB (by judgement) the disk is taken for the cause of a failed run.
    """
    try:
        disk = os.statvfs(folder)
    except (OSError, AttributeError):  # Windows has no function `statvfs`.
        return None
    blocks = disk.f_bfree if os.geteuid() == 0 else disk.f_bavail
    free = blocks * disk.f_frsize
    if disk.f_blocks == 0 or free > most:
        return None
    return SurroundingsError(
        f"the disk of {tempfile.gettempdir()} is full ({free:,} bytes are free): what a run writes "
        "there may be cut off",
        f"free some space, or name another folder by TMPDIR, and go on: {_GO_ON}",
    )


def _chain(error: BaseException) -> Iterator[BaseException]:
    seen: set[int] = set()
    one: BaseException | None = error
    while one is not None and id(one) not in seen:
        yield one
        seen.add(id(one))
        # The exception being handled counts too, unless it was suppressed by `from None`.
        one = one.__cause__ or (None if one.__suppress_context__ else one.__context__)


def _is_ours(error: MemoryError) -> bool:
    """Whether a line of Aleator raised the error, and not a line of the simulator."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and _PACKAGE in Path(trace.tb_frame.f_code.co_filename).parents


def checked_limit(seconds: float | None) -> float | None:
    """The time limit in seconds; None means no limit.

    Raises SimulatorError unless it is positive and finite.
    """
    if seconds is not None and not 0.0 < seconds < math.inf:
        raise SimulatorError(
            f"timeout = {seconds:g} is no time", "give seconds, or leave it out: no limit"
        )
    return seconds


@contextmanager
def limited(seconds: float | None, patience: float = 3.0) -> Iterator[None]:
    """Raise RunFailed within a block that takes longer than `seconds`; None is no limit.

    Python code is interrupted as by Ctrl-C, and again if it continues. Compiled code may not react.
    Then a worker process is ended after `patience` times the limit plus one second (by judgement);
    the main process cannot be ended so. The limit needs the main thread and a system with the
    signal SIGALRM; elsewhere there is no limit. Cost: some microseconds.

    >>> with limited(0.01):
    ...     while True:
    ...         pass
    Traceback (most recent call last):
        ...
    aleator.simulators.protocol.RunFailed: it was stopped after its 0.01 s
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
        with _ended_worker(patience * seconds + 1.0):
            yield
    finally:
        at_work = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _ended_worker(seconds: float) -> Iterator[None]:
    """End this process after `seconds`, whatever it does, if it is a worker process."""
    if multiprocessing.parent_process() is None:
        yield
        return
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


# The exit code of the copied process if the call returned or raised an exception.
_RETURNED = 77
# A line on the pipe means success. If the pipe ends without a line, its writer has ended.
_WATCH = 'read -r _ || printf "%s\\n" "$1" >&2'


def exit_status(code: int) -> str:
    """How a process ended, in words, from the exit code that Python reports.

    >>> exit_status(3), exit_status(-9)
    ('exit code 3', 'signal SIGKILL')
    """
    if code >= 0:
        return f"exit code {code}"
    return f"signal {signal.Signals(-code).name if -code in [*signal.Signals] else -code}"


def ending(call: Callable[[], object], patience: float = 10.0) -> str | None:
    """How a call ends its process, tried in a copy of the process; None if it returns or raises.

    The copy prints nothing, and its changes in memory are lost. None is also returned if the call
    takes longer than `patience` seconds (by judgement), and on systems other than Linux, where a
    process cannot be copied cheaply.

    >>> ending(lambda: 1.0)
    >>> ending(lambda: os._exit(3)) if sys.platform == "linux" else "exit code 3"
    'exit code 3'
    """
    if sys.platform != "linux":
        return None
    copy = multiprocessing.get_context("fork").Process(target=_end_with, args=(call,))
    with warnings.catch_warnings():
        # Python warns that threads may block a forked process; a blocked one is ended below.
        warnings.simplefilter("ignore", DeprecationWarning)
        copy.start()
    try:
        copy.join(patience)
        code = copy.exitcode
    finally:
        copy.kill()
        copy.join()
    if code is None or code == _RETURNED:
        return None
    return exit_status(code)


@contextmanager
def end_reported(words: str) -> Iterator[None]:
    """Let `words` be written to the standard error if this process ends within the block.

    A shell process writes them; it waits for a line from this process. The exit code is not
    changed. On systems without a POSIX shell nothing is written.
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
