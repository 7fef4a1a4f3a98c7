"""One FMU instance in one process, which makes run after run.

This file is also the program of the process in which an FMU runs (see `engine`). It imports nothing
of Aleator, so that such a process starts in a third of a second.
"""

from __future__ import annotations

import math
import os
import pickle
import shutil
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
from numpy.typing import NDArray

Trajectory = dict[str, NDArray[Any]]
Values = dict[str, float | int | bool | str]

FATAL = 4  #: The status of FMI after which no function of the FMU may be called any more.
# The solver of a model exchange calls these functions from C, where an exception would be lost.
_CALLED_BACK = (
    "setTime",
    "setContinuousStates",
    "getEventIndicators",
    "getDerivatives",
    "getContinuousStateDerivatives",
)
_DERIVATIVES = _CALLED_BACK[-2:]


@dataclass(frozen=True)
class SessionSettings:
    """Settings of when a run is complete and when it is given up; by judgement, except `close`."""

    logged: int = 50
    """The number of log messages of the FMU that are kept: the last ones."""
    stalled: int = 1000
    """The number of events without an advance of time after which a run is given up."""
    soon: float = 1.0
    """Seconds between two checks whether the calling process still exists; after its end this
    process ends in as many seconds."""
    close: float = 2e-9
    """The relative difference below which two times are equal: twice the 1e-9 of FMPy."""
    ended: float = 1e-6
    """The relative distance to the stop time within which a run has reached it."""
    same: float = 1e-9
    """The relative difference below which the trajectories with and without a reset are equal."""
    zero: float = 1e-12
    """The difference, over the largest value, below which small values are equal in that check."""


SETTINGS = SessionSettings()


class Setup(TypedDict):
    """The settings of a session, as plain values that can be sent to another process."""

    fmu: str
    folder: str
    interface: str
    tolerance: float | None
    outputs: list[str]
    signals: NDArray[Any] | None
    reset: bool


class FMURun(TypedDict):
    """One run: the start values by variable, and its times in s.

    Communication points are `step` apart, or at `points` after the start if these are given.
    """

    values: Values
    start_time: float
    stop_time: float
    step: float
    points: NDArray[np.float64]


class Failed(Exception):
    """A run without a complete trajectory; after a `fatal` one the process cannot be used again.

    `begun` is false if the FMU could not be instantiated: then no parameter is at fault.
    """

    def __init__(self, message: str, log: str, fatal: bool, begun: bool = True) -> None:
        super().__init__(message, log, fatal, begun)
        self.message, self.log, self.fatal, self.begun = message, log, fatal, begun


class FMUSession:
    """An FMU in the folder `setup["folder"]`, instantiated once and reset before each further run.

    To check the reset, runs after it are repeated on a new instance, until one with other values
    than the run before agrees. If the two trajectories differ, or the reset fails, every further
    run gets a new instance, and `note` says so.
    """

    def __init__(self, setup: Setup, settings: SessionSettings = SETTINGS) -> None:
        import fmpy

        self.setup, self._settings = setup, settings
        self.note = ""
        self._log: deque[str] = deque(maxlen=settings.logged)
        self._reset = setup["reset"]
        self._trusted = False
        self._used: dict[str, Any] | None = None
        self._logging = False
        fmpy.extract(setup["fmu"], setup["folder"])
        self._description = fmpy.read_model_description(setup["folder"], validate=False)
        self._instance: Any = self._created()

    def run(self, job: FMURun, logging: bool = False) -> Trajectory:
        """The trajectory of a run: "time" and the outputs, (T,) each. Raises Failed.

        With `logging` the run has a new instance that writes its log.
        """
        self._log.clear()
        if logging:
            self._discard()
        self._logging = logging
        try:
            return self._reused(job)
        except Failed as failure:
            self._discard(free=not failure.fatal)
            raise
        finally:
            if logging:
                self._discard()
            self._logging = False

    def close(self) -> None:
        """Free the instance, unload the FMU and remove its folder."""
        self._discard()
        shutil.rmtree(self.setup["folder"], ignore_errors=True)

    def _reused(self, job: FMURun) -> Trajectory:
        if self._used is None or not self._reset:
            return self._anew(job)
        compare, other = not self._trusted, job["values"] != self._used
        try:
            self._instance.reset()
            trajectory = self._simulated(job)
        except Exception as error:
            if not compare:
                raise self._failed(error) from error
            trajectory = {}
        if not compare:
            return trajectory
        anew = self._anew(job)
        same = _same(trajectory, anew, self._settings)
        # A run with the same values as the run before would not test the reset.
        self._trusted = same and other
        if not same:
            self._reset = False
            self.note = (
                "the FMU does not give the same after a reset as when it is created anew: "
                "every run gets a new instance"
            )
        return anew

    def _anew(self, job: FMURun) -> Trajectory:
        if self._instance is None or self._used is not None:
            self._discard()
            self._instance = self._created()
        try:
            return self._simulated(job)
        except Exception as error:
            raise self._failed(error) from error

    def _created(self) -> Any:
        import fmpy

        here = os.getcwd()  # FMPy changes the current folder to load a library.
        try:
            instance = fmpy.instantiate_fmu(
                self.setup["folder"],
                self._description,
                self.setup["interface"],
                logger=self._listen,
                debug_logging=self._logging,
            )
        except Exception as error:
            failed = self._failed(error)
            raise Failed(failed.message, failed.log, failed.fatal, begun=False) from error
        finally:
            os.chdir(here)
        self._used = None
        return instance

    def _discard(self, free: bool = True) -> None:
        if self._instance is not None and free:
            self._instance.freeInstance()
        self._instance = self._used = None

    def _simulated(self, job: FMURun) -> Trajectory:
        import fmpy

        self._used = job["values"]
        setup = self.setup
        inputs = self._inputs(job["values"])
        watch = _Watch(1 if setup["interface"] == "CoSimulation" else self._settings.stalled)
        if setup["interface"] == "ModelExchange":
            watch.guard(self._instance, self._description, inputs)
        result = fmpy.simulate_fmu(
            setup["folder"],
            start_time=job["start_time"],
            stop_time=job["stop_time"],
            output_interval=_OutputTimes(job) if len(job["points"]) else job["step"],
            relative_tolerance=setup["tolerance"],
            start_values=job["values"],
            input=inputs,
            output=setup["outputs"],
            step_finished=watch.finished,
            model_description=self._description,
            fmu_instance=self._instance,
        )
        watch.raise_lost()
        trajectory = {name: np.array(result[name]) for name in result.dtype.names}
        last, end = float(trajectory["time"][-1]), job["stop_time"]
        if not math.isclose(last, end, rel_tol=self._settings.ended):
            raise RuntimeError(f"it stopped at time {last:g} s instead of {end:g} s")
        _require_points(trajectory["time"], job["points"], self._settings.close)
        return trajectory

    def _inputs(self, values: Values) -> NDArray[Any] | None:
        """The input signals, and a constant column for each other input: FMPy needs all or none."""
        signals = self.setup["signals"]
        if signals is None:
            return None
        constant = {
            variable.name: values.get(variable.name, _started(variable))
            for variable in self._description.modelVariables
            if variable.causality == "input" and not variable.shape
            if variable.type not in ("String", "Binary", "Clock")
            if variable.name not in (signals.dtype.names or ())
        }
        kinds = [(name, np.asarray(value).dtype) for name, value in constant.items()]
        table = np.empty(len(signals), dtype=[*signals.dtype.descr, *kinds])
        for name in signals.dtype.names or ():
            table[name] = signals[name]
        for name, value in constant.items():
            table[name] = value
        return table

    def _failed(self, error: Exception) -> Failed:
        if isinstance(error, Failed):
            return error
        status = getattr(error, "status", None)
        return Failed(" ".join(str(error).split()), "\n".join(self._log), status == FATAL)

    def _listen(self, *message: Any) -> None:
        # The arguments are environment, instance, status, category, text; FMI 3.0 has no instance.
        status, text = message[-3], message[-1]
        labels = ("ok", "warning", "discard", "error", "fatal", "pending")
        label = labels[status] if status in range(len(labels)) else status
        line = f"[{label}] {(text or b'').decode(errors='replace')}"
        if not self._log or self._log[-1] != line:  # A repeated message is kept only once.
            self._log.append(line)


class _OutputTimes:
    """Communication points at any times, in place of the distance between them that FMPy expects.

    FMPy computes point k as `start + k * distance`, k = 1, 2, ...; this object is the distance.
    """

    def __init__(self, job: FMURun) -> None:
        self._distances = (job["points"] - job["start_time"]).tolist()

    def __rmul__(self, number: int) -> float:
        return float(self._distances[number - 1])


def _require_points(time: NDArray[np.float64], points: NDArray[np.float64], close: float) -> None:
    """Raise RuntimeError if the run has no sample at one of the requested points."""
    margin = close * np.abs(points)
    sample = np.searchsorted(time, points - margin).clip(max=len(time) - 1)
    missed = points[np.abs(time[sample] - points) > margin]
    if len(missed):
        raise RuntimeError(f"it did not stop at time {missed[0]:g} s, as it was asked to")


class _Watch:
    """Supervises a run by FMPy: time must advance within at most `patience` steps.

    The solver of a model exchange calls the FMU from C, where an exception would be lost. So the
    exception is recorded, and the solver gets NaN instead. Inputs over time are set before each of
    these calls.
    """

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self._at = -math.inf
        self._still = 0
        self._lost: list[Exception] = []

    def guard(self, instance: Any, description: Any, inputs: NDArray[Any] | None) -> None:
        """Wrap those functions of the FMU instance that the solver calls."""
        for name in _CALLED_BACK:
            call = getattr(type(instance), name, None)
            if call is not None:
                setattr(instance, name, self._kept(call.__get__(instance), name in _DERIVATIVES))
        if inputs is not None:
            from fmpy.simulation import Input

            instance.setTime = self._kept(
                self._timed(instance, Input(instance, description, inputs))
            )

    def finished(self, time: float, _recorder: object) -> bool:
        """Check a run after a step; FMPy calls this.

        Raises a recorded exception, and an error if time does not advance.
        """
        self.raise_lost()
        self._still = 0 if time > self._at else self._still + 1
        if self._still >= self._patience:
            raise RuntimeError(f"it does not advance beyond time {time:g} s")
        self._at = time
        return True

    def raise_lost(self) -> None:
        """Raise the first exception that occurred in a call from C."""
        if self._lost:
            raise self._lost[0]

    def _kept(self, call: Callable[..., Any], derivatives: bool = False) -> Callable[..., Any]:
        def called(*arguments: Any) -> Any:
            try:
                return call(*arguments)
            except Exception as error:
                self._lost.append(error)
                if derivatives:
                    values, number = arguments
                    for k in range(number):
                        values[k] = math.nan

        return called

    def _timed(self, instance: Any, inputs: Any) -> Callable[[float], None]:
        set_time = type(instance).setTime.__get__(instance)

        def timed(time: float) -> None:
            set_time(time)
            # At the start of a step after a jump of an input, the value after the jump is used.
            inputs.apply(time, discrete=False, after_event=time <= self._at)

        return timed


def _started(variable: Any) -> float | int | bool:
    """The start value of an input, from the model description."""
    text = str(variable.start or 0)
    if variable.type == "Boolean":
        return text.lower() in ("true", "1")
    return float(text) if variable.type in ("Real", "Float64", "Float32") else int(text)


def _same(one: Trajectory, other: Trajectory, settings: SessionSettings) -> bool:
    if one.keys() != other.keys():
        return False
    return all(
        len(a) == len(b)
        and np.allclose(
            a, b, rtol=settings.same, atol=settings.zero * np.max(np.abs(b)), equal_nan=True
        )
        for a, b in ((one[name], other[name]) for name in one)
    )


def _end_with(asker: int, folder: str, soon: float = SETTINGS.soon) -> None:
    """End this process soon after the calling process has ended, even if the FMU hangs."""
    while os.getppid() == asker:
        time.sleep(soon)
    time.sleep(soon)  # Meanwhile an FMU that does not hang is freed.
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def serve() -> None:
    """Read a Setup and then runs from stdin, and reply to each on stdout, until stdin ends.

    Text that the FMU prints goes to stderr.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The calling process handles Ctrl-C.
    requests = os.fdopen(os.dup(0), "rb")
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    sys.stdout = sys.stderr

    def reply(*message: Any) -> None:
        pickle.dump(message, replies)
        replies.flush()

    asker = os.getppid()
    setup = pickle.load(requests)
    threading.Thread(target=_end_with, args=(asker, setup["folder"]), daemon=True).start()
    try:
        session = FMUSession(setup)
    except Exception as error:
        reply("failed", getattr(error, "message", str(error)), getattr(error, "log", ""), True)
        shutil.rmtree(setup["folder"], ignore_errors=True)
        return
    try:
        reply("ready")
        while True:
            job, logging = pickle.load(requests)
            try:
                reply("done", session.run(job, logging), session.note)
            except Failed as failure:
                reply("failed", *failure.args)
    except (EOFError, BrokenPipeError):
        pass  # The calling process has closed the session, or was killed while the FMU ran.
    finally:
        session.close()


if __name__ == "__main__":
    serve()
