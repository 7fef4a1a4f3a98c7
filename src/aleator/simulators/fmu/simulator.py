"""An FMU as a simulator."""

from __future__ import annotations

import hashlib
import math
import os
import tempfile
import threading
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aleator.errors import SimulatorError
from aleator.simulators.failure import RunFailed
from aleator.simulators.fmu.binding import Binding, Value, settable, start_value
from aleator.simulators.fmu.child import Child, Hung
from aleator.simulators.fmu.description import INTERFACES, read_description
from aleator.simulators.fmu.inside import Inside
from aleator.simulators.fmu.reduction import Reduction
from aleator.simulators.fmu.session import Setup, Trajectory
from aleator.simulators.fmu.settings import Course, Operation
from aleator.simulators.fmu.signals import Signal, assembled, checked_input
from aleator.simulators.protocol import SINGLE_BLOCK, Columns, Returned, one_by_one

DEFAULT_COURSE = Course()
DEFAULT_OPERATION = Operation()


class FMUSimulator:
    """A Functional Mock-up Unit (FMI 2.0 or 3.0) run through FMPy; fills `Simulator`.

    Conditions and parameters are set before initialization, the FMU is simulated as `course` says,
    and `outcome` makes one number of its trajectory. `variables` maps conditions and parameters to
    the FMU's variables; what it does not name has the variable's own name, and conditions that are
    no variables are not asked for. `constants` are start values by variable, `inputs` signals by
    variable. `version` is a text that the user changes when something that the FMU reads changes.

    The FMU runs in a process of its own, started at the first run and ended by `close`, or with
    this process. The simulator can be pickled; each copy starts its own process.

    Raises SimulatorError, before anything runs, for a file that cannot be run here, and for
    variables that do not exist or cannot be set. Measured cost: 0.3 s to start the process, and
    0.3 ms for a run of 20 steps beyond what the FMU itself takes.
    """

    block = SINGLE_BLOCK
    vectorized = False  # slow runs are then kept one by one

    def __init__(
        self,
        file: str | Path,
        outcome: Reduction,
        *,
        course: Course = DEFAULT_COURSE,
        variables: Mapping[str, str] | None = None,
        constants: Mapping[str, Value] | None = None,
        inputs: Mapping[str, Signal] | None = None,
        operation: Operation = DEFAULT_OPERATION,
        version: str = "",
    ) -> None:
        self.file = Path(file).resolve()
        self.name = Path(file).name
        self.fmu = read_description(self.file)
        self.course = course.of(self.fmu)
        self.outcome = outcome
        self.operation = operation
        self.version = version
        self.constants = self._constants(constants or {})
        signals = inputs or {}
        for name in signals:
            checked_input(self.fmu.variable(name, "an input over time"))
        both = sorted(set(signals) & set(self.constants))
        if both:
            raise SimulatorError(
                f"the FMU's variable '{both[0]}' is a constant and an input over time",
                "keep one of the two",
            )
        self._signals = assembled(signals, self.fmu)
        self._binding = Binding(self.fmu, dict(variables or {}), (*self.constants, *signals))
        self._records = outcome.needs(self.fmu)
        self._notes: dict[str, None] = {}
        self._engine: Child | Inside | None
        self._idle()

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that are variables of the FMU, in the order of `conditions`.

        Raises SimulatorError for a parameter that the FMU does not have, and for a condition or
        parameter that cannot be set: an output, a constant, what the FMU calculates.
        """
        return self._binding.asks(conditions, parameters)

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times, one after the other; raises RunStopped."""
        return one_by_one(lambda cells: self.run_one(cells, {}), conditions, parameters)

    def run_one(self, conditions: Mapping[str, Any], parameters: Mapping[str, float]) -> float:
        """The outcome of one run.

        Raises RunFailed, with what the FMU logged, for an error inside the FMU, a trajectory that
        ends early, an outcome that does not exist or is not finite, a crash, and after a timeout.
        """
        outcome = self.outcome(self.trajectory(conditions, parameters))
        if not math.isfinite(outcome):
            raise RunFailed(f"the outcome is {outcome:g}")
        return outcome

    def trajectory(
        self, conditions: Mapping[str, Any], parameters: Mapping[str, float]
    ) -> Trajectory:
        """Time and every variable that the outcome needs, (T,) each, of one run."""
        cells = {**conditions, **parameters}
        values = {**self.constants, **self._binding.values(cells)}
        with self._lock:
            try:
                return self._run(values)
            except RunFailed as failure:
                if failure.log or isinstance(failure, Hung):
                    raise
                raise RunFailed(failure.message, self._logged(values)) from None

    def fingerprint(self) -> str:
        """A hash of the FMU's bytes, every setting, the outcome's source, and `version`."""
        digest = self._digest()
        settings = (self.course, dict(self._binding.names), self.constants, self.version)
        digest.update(repr(settings).encode())
        digest.update(self.outcome.fingerprint().encode())
        if self._signals is not None:
            digest.update(repr(self._signals.dtype).encode() + self._signals.tobytes())
        return digest.hexdigest()

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of how the runs went: a reset that was given up."""
        return tuple(self._notes)

    def bindings(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """How it is run, which variables are set and recorded, with units, and what is not passed.

        Raises SimulatorError as `asks` does.
        """
        asked = self.asks(conditions, parameters)
        course = self.course
        kind = "co-simulation" if course.kind == "co_simulation" else "model exchange"
        span = f"{course.start_time:g} to {course.stop_time:g} s in steps of {course.step:g} s"
        recorded = (self.fmu.variables[name] for name in self._records)
        units = (f"{v.name} [{v.unit}]" if v.unit else v.name for v in recorded)
        lines = [f"FMI {self.fmu.version}, {kind} from {span}, recorded: {', '.join(units)}"]
        for what, names in (("conditions", asked), ("parameters", parameters)):
            lines.append(f"{what}: {self._binding.told(names) or 'none'}")
        if left := [name for name in conditions if name not in asked]:
            lines.append(f"no variables of the FMU, hence not passed: {', '.join(left)}")
        return tuple(lines)

    def describe(self) -> str:
        """The variables that can be set and those that can be recorded, with units."""
        chosen = [v for v in self.fmu.variables.values() if v.settable or v.causality == "output"]
        return "\n".join(f"{v}  {v.description}".rstrip() for v in chosen)

    def close(self) -> None:
        """End the FMU's process; a later run starts another."""
        self._finalizer()
        self._engine = None

    def __getstate__(self) -> dict[str, Any]:
        open_only = ("_engine", "_lock", "_finalizer", "_pid")
        kept = {key: value for key, value in self.__dict__.items() if key not in open_only}
        return {**kept, "sent": self._digest().hexdigest()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        sent = state.pop("sent")
        self.__dict__.update(state)
        if not self.file.is_file() or self._digest().hexdigest() != sent:
            raise SimulatorError(
                f"{self.file} is not the same for this worker as it was where the study was "
                "started, or not there",
                "let both have the same files, and start the study again",
            )
        self._idle()

    def _digest(self) -> hashlib._Hash:
        return hashlib.sha256(self.file.read_bytes())

    def _idle(self) -> None:
        self._engine = None
        self._lock = threading.RLock()
        self._finalizer: Any = lambda: None
        self._pid = os.getpid()

    def _opened(self) -> Child | Inside:
        if self._pid != os.getpid():  # forked: the engine belongs to the process that opened it
            self._idle()
        engine = self._engine
        if engine is not None and engine.alive and engine.runs < self.operation.recycle:
            return engine
        self.close()
        engine = (Child if self.operation.isolated else Inside)(self._setup())
        self._finalizer = weakref.finalize(self, engine.close)
        self._engine = engine
        return engine

    def _run(self, values: dict[str, Value], logging: bool = False) -> Trajectory:
        engine = self._opened()
        trajectory = engine.run(values, self.operation.timeout, logging)
        if engine.note:
            self._notes[engine.note] = None
        return trajectory

    def _logged(self, values: dict[str, Value]) -> str:
        """What the FMU logs in a run that failed silently: it is repeated with its log on."""
        try:
            self._run(values, logging=True)
        except RunFailed as failure:
            return failure.log
        return ""

    def _setup(self) -> Setup:
        return Setup(
            fmu=str(self.file),
            folder=tempfile.mkdtemp(prefix="aleator_fmu_"),
            interface=INTERFACES[self.course.kind],
            start_time=self.course.start_time,
            stop_time=self.course.stop_time,
            step=self.course.step,
            tolerance=self.course.tolerance,
            outputs=[*self._records],
            signals=self._signals,
            reset=self.operation.reuse == "reset",
        )

    def _constants(self, given: Mapping[str, Value]) -> dict[str, Value]:
        constants: dict[str, Value] = {}
        for name, value in given.items():
            what = f"the constant '{name}'"
            variable = settable(self.fmu.variable(name, what), what)
            try:
                constants[name] = start_value(variable, value, f"{name} = {value!r}")
            except RunFailed as failure:
                raise SimulatorError(f"constants: {failure.message}", "correct it") from None
        return constants
