"""How an FMU is simulated: times and steps, inputs over time, and the use of its instance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array
from aleator.errors import SimulatorError, nearest
from aleator.simulators.fmu.description import (
    INTEGERS,
    NUMBERS,
    REALS,
    Description,
    Kind,
    Variable,
)
from aleator.simulators.protocol import require_file
from aleator.simulators.surroundings import STOP_ON, require_pattern

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class TimeSettings:
    """Settings of how the times of a run are chosen."""

    steps: int = 500
    """The number of steps of a run if neither the user nor the FMU states a step. Chosen by
    judgement, as in other tools."""
    close: float = 1e-9
    """The relative difference below which FMPy takes two times as equal."""
    shortest: float = 1e-3
    """The duration in s of a run of which only the start is needed, because an FMU needs a later
    stop time. Chosen by judgement."""


TIMES = TimeSettings()


@dataclass(frozen=True)
class Course:
    """The times of a run in s: numbers, or names of conditions; None is the default of the FMU.

    `step` is the communication step of a co-simulation. In a model exchange it is the distance of
    recorded points; there the solver CVode chooses its own steps for the `tolerance`.

    >>> Course(stop_time="duration", step=0.01)
    Course(start_time=None, stop_time='duration', step=0.01, kind=None, tolerance=None)
    """

    start_time: float | str | None = None
    stop_time: float | str | None = None
    step: float | None = None
    kind: Kind | None = None
    tolerance: float | None = None

    def of(self, fmu: Description) -> ResolvedSettings:
        """The course completed by the FMU's defaults.

        Raises SimulatorError for settings that the FMU does not support.
        """
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
        step = self.step if self.step is not None else fmu.step
        if not isinstance(start, str) and not isinstance(stop, str):
            if not stop > start:
                raise SimulatorError(
                    f"the stop time {stop:g} s is not after the start time {start:g} s",
                    "correct stop_time or start_time",
                )
            step = step if step is not None else (stop - start) / TIMES.steps
        tolerance = self.tolerance if self.tolerance is not None else fmu.tolerance
        inside = kind == "co_simulation"
        whole, internal = inside and fmu.fixed_step, fmu.internal_step if inside else None
        settled = ResolvedSettings(kind, start, stop, step, tolerance, whole, internal)
        settled.check(fmu)
        return settled


@dataclass(frozen=True)
class ResolvedSettings:
    """A course with all defaults; only the tolerance of a co-simulation may still be None.

    A time that is a text is the name of a condition. A condition that is the stop time may have
    several values in a run; outcomes are then taken at each of them. Without a step, each run has
    500 steps. `whole` says that all steps must have one length. `internal` is the step of the
    solver inside the FMU, if stated.
    """

    kind: Kind
    start_time: float | str
    stop_time: float | str
    step: float | None
    tolerance: float | None
    whole: bool = field(default=False, repr=False)
    internal: float | None = field(default=None, repr=False)

    @property
    def conditions(self) -> tuple[str, ...]:
        """The names of the conditions that are the start or stop time."""
        return tuple(t for t in (self.start_time, self.stop_time) if isinstance(t, str))

    def __str__(self) -> str:
        """The times and the step of a run, in words.

        >>> print(ResolvedSettings("co_simulation", 0.0, "duration", 0.1, None))
        from 0 to 'duration' s in steps of 0.1 s
        """
        start, stop = (
            repr(time) if isinstance(time, str) else f"{time:g}"
            for time in (self.start_time, self.stop_time)
        )
        step = f"{TIMES.steps} steps" if self.step is None else f"steps of {self.step:g} s"
        return f"from {start} to {stop} s in {step}"

    def check(self, fmu: Description) -> None:
        """Raise SimulatorError for an invalid step or tolerance."""
        if self.step is not None and not 0.0 < self.step < math.inf:
            raise SimulatorError(f"the step {self.step:g} s is not positive", "correct step")
        if self.tolerance is not None and not 0.0 < self.tolerance < 1.0:
            raise SimulatorError(
                f"the tolerance {self.tolerance:g} is not between 0 and 1", "correct tolerance"
            )
        if isinstance(self.start_time, str) or isinstance(self.stop_time, str):
            return
        assert self.step is not None
        length = self.stop_time - self.start_time
        if self.step > length:
            raise SimulatorError(
                f"the step {self.step:g} s is not between 0 and the {length:g} s of a run",
                "correct step",
            )
        steps = length / self.step
        if self.whole and not math.isclose(steps, round(steps), rel_tol=TIMES.close):
            raise SimulatorError(
                f"the FMU {fmu.file.name} takes steps of one length only, and {length:g} s are "
                f"{steps:g} steps of {self.step:g} s",
                f"choose step = {length / math.ceil(steps):g}, or another stop_time",
            )

    def span(self, cells: Mapping[str, Any]) -> Span:
        """The times of a run with these conditions.

        Raises SimulatorError for a time that is not a finite number, or is before the start.

        >>> settings = ResolvedSettings("co_simulation", 0.0, "time", 0.5, None)
        >>> span = settings.span({"time": [1.7, 0.5, 0.7]})
        >>> span.start, span.stop, span.step, span.points.tolist()
        (0.0, 1.7, 0.5, [0.5, 0.7, 1.0, 1.5, 1.7])
        """
        (start,) = _instants(self.start_time, cells).tolist()
        times = _instants(self.stop_time, cells)
        if np.min(times) < start:
            where = f" ('{self.stop_time}')" if isinstance(self.stop_time, str) else ""
            raise SimulatorError(
                f"the time {np.min(times):g} s{where} is before the start at {start:g} s",
                "correct the cell of the table, or start_time",
            )
        stop = float(np.max(times))
        if stop == start:
            stop += self.step or TIMES.shortest
        step = self.step or (stop - start) / TIMES.steps
        if self.whole:
            return Span(start, _whole_steps(start, stop, step), step, times)
        placed = times
        if self.internal is not None and isinstance(self.stop_time, str):
            placed = _neighbours(start, self.internal, times)
            stop = max(stop, float(np.max(placed)))
        return Span(start, stop, step, times, _points(start, stop, step, placed))


@dataclass(frozen=True, eq=False)
class Span:
    """A run from `start` to `stop` (s) whose outcomes are taken at each of `times` (m,).

    Communication points are `step` apart. If these do not include all `times`, the communication
    points are `points` (P,) instead, in increasing order, without the start.
    """

    start: float
    stop: float
    step: float
    times: Array
    points: Array = field(default_factory=lambda: np.empty(0))


def _points(start: float, stop: float, step: float, times: Array) -> Array:
    """Communication points: every step, all times, and the end; empty if equal steps suffice."""
    regular = start + step * np.round((times - start) / step)
    between = times[~np.isclose(regular, times, rtol=TIMES.close, atol=0.0)]
    if np.all(between == stop):
        return np.empty(0)
    steps = start + step * np.arange(1, math.ceil((stop - start) / step))
    points = np.unique(np.concatenate([between, steps, [stop]]))
    apart = np.append(~np.isclose(points[1:], points[:-1], rtol=TIMES.close, atol=0.0), True)
    return points[apart & (points > start)]


def _neighbours(start: float, step: float, times: Array) -> Array:
    """The begin and end times (2 m,) of the solver steps that contain `times` (m,).

    Between them an FMU may return the values of the last internal step, an error of first order.
    """
    steps = (times - start) / step
    near = np.where(np.isclose(steps, np.round(steps), rtol=TIMES.close), np.round(steps), steps)
    return start + step * np.concatenate([np.floor(near), np.ceil(near)])


def _whole_steps(start: float, stop: float, step: float) -> float:
    """The end of the last whole step that is needed to reach `stop`."""
    steps = (stop - start) / step
    if math.isclose(steps, round(steps), rel_tol=TIMES.close):
        return stop
    return start + step * math.ceil(steps)


def _instants(time: float | str, cells: Mapping[str, Any]) -> Array:
    """The times (m,) of a run, from a number or from the condition of this name.

    Raises SimulatorError for a time that is not a finite number.
    """
    cell = cells[time] if isinstance(time, str) else time
    try:
        times = np.atleast_1d(np.asarray(cell, dtype=np.float64))
    except (TypeError, ValueError):
        times = np.array([np.nan])
    if not np.all(np.isfinite(times)):
        cells_read = ", ".join(map(str, np.ravel(cell).tolist()))
        raise SimulatorError(
            f"a time ('{time}') is not a finite number: {cells_read}",
            "correct the cells of the table",
        )
    return times


@dataclass(frozen=True)
class Operation:
    """Settings of how instances of an FMU are used.

    `reuse="reset"` resets one instance before every run; `"recreate"` makes a new one for each.
    After `recycle` runs the process is ended and started anew. A run that takes longer than
    `timeout` (s) is killed. `isolated=False` runs the FMU in this process, without a time limit.
    `stop_on` is a regular expression for messages of the machine: a failed run that logged it does
    not count as made (see `surroundings`; "": none).
    """

    reuse: Literal["reset", "recreate"] = "reset"
    recycle: int = 1000
    timeout: float | None = None
    isolated: bool = True
    stop_on: str = STOP_ON

    def __post_init__(self) -> None:
        require_pattern(self.stop_on)
        if self.recycle < 1:
            raise SimulatorError(f"recycle = {self.recycle} is less than one run", "write 1000")
        if self.timeout is not None and not self.timeout > 0.0:
            raise SimulatorError(f"timeout = {self.timeout:g} s is not positive", "correct it")
        if self.timeout is not None and not self.isolated:
            raise SimulatorError(
                "a time limit needs a process that can be killed",
                "leave out timeout, or isolated = false",
            )


TIME = "time"


@dataclass(frozen=True, eq=False)
class Signal:
    """An input over time: `time` (T,) in s, not decreasing, and `values` (T,).

    A time that appears twice is a jump. Real inputs are interpolated linearly; others keep the
    value of the last time. Before the first and after the last time the input is constant.
    """

    time: Array
    values: Array


def read_signal(reference: str, folder: Path, variable: str) -> Signal:
    """The signal in a CSV file: "file.csv:column", or "file.csv" for the variable's own column.

    The file needs a column `time`. Raises SimulatorError for a file that is not such a table.
    """
    name, colon, column = reference.rpartition(":")
    # The path "C:\\drive.csv" has a colon, but names no column.
    if not colon or column.lower().endswith(".csv"):
        name, column = reference, variable
    file = folder / name
    table = _table(file)
    columns = [*map(str, table.columns)]
    for required in (TIME, column):
        if required not in columns:
            raise SimulatorError(
                f"{file}: there is no column '{required}'{nearest(required, columns)}",
                f"an input needs a column '{TIME}' and its own; there are {', '.join(columns)}",
            )
    time, values = _numbers(table, TIME, file), _numbers(table, column, file)
    if len(time) == 0 or np.any(np.diff(time) < 0.0):
        raise SimulatorError(
            f"{file}: the column '{TIME}' is empty or decreases",
            "sort the rows by time; a time that comes twice is a jump",
        )
    return Signal(time, values)


def columns_of(file: Path, fmu: Description) -> list[str]:
    """The columns of a CSV file that are inputs of the FMU. Raises SimulatorError if none is."""
    columns = [str(column) for column in _table(file).columns]
    found = [
        name
        for name in columns
        if name in fmu.variables and fmu.variables[name].causality == "input"
    ]
    if not found:
        inputs = [v.name for v in fmu.variables.values() if v.causality == "input"]
        raise SimulatorError(
            f"{file}: no column has the name of an input of the FMU",
            f"its inputs are {', '.join(inputs) or 'none'}; the columns are {', '.join(columns)}",
        )
    return found


def checked_input(variable: Variable) -> Variable:
    """The given variable. Raises SimulatorError if it cannot be an input over time."""
    if variable.causality != "input" or variable.type not in NUMBERS or not variable.scalar:
        raise SimulatorError(
            f"the FMU's variable {variable} cannot be given over time",
            "name a variable with causality input that is a number; give others one value",
        )
    return variable


def assembled(signals: Mapping[str, Signal], fmu: Description) -> NDArray[Any] | None:
    """All signals at common times, as the structured array (T,) of FMPy; None if there is none."""
    if not signals:
        return None
    time = _union([signal.time for signal in signals.values()])
    table = np.empty(
        len(time), dtype=[(TIME, np.float64), *((name, _dtype(fmu, name)) for name in signals)]
    )
    table[TIME] = time
    for name, signal in signals.items():
        table[name] = _resampled(signal, time, linear=fmu.variables[name].type in REALS)
    return table


def _dtype(fmu: Description, name: str) -> type:
    kind = fmu.variables[name].type
    if kind == "Boolean":
        return np.bool_
    return np.int64 if kind in INTEGERS or kind == "Enumeration" else np.float64


def _union(times: list[Array]) -> Array:
    """All times of the signals in order; a time at which any signal jumps appears twice."""
    every = np.unique(np.concatenate(times))
    twice = {t for time in times for t in time[1:][np.diff(time) == 0.0].tolist()}
    return np.repeat(every, [2 if t in twice else 1 for t in every.tolist()])


def _resampled(signal: Signal, time: Array, linear: bool) -> Array:
    """Values at `time`; of two equal times the first is before a jump and the second after it."""
    second = np.concatenate([[False], np.diff(time) == 0.0])
    before = np.clip(np.searchsorted(signal.time, time, side="left"), 0, len(signal.time) - 1)
    after = np.clip(np.searchsorted(signal.time, time, side="right") - 1, 0, None)
    exact = signal.time[before] == time
    between = np.interp(time, signal.time, signal.values) if linear else signal.values[after]
    first = np.where(exact, signal.values[before], between)
    return np.where(second & exact, signal.values[after], first)


def _table(file: Path) -> pd.DataFrame:
    import pandas as pd

    remedy = 'write "file.csv:column", relative to the study file'
    require_file(file, f"the file of an input, {file},", "*.csv", remedy)
    try:
        return pd.read_csv(file, skipinitialspace=True)
    except (ValueError, OSError) as error:
        raise SimulatorError(
            f"{file} cannot be read as a CSV: {' '.join(str(error).split())}",
            f"write a header and columns with commas, one of them '{TIME}'",
        ) from error


def _numbers(table: pd.DataFrame, column: str, file: Path) -> Array:
    import pandas as pd

    values = pd.to_numeric(table[column], errors="coerce").to_numpy(dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise SimulatorError(
            f"{file}: line {bad[0] + 2}, column '{column}' is not a finite number",
            "correct the cell",
        )
    return values
