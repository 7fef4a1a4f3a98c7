"""The process that an FMU runs in: started when it is needed, ended after so many runs."""

from __future__ import annotations

import os
import tempfile
import threading
import weakref
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from aleator.simulators.failure import RunFailed
from aleator.simulators.fmu.child import Child, Hung
from aleator.simulators.fmu.description import INTERFACES
from aleator.simulators.fmu.inside import Inside
from aleator.simulators.fmu.session import Job, Setup, Trajectory
from aleator.simulators.fmu.settings import Operation, Settled


class Engine:
    """Runs of one FMU, one after the other, in a process that `operation` chooses.

    It can be pickled; each copy starts its own process.
    """

    def __init__(
        self,
        file: Path,
        course: Settled,
        records: tuple[str, ...],
        signals: NDArray[Any] | None,
        operation: Operation,
    ) -> None:
        self._file = file
        self._course = course
        self._records = records
        self._signals = signals
        self._operation = operation
        self._notes: dict[str, None] = {}
        self._process: Child | Inside | None
        self._idle()

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of how the runs went: a reset that was given up."""
        return tuple(self._notes)

    def run(self, job: Job) -> Trajectory:
        """The trajectory of a run. Raises RunFailed, with what the FMU logged."""
        with self._lock:
            try:
                return self._run(job)
            except RunFailed as failure:
                if failure.log or isinstance(failure, Hung):
                    raise
                raise RunFailed(failure.message, self._logged(job)) from None

    def close(self) -> None:
        """End the process; a later run starts another."""
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

    def _run(self, job: Job, logging: bool = False) -> Trajectory:
        process = self._opened()
        trajectory = process.run(job, self._operation.timeout, logging)
        if process.note:
            self._notes[process.note] = None
        return trajectory

    def _logged(self, job: Job) -> str:
        """What the FMU logs in a run that failed silently: it is repeated with its log on."""
        try:
            self._run(job, logging=True)
        except RunFailed as failure:
            return failure.log
        return ""

    def _opened(self) -> Child | Inside:
        if self._pid != os.getpid():  # forked: the process belongs to the one that opened it
            self._idle()
        process = self._process
        if process is not None and process.alive and process.runs < self._operation.recycle:
            return process
        self.close()
        process = (Child if self._operation.isolated else Inside)(self._setup())
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
