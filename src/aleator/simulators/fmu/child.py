"""A process of its own for an FMU: what hangs in it can be killed, what crashes kills only it."""

from __future__ import annotations

import contextlib
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

from aleator.simulators.failure import RunFailed
from aleator.simulators.fmu import session
from aleator.simulators.fmu.inside import unusable
from aleator.simulators.fmu.session import Failed, Job, Setup, Trajectory

START_LIMIT = 300.0  #: s that an FMU may take to be instantiated, as some ask for a license first
LOG_TAIL = 4000  #: bytes of what the FMU printed that a failure shows


class Hung(RunFailed):
    """A run that was killed by its time limit."""


class Child:
    """A session in a child process; it ends when this is closed, or when this process ends.

    A program of its own rather than `multiprocessing`, so that neither a script without a main
    guard nor a daemonic worker is in its way.

    Raises SimulatorError if the FMU cannot be instantiated.
    """

    def __init__(self, setup: Setup) -> None:
        self.runs = 0
        self.note = ""
        self._fmu, self._folder = setup["fmu"], setup["folder"]
        self._printed = tempfile.TemporaryFile("a+b")  # noqa: SIM115 # as long as the process
        self._process = subprocess.Popen(
            [sys.executable, "-c", _program()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._printed,
        )
        try:
            answer = self._ask(setup, START_LIMIT)
        except (Failed, TimeoutError) as error:
            self.kill()
            log = getattr(error, "log", "")
            raise unusable(setup["fmu"], getattr(error, "message", str(error)), log) from None
        assert answer == ("ready",)

    def run(self, job: Job, timeout: float | None, logging: bool = False) -> Trajectory:
        """The trajectory of a run; raises RunFailed, or Hung.

        Afterwards `alive` is false if the process had to be killed, ended by itself, or must not be
        used any more.
        """
        before = self._printed.seek(0, 2)
        self.runs += 1
        try:
            answer = self._ask((job, logging), timeout)
        except TimeoutError as error:
            log = self._tail(before)
            self.kill()
            raise Hung(str(error), log) from None
        except Failed as failure:
            log = failure.log or self._tail(before)
            if failure.fatal:
                self.kill()
            if not failure.begun:
                raise unusable(self._fmu, failure.message, log, begun=True) from None
            raise RunFailed(failure.message, log) from None
        _, trajectory, self.note = answer
        return trajectory  # type: ignore[no-any-return] # as `serve` sends it

    @property
    def alive(self) -> bool:
        """Whether another run can be asked for."""
        return self._process.poll() is None

    def close(self) -> None:
        """Let the process free the FMU and remove its folder; kill it if that takes long."""
        if self.alive and self._process.stdin is not None:
            try:
                self._process.stdin.close()
                self._process.wait(timeout=5.0)
            except (OSError, subprocess.TimeoutExpired):
                pass
        self.kill()

    def kill(self) -> None:
        """End the process at once, and remove the FMU's folder."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):  # of what the process never read
                    pipe.close()
        self._printed.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _ask(self, message: Any, timeout: float | None) -> tuple[Any, ...]:
        """Send a message and wait for its answer. Raises Failed or TimeoutError."""
        expired = threading.Event()

        def expire() -> None:
            expired.set()
            self._process.kill()

        timer = threading.Timer(timeout or 0.0, expire)
        timer.daemon = True
        if timeout is not None:
            timer.start()
        try:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            pickle.dump(message, self._process.stdin)
            self._process.stdin.flush()
            answer: tuple[Any, ...] = pickle.load(self._process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError):
            if expired.is_set():
                raise TimeoutError(f"it did not end within {timeout:g} s") from None
            code = self._process.wait()
            raise Failed(f"its process ended with {_ending(code)}", self._tail(0), True) from None
        except BaseException:
            self.kill()  # Ctrl-C: an answer that nobody waits for must not meet the next question
            raise
        finally:
            timer.cancel()
            if expired.is_set():
                self._process.wait()
        if answer[0] == "failed":
            raise Failed(*answer[1:])
        return answer

    def _tail(self, start: int) -> str:
        end = self._printed.seek(0, 2)
        self._printed.seek(max(start, end - LOG_TAIL))
        return self._printed.read().decode(errors="replace").strip()


def _program() -> str:
    """The child's program: this process's search path, and the file of `session`."""
    file = str(Path(session.__file__).resolve())
    path = [str(Path(entry).resolve()) if entry else str(Path.cwd()) for entry in sys.path]
    return (
        f"import runpy, sys; sys.path[:] = {path!r}; runpy.run_path({file!r}, run_name='__main__')"
    )


def _ending(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"
