"""The process in which an FMU runs: started when it is needed, ended after a number of runs."""

from __future__ import annotations

import contextlib
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import threading
import weakref
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from aleator.errors import AleatorError, SimulatorError, SurroundingsError
from aleator.simulators.fmu import session
from aleator.simulators.fmu.description import INTERFACES
from aleator.simulators.fmu.session import Failed, FMURun, FMUSession, Setup, Trajectory
from aleator.simulators.fmu.settings import Operation, ResolvedSettings
from aleator.simulators.protocol import RunFailed, with_log
from aleator.simulators.surroundings import exit_status


class FMUInProcess:
    """An FMU session in this process; it has the members of `FMUProcess`, but no time limit."""

    def __init__(self, setup: Setup) -> None:
        self.runs, self.note, self.alive = 0, "", True
        try:
            self._session = FMUSession(setup)
        except Exception as error:
            shutil.rmtree(setup["folder"], ignore_errors=True)
            said = getattr(error, "message", str(error)), getattr(error, "log", "")
            raise Failed(*said, fatal=True) from None

    def run(self, job: FMURun, _timeout: float | None, logging: bool = False) -> Trajectory:
        """The trajectory of a run; raises Failed if there is none."""
        self.runs += 1
        trajectory = self._session.run(job, logging)
        self.note = self._session.note
        return trajectory

    def close(self) -> None:
        """Free the FMU and remove its folder."""
        self.alive = False
        self._session.close()


def unusable(fmu: Path, failure: Failed, begun: bool = False) -> AleatorError:
    """The error for an FMU that cannot be instantiated; `begun` says that earlier it could be."""
    kind, again = (SurroundingsError, " again") if begun else (SimulatorError, "")
    said = with_log(failure.message, failure.log)
    return kind(
        f"the FMU {fmu.name} cannot be instantiated{again}: {said}",
        "see that its libraries, files and licenses are on this machine",
    )


class Hung(RunFailed):
    """A run that was killed because it exceeded its time limit."""


class FMUProcess:
    """An FMU session in a child process, which ends when it is closed or when this process ends.

    The child is a separate program, not a process of `multiprocessing`: that would need a main
    guard in the user's script, and does not work in daemonic workers. An FMU may take `start`
    seconds to be instantiated, since some request a license first, and `end` seconds to be freed. A
    failure shows the last `log` bytes of its output. These values are chosen by judgement.

    Raises Failed if the FMU cannot be instantiated.
    """

    def __init__(
        self, setup: Setup, start: float = 300.0, end: float = 5.0, log: int = 4000
    ) -> None:
        self._end, self._most = end, log
        self.runs, self.note, self._folder = 0, "", setup["folder"]
        self._printed = tempfile.TemporaryFile("a+b")  # noqa: SIM115 # as long as the process
        self._process = subprocess.Popen(
            [sys.executable, "-c", _program()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._printed,
        )
        try:
            answer = self._ask(setup, start)
        except Failed:
            self.kill()
            raise
        except TimeoutError as error:
            self.kill()
            raise Failed(str(error), "", fatal=True) from None
        assert answer == ("ready",)

    def run(self, job: FMURun, timeout: float | None, logging: bool = False) -> Trajectory:
        """The trajectory of a run. Raises Failed, or Hung at the time limit.

        Afterwards `alive` is false if the process was killed, ended by itself, or must not be used
        any more.
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
            failure.log = failure.log or self._tail(before)
            if failure.fatal:
                self.kill()
            raise
        _, trajectory, self.note = answer
        return trajectory  # type: ignore[no-any-return] # as `serve` sends it

    @property
    def alive(self) -> bool:
        """Whether the process can make another run."""
        return self._process.poll() is None

    def close(self) -> None:
        """Let the process free the FMU and remove its folder; kill it if that takes too long."""
        if self.alive and self._process.stdin is not None:
            try:
                self._process.stdin.close()
                self._process.wait(timeout=self._end)
            except (OSError, subprocess.TimeoutExpired):
                pass
        self.kill()

    def kill(self) -> None:
        """End the process at once, and remove the FMU's folder."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                # Closing fails if the process never read all data.
                with contextlib.suppress(OSError):
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
            raise Failed(
                f"its process ended with {exit_status(code)}", self._tail(0), True
            ) from None
        except BaseException:
            self.kill()  # After Ctrl-C a late answer could be taken for the next run's answer.
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
        self._printed.seek(max(start, end - self._most))
        return self._printed.read().decode(errors="replace").strip()


def _program() -> str:
    """The program of the child process: the file of `session`, with this process's search path."""
    file = str(Path(session.__file__).resolve())
    path = [str(Path(entry).resolve()) if entry else str(Path.cwd()) for entry in sys.path]
    return (
        f"import runpy, sys; sys.path[:] = {path!r}; runpy.run_path({file!r}, run_name='__main__')"
    )


class Engine:
    """Makes runs of one FMU, one after the other, in the process that `operation` chooses.

    It can be pickled; each copy starts its own process.
    """

    def __init__(
        self,
        file: Path,
        course: ResolvedSettings,
        records: tuple[str, ...],
        signals: NDArray[Any] | None,
        operation: Operation,
    ) -> None:
        self._file, self._course, self._records = file, course, records
        self._signals, self._operation = signals, operation
        self._notes: dict[str, None] = {}
        self._process: FMUProcess | FMUInProcess | None
        self._idle()

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user, for example that resets of the FMU were given up."""
        return tuple(self._notes)

    def run(self, job: FMURun) -> Trajectory:
        """The trajectory of a run. Raises RunFailed, with the FMU's log messages."""
        with self._lock:
            try:
                return self._run(job)
            except RunFailed as failure:
                if failure.log or isinstance(failure, Hung):
                    raise
                raise RunFailed(failure.message, self._logged(job)) from None

    def close(self) -> None:
        """End the process of the FMU; a later run starts another one."""
        self._finalizer()
        self._process = None

    def __getstate__(self) -> dict[str, Any]:
        open_only = ("_process", "_lock", "_finalizer", "_pid")
        return {key: value for key, value in self.__dict__.items() if key not in open_only}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._idle()

    def _idle(self) -> None:
        self._process = None
        self._lock = threading.RLock()
        self._finalizer: Any = lambda: None
        self._pid = os.getpid()

    def _run(self, job: FMURun, logging: bool = False) -> Trajectory:
        process = self._opened()
        try:
            trajectory = process.run(job, self._operation.timeout, logging)
        except Failed as failure:
            if failure.begun:
                raise RunFailed(failure.message, failure.log) from None
            raise unusable(self._file, failure, begun=True) from None
        if process.note:
            self._notes[process.note] = None
        return trajectory

    def _logged(self, job: FMURun) -> str:
        """The log of a failed run that had none: the run is repeated with the FMU's log on."""
        try:
            self._run(job, logging=True)
        except RunFailed as failure:
            return failure.log
        return ""

    def _opened(self) -> FMUProcess | FMUInProcess:
        if self._pid != os.getpid():  # In a fork, the child process belongs to the original.
            self._idle()
        process = self._process
        if process is not None and process.alive and process.runs < self._operation.recycle:
            return process
        self.close()
        try:
            process = (FMUProcess if self._operation.isolated else FMUInProcess)(self._setup())
        except Failed as failure:
            raise unusable(self._file, failure) from None
        self._finalizer = weakref.finalize(self, process.close)
        self._process = process
        return process

    def _setup(self) -> Setup:
        return Setup(
            fmu=str(self._file),
            folder=tempfile.mkdtemp(prefix="aleator_fmu_"),
            interface=INTERFACES[self._course.kind],
            tolerance=self._course.tolerance,
            outputs=[*self._records],
            signals=self._signals,
            reset=self._operation.reuse == "reset",
        )
