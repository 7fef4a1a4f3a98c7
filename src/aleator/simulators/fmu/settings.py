"""How an FMU is simulated: from when to when, in what steps, and how its instance is used."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from aleator.errors import SimulatorError
from aleator.simulators.fmu.description import DEFAULT_POINTS, Description, Kind


@dataclass(frozen=True)
class Course:
    """Times in s; None leaves it to the FMU's own default experiment.

    `step` is the communication step of a co-simulation, and the distance at which a model exchange
    is recorded (its solver, CVode, chooses its own steps for `tolerance`).

    >>> Course(stop_time=5.0, step=0.01)
    Course(start_time=None, stop_time=5.0, step=0.01, kind=None, tolerance=None)
    """

    start_time: float | None = None
    stop_time: float | None = None
    step: float | None = None
    kind: Kind | None = None
    tolerance: float | None = None

    def of(self, fmu: Description) -> Settled:
        """The course with the FMU's defaults. Raises SimulatorError for what it cannot do."""
        kind = self.kind or fmu.kinds[0]
        if kind not in fmu.kinds:
            raise SimulatorError(
                f"the FMU {fmu.file.name} does not offer {kind}, only {' and '.join(fmu.kinds)}",
                f'write kind = "{fmu.kinds[0]}", or export it for {kind}',
            )
        start = next(t for t in (self.start_time, fmu.start_time, 0.0) if t is not None)
        stop = self.stop_time if self.stop_time is not None else fmu.stop_time
        if stop is None:
            raise SimulatorError(
                f"the FMU {fmu.file.name} does not say how long it is to be simulated",
                "write stop_time = ... (s)",
            )
        if not stop > start:
            raise SimulatorError(
                f"the stop time {stop:g} s is not after the start time {start:g} s",
                "correct stop_time or start_time",
            )
        steps = (self.step, fmu.step, (stop - start) / DEFAULT_POINTS)
        step = next(step for step in steps if step is not None)
        tolerance = self.tolerance if self.tolerance is not None else fmu.tolerance
        settled = Settled(kind, start, stop, step, tolerance)
        settled.check(fmu)
        return settled


@dataclass(frozen=True)
class Settled:
    """A course in which nothing is left open but, in a co-simulation, the tolerance."""

    kind: Kind
    start_time: float
    stop_time: float
    step: float
    tolerance: float | None

    def check(self, fmu: Description) -> None:
        """Raise SimulatorError for a step or a tolerance that cannot be."""
        length = self.stop_time - self.start_time
        if not 0.0 < self.step <= length:
            raise SimulatorError(
                f"the step {self.step:g} s is not between 0 and the {length:g} s of a run",
                "correct step",
            )
        if self.tolerance is not None and not 0.0 < self.tolerance < 1.0:
            raise SimulatorError(
                f"the tolerance {self.tolerance:g} is not between 0 and 1", "correct tolerance"
            )
        steps = length / self.step
        whole = math.isclose(steps, round(steps), rel_tol=1e-9)
        if self.kind == "co_simulation" and fmu.fixed_step and not whole:
            raise SimulatorError(
                f"the FMU {fmu.file.name} takes steps of one length only, and {length:g} s are "
                f"{steps:g} steps of {self.step:g} s",
                f"choose step = {length / math.ceil(steps):g}, or another stop_time",
            )


@dataclass(frozen=True)
class Operation:
    """How instances are used.

    `reuse="reset"` resets one instance before every run, `"recreate"` makes a new one; after
    `recycle` runs the process is ended and started anew. `timeout` (s) kills a run that takes
    longer. `isolated=False` runs the FMU in this process, without a time limit.
    """

    reuse: Literal["reset", "recreate"] = "reset"
    recycle: int = 1000
    timeout: float | None = None
    isolated: bool = True

    def __post_init__(self) -> None:
        if self.recycle < 1:
            raise SimulatorError(f"recycle = {self.recycle} is less than one run", "write 1000")
        if self.timeout is not None and not self.timeout > 0.0:
            raise SimulatorError(f"timeout = {self.timeout:g} s is not positive", "correct it")
        if self.timeout is not None and not self.isolated:
            raise SimulatorError(
                "a time limit needs a process that can be killed",
                "leave out timeout, or isolated = false",
            )
