"""A Functional Mock-up Unit (FMU) as a simulator."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aleator.core.types import Array
from aleator.errors import SimulatorError, nearest
from aleator.simulators.fmu.description import (
    Binding,
    Value,
    read_description,
    settable,
    start_value,
)
from aleator.simulators.fmu.engine import Engine
from aleator.simulators.fmu.reduction import (
    Crossing,
    Extreme,
    Final,
    Reduction,
    require_constant,
    require_times,
    sampled,
)
from aleator.simulators.fmu.session import FMURun, Trajectory
from aleator.simulators.fmu.settings import (
    Course,
    Operation,
    Signal,
    Span,
    assembled,
    checked_input,
)
from aleator.simulators.protocol import BLOCKS, Columns, Returned, RunFailed, one_by_one
from aleator.simulators.surroundings import printed

DEFAULT_COURSE = Course()
DEFAULT_OPERATION = Operation()


class FMUSimulator:
    """A Functional Mock-up Unit (FMI 2.0 or 3.0) as a `Simulator`; it is run through FMPy.

    Conditions and parameters are set before initialization, and the FMU is simulated as `course`
    says. `outcome` computes one number from the trajectory; a mapping has one such reduction for
    each response. A start or stop time may be the name of a condition. `variables` maps conditions
    and parameters to variables of the FMU; without an entry they set the variable of the same name.
    Conditions that are neither variables nor times are not used. `constants` are start values by
    variable, `inputs` are signals by variable. `version` is a text that the user changes when a
    file that the FMU reads has changed.

    With `series` one run makes a whole experiment: it ends at the largest value of the condition
    `time`, and the outcome at each of its values is computed from the trajectory up to then. Other
    conditions must not vary within an experiment.

    The FMU runs in a process of its own, which is started at the first run and ends by `close`, or
    with this process. The simulator can be pickled; each copy starts its own process.

    Raises SimulatorError, before anything runs, for a file that cannot be run here, and for
    variables that do not exist or cannot be set. Measured cost: 0.3 s to start the process, and 0.3
    ms for a run of 20 steps beyond what the FMU itself takes.
    """

    block = BLOCKS.single
    vectorized = False  # Then each slow run is stored as soon as it is made.

    def __init__(
        self,
        file: str | Path,
        outcome: Reduction | Mapping[str, Reduction],
        *,
        course: Course = DEFAULT_COURSE,
        variables: Mapping[str, str] | None = None,
        constants: Mapping[str, Value] | None = None,
        inputs: Mapping[str, Signal] | None = None,
        operation: Operation = DEFAULT_OPERATION,
        version: str = "",
        series: bool = False,
        time: str = "time",
    ) -> None:
        self.file = Path(file).resolve()
        self.name = Path(file).name
        self.fmu = read_description(self.file)
        self.series = series
        self.course = (_of_series(course, time) if series else course).of(self.fmu)
        self.outcomes = dict(outcome) if isinstance(outcome, Mapping) else {"": outcome}
        self.responses = tuple(name for name in self.outcomes if name)
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
        times = self.course.conditions
        taken = (*self.constants, *signals)
        self._binding = Binding(self.fmu, dict(variables or {}), taken, times)
        needed = [name for each in self.outcomes.values() for name in each.needs(self.fmu)]
        self._records = tuple(dict.fromkeys(needed))
        self._engine = Engine(self.file, self.course, self._records, self._signals, operation)

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that are times or variables of the FMU, in the order of `conditions`.

        Raises SimulatorError for a parameter that the FMU does not have, for a condition or
        parameter that cannot be set (a constant, or a variable that the FMU calculates), and if a
        start or stop time is the name of no condition.
        """
        times = self.course.conditions
        for name in times:
            if name not in conditions:
                raise SimulatorError(
                    f"the condition '{name}' that has a time of the simulation does not "
                    f"exist{nearest(name, conditions)}",
                    f"conditions: {', '.join(conditions) or 'none'}",
                )
        bound = self._binding.asks(conditions, parameters)
        return tuple(name for name in conditions if name in times or name in bound)

    def units(self, responses: Sequence[str], names: Sequence[str]) -> dict[str, str]:
        """The units of responses, conditions and parameters, as far as the FMU states them.

        An outcome has a unit if it is a time, or the value of a single variable.
        """
        times = dict.fromkeys((name for name in self.course.conditions if name in names), "s")
        found = {**times, **self._binding.units(names)}
        for response in responses:
            outcome = self.outcomes.get(response) or self.outcomes.get("")
            if isinstance(outcome, Crossing):
                found[response] = "s"
            elif isinstance(outcome, Final | Extreme) and outcome.signal in self.fmu.variables:
                found[response] = self.fmu.variables[outcome.signal].unit or ""
        return {name: unit for name, unit in found.items() if unit not in ("", "1")}

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times, one after the other: outcomes as an array (R,), or as a list.

        A run of a series returns an array (m,); a run with several responses returns a mapping from
        their names. Raises RunStopped for a failed run, and SimulatorError for a condition that
        must not vary and for an impossible time.
        """
        if self.series:
            require_constant(conditions, str(self.course.stop_time))
        require_times(self.course, conditions)
        return one_by_one(self._answer, conditions, parameters)

    def run_one(self, conditions: Mapping[str, Any], parameters: Mapping[str, float]) -> float:
        """The outcome of one run, as a number.

        Raises RunFailed, with the FMU's log messages, in these cases: an error inside the FMU, a
        trajectory that ends early, an outcome that does not exist or is not finite, a crash, and a
        timeout.
        """
        outcomes = self.sample(conditions, parameters)
        if outcomes.size > 1:
            raise SimulatorError(f"a run has {outcomes.size} outcomes", "take them by sample")
        return float(outcomes[0, 0])

    def sample(self, conditions: Mapping[str, Any], parameters: Mapping[str, float]) -> Array:
        """The outcomes (m, q) of one run: q responses at m times; m is one without `series`.

        An outcome that does not exist at a time is NaN. Raises RunFailed as `run_one` does, and
        SimulatorError for a time that is not a finite number or is before the start.
        """
        cells = {**conditions, **parameters}
        span = self.course.span(cells)
        trajectory = self._trajectory(cells, span)
        return sampled([*self.outcomes.values()], trajectory, span.times)

    def trajectory(
        self, conditions: Mapping[str, Any], parameters: Mapping[str, float]
    ) -> Trajectory:
        """The trajectory of one run: time and every variable that the outcomes need, (T,) each."""
        cells = {**conditions, **parameters}
        return self._trajectory(cells, self.course.span(cells))

    def fingerprint(self) -> str:
        """A hash of the FMU's bytes, every setting, the outcome's source, and `version`."""
        digest = self._digest()
        settings = (self.course, dict(self._binding.names), self.constants, self.version)
        digest.update(repr(settings).encode() + (b"series" if self.series else b""))
        for name, outcome in self.outcomes.items():
            digest.update(name.encode() + outcome.fingerprint().encode())
        if self._signals is not None:
            digest.update(repr(self._signals.dtype).encode() + self._signals.tobytes())
        return digest.hexdigest()

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user, for example that resets of the FMU were given up."""
        return self._engine.notes

    def bindings(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """Lines of text on how the FMU is run, and on its variables that are set or recorded.

        One more line names conditions that are not used. Raises SimulatorError as `asks` does.
        """
        asked = self.asks(conditions, parameters)
        kind = "co-simulation" if self.course.kind == "co_simulation" else "model exchange"
        recorded = (self.fmu.variables[name] for name in self._records)
        units = (f"{v.name} [{v.unit}]" if v.unit else v.name for v in recorded)
        served = ", one run for each experiment" if self.series else ""
        how = f"{kind} {self.course}{served}"
        lines = [f"FMI {self.fmu.version}, {how}, recorded: {', '.join(units)}"]
        bound = self._binding.asks(conditions, parameters)
        for what, names in (("conditions", bound), ("parameters", parameters)):
            lines.append(f"{what}: {self._binding.described(names) or 'none'}")
        if left := [name for name in conditions if name not in asked]:
            lines.append(f"no variables of the FMU, hence not passed: {', '.join(left)}")
        return tuple(lines)

    @property
    def description(self) -> str:
        """The name of the FMU and its outcomes, as one text."""
        parts = (
            f"{type(one).__name__}({getattr(one, 'signal', getattr(one, 'reference', ''))})"
            for one in self.outcomes.values()
        )
        return f"{self.name}: {', '.join(parts)}"

    def describe(self) -> str:
        """The variables that can be set or are outputs, with units, one in each line."""
        chosen = [v for v in self.fmu.variables.values() if v.settable or v.causality == "output"]
        return "\n".join(f"{v}  {v.description}".rstrip() for v in chosen)

    def close(self) -> None:
        """End the process of the FMU; a later run starts another one."""
        self._engine.close()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "sent": self._digest().hexdigest()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        sent = state.pop("sent")
        self.__dict__.update(state)
        if not self.file.is_file() or self._digest().hexdigest() != sent:
            raise SimulatorError(
                f"{self.file} is not the same for this worker as it was where the study was "
                "started, or not there",
                "let both have the same files, and start the study again",
            )

    def _digest(self) -> hashlib._Hash:
        return hashlib.sha256(self.file.read_bytes())

    def _answer(self, cells: Mapping[str, Any]) -> Any:
        """The outcome of one run: for each response a number, or an array (m,) for a series."""
        outcomes = self.sample(cells, {})
        several = self.series and np.ndim(cells[str(self.course.stop_time)]) > 0
        parts = [*outcomes.T] if several else outcomes[0].tolist()
        return dict(zip(self.responses, parts, strict=True)) if self.responses else parts[0]

    def _trajectory(self, cells: Mapping[str, Any], span: Span) -> Trajectory:
        job = FMURun(
            values={**self.constants, **self._binding.values(cells)},
            start_time=span.start,
            stop_time=span.stop,
            step=span.step,
            points=span.points,
        )
        try:
            return self._engine.run(job)
        except RunFailed as failure:
            said = f"{failure.message}\n{failure.log}"
            raise printed(said, self.operation.stop_on) or failure from None

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


def _of_series(course: Course, time: str) -> Course:
    """The course of a series: it ends at the last time of each experiment.

    Raises SimulatorError if a stop time is given.
    """
    if course.stop_time is not None:
        raise SimulatorError(
            "a stop time is given, but a series ends at the largest time of its experiment",
            "delete stop_time",
        )
    return replace(course, stop_time=time)
