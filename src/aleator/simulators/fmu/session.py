"""One FMU instance in one process, run after run.

This file is also the program of the process that an FMU runs in (see `engine`). So that such a
process starts in a third of a second, it imports nothing of Aleator.
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
# What the solver of a model exchange calls from C, where an exception would be lost.
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
    """When a run of an FMU is complete, and when it is given up; by judgement but for `close`."""

    logged: int = 50
    """Messages of the FMU that are kept, the last ones."""
    stalled: int = 1000
    """Events without any advance of time after which a run is given up."""
    soon: float = 1.0
    """Seconds between two looks whether the calling process still exists, and until the end."""
    close: float = 2e-9
    """Relative difference of times that count as equal: twice the 1e-9 of FMPy."""
    ended: float = 1e-6
    """Relative distance to the stop time at which a run has reached it."""
    same: float = 1e-9
    """Relative difference of two trajectories that count as the same after a reset."""
    zero: float = 1e-12
    """The same for small values, relative to the largest value of the trajectory."""


SETTINGS = SessionSettings()


class Setup(TypedDict):
    """The settings of a session, as plain values for another process."""

    fmu: str
    folder: str
    interface: str
    tolerance: float | None
    outputs: list[str]
    signals: NDArray[Any] | None
    reset: bool


class FMURun(TypedDict):
    """One run: start values by variable, and its times in s.

    Communication points are `step` apart, or at `points` after the start if there are any.
    """

    values: Values
    start_time: float
    stop_time: float
    step: float
    points: NDArray[np.float64]


class Failed(Exception):
    """A run without a complete trajectory; after a `fatal` one the process cannot be used again.

    `begun` is false if there was no instance, so that no parameter is at fault.
    """

    def __init__(self, message: str, log: str, fatal: bool, begun: bool = True) -> None:
        super().__init__(message, log, fatal, begun)
        self.message, self.log, self.fatal, self.begun = message, log, fatal, begun


class FMUSession:
    """An FMU unzipped into `setup["folder"]`, instantiated once and reset before each further run.

    Runs after a reset are repeated on a new instance, up to the first with other values than the
    run before. If the two trajectories differ, or the reset fails, every further run gets a new
    instance, and `note` says so.
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
        """A run to "time" and the outputs, each (T,). Raises Failed."""
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
        self._trusted = same and other  # equal runs would hide what the last one left behind
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

        here = os.getcwd()  # FMPy goes elsewhere to load a library, and stays if that fails
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
        """The signals, with a constant column for every other input: FMPy needs all or none."""
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
        # FMI 2.0: environment, instance, status, category, text; FMI 3.0: without the instance.
        status, text = message[-3], message[-1]
        labels = ("ok", "warning", "discard", "error", "fatal", "pending")
        label = labels[status] if status in range(len(labels)) else status
        line = f"[{label}] {(text or b'').decode(errors='replace')}"
        if not self._log or self._log[-1] != line:  # a solver asks for the same again and again
            self._log.append(line)


class _OutputTimes:
    """Communication points at any times, in place of the distance between them that FMPy expects.

    FMPy computes the next point as `start + number * distance`, with numbers from 1.
    """

    def __init__(self, job: FMURun) -> None:
        self._distances = (job["points"] - job["start_time"]).tolist()

    def __rmul__(self, number: int) -> float:
        return float(self._distances[number - 1])


def _require_points(time: NDArray[np.float64], points: NDArray[np.float64], close: float) -> None:
    """Raise RuntimeError if the run has no sample at one of the points."""
    margin = close * np.abs(points)
    sample = np.searchsorted(time, points - margin).clip(max=len(time) - 1)
    missed = points[np.abs(time[sample] - points) > margin]
    if len(missed):
        raise RuntimeError(f"it did not stop at time {missed[0]:g} s, as it was asked to")


class _Watch:
    """Supervises a run of FMPy: at most `patience` steps may pass without an advance of time.

    The solver of a model exchange calls the FMU from C, where an exception would be lost. So it is
    kept, and the solver gets NaN instead. Inputs over time are set before each of these calls.
    """

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self._at = -math.inf
        self._still = 0
        self._lost: list[Exception] = []

    def guard(self, instance: Any, description: Any, inputs: NDArray[Any] | None) -> None:
        """Wrap the instance's functions that the solver calls."""
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
        """Called by FMPy after a step; raises a lost exception, and an error at a standstill."""
        self.raise_lost()
        self._still = 0 if time > self._at else self._still + 1
        if self._still >= self._patience:
            raise RuntimeError(f"it does not advance beyond time {time:g} s")
        self._at = time
        return True

    def raise_lost(self) -> None:
        """Raise the first exception of a call from C."""
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
            # At the start of a step that follows a jump of an input, its value after the jump.
            inputs.apply(time, discrete=False, after_event=time <= self._at)

        return timed


def _started(variable: Any) -> float | int | bool:
    """The start value of an input by the model description."""
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
    """End this process soon after the calling process, even if the FMU hangs."""
    while os.getppid() == asker:
        time.sleep(soon)
    time.sleep(soon)  # in which an FMU that does not hang is freed
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def serve() -> None:
    """Read a Setup and then jobs from stdin, and write a reply to each to stdout, until stdin ends.

    Output of the FMU goes to stderr.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that started this
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
