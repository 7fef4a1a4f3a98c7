"""One run of a program: started, waited for, and never left behind."""

from __future__ import annotations

import errno
import math
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

from aleator.errors import SimulatorError, SurroundingsError
from aleator.simulators.command.janitor import leads
from aleator.simulators.command.signals import signals_held
from aleator.simulators.failure import RunFailed
from aleator.simulators.surroundings import (
    NEARLY_FULL,
    STOP_ON,
    full_disk,
    prevented,
    printed,
    require_pattern,
)

STDIN, STDOUT, STDERR = "aleator.stdin", "aleator.stdout", "aleator.stderr"
# What a message or a log keeps of a text without end.
_TAIL = 4000
# What a program gets to tidy up after SIGTERM, seconds.
_GRACE = 1.0


@dataclass(frozen=True)
class Limits:
    """When a run has ended well: its exit code, within `timeout` seconds (None: no limit).

    One that has not is not a run where it printed `stop_on`, or where the disk is full.

    Raises SimulatorError for what cannot be these.
    """

    success_codes: tuple[int, ...] = (0,)
    timeout: float | None = None
    stop_on: str = STOP_ON

    def __post_init__(self) -> None:
        if self.timeout is not None and not 0 < self.timeout < math.inf:
            raise SimulatorError(
                f"timeout = {self.timeout:g} is no time", "give seconds, or leave it out: no limit"
            )
        if not self.success_codes:
            raise SimulatorError("success_codes is empty: every run would fail", "write [0]")
        require_pattern(self.stop_on)

    def judged(self, failure: RunFailed, folder: Path) -> RunFailed | SurroundingsError:
        """A failure in `folder` with what was printed there; or what the machine did."""
        said = failure.log or log(folder)
        fault = printed(said, self.stop_on) or full_disk(folder, NEARLY_FULL)
        return fault or RunFailed(failure.message, said)


def run(
    arguments: Sequence[str], folder: Path, environment: Mapping[str, str], limits: Limits
) -> None:
    """Run a program in `folder`; it reads STDIN there if that exists, and prints to files.

    Its whole process group ends with it, or with this process, whatever happens. Files and not
    pipes: a run that prints without end, or leaves a child that holds its output, cannot block.

    Raises RunFailed if its arguments are none that a program can be given, if it takes too long, or
    ends with another exit code; SurroundingsError if the system does not start it.
    """
    stdin = folder / STDIN
    source = stdin if stdin.exists() else Path(os.devnull)
    with (
        source.open("rb") as read,
        (folder / STDOUT).open("wb") as out,
        (folder / STDERR).open("wb") as err,
        ExitStack() as ends,
    ):
        with signals_held():
            try:
                process = subprocess.Popen(
                    arguments,
                    cwd=folder,
                    env={**os.environ, **environment},
                    stdin=read,
                    stdout=out,
                    stderr=err,
                    start_new_session=True,
                )
            except (OSError, ValueError) as error:
                raise _not_started(arguments[0], error) from error
            ends.callback(_end, process)
            ends.enter_context(leads(folder, process.pid))
        try:
            code = process.wait(limits.timeout)
        except subprocess.TimeoutExpired:
            _ask_to_end(process)
            raise RunFailed(f"it was stopped after its {limits.timeout:g} s", log(folder)) from None
    if code not in limits.success_codes:
        raise RunFailed(f"it {_how(code)}", log(folder))


def _not_started(program: str, error: OSError | ValueError) -> RunFailed | SurroundingsError:
    """What a program that did not start is: a failed run, or one that the system refused."""
    if isinstance(error, ValueError) or error.errno == errno.E2BIG:
        reason = getattr(error, "strerror", None) or str(error)
        return RunFailed(f"'{program}' cannot be started: {reason}")
    return prevented(error, f"'{program}' cannot be started")


def _ask_to_end(process: subprocess.Popen[bytes]) -> None:
    os.killpg(process.pid, signal.SIGTERM)
    try:
        process.wait(_GRACE)
    except subprocess.TimeoutExpired:
        return


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill what is left of the group: nothing, where all its processes have ended."""
    with suppress(ProcessLookupError, PermissionError):  # the latter: zombies only, on macOS
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _how(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"was ended by signal {-code}"


def log(folder: Path) -> str:
    """The last of what a run printed, errors last.

    >>> log(Path("nowhere"))
    ''
    """
    texts = [_tail(folder / name) for name in (STDOUT, STDERR)]
    return "\n".join(filter(None, texts))


def _tail(path: Path) -> str:
    try:
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - _TAIL, 0))
            return file.read().decode("utf-8", "replace").strip()
    except OSError:
        return ""


def read_text(path: Path) -> str:
    """A file that a program wrote, as text; what is not UTF-8 is replaced."""
    return path.read_bytes().decode("utf-8", "replace")
