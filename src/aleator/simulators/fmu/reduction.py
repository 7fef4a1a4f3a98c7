"""How the outcome of a run is computed from its trajectory."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array
from aleator.errors import SimulatorError, setting
from aleator.simulators.derived import Expression, parse
from aleator.simulators.fmu.description import Description
from aleator.simulators.fmu.session import SETTINGS
from aleator.simulators.fmu.settings import ResolvedSettings
from aleator.simulators.function import FunctionSimulator, load_function
from aleator.simulators.protocol import Columns, RunFailed

Trajectory = Mapping[str, NDArray[Any]]


class Reduction(Protocol):
    """Computes one number, the outcome, from the trajectory of a run."""

    def needs(self, fmu: Description) -> tuple[str, ...]:
        """The variables that must be recorded. Raises SimulatorError if one cannot be."""

    def __call__(self, trajectory: Trajectory) -> float:
        """The outcome of a trajectory: "time" and the variables, (T,) each. Raises RunFailed."""

    def fingerprint(self) -> str:
        """A text that changes when the reduction changes."""


class _OfSignal:
    """Base of reductions that look at one variable, or at one expression of variables."""

    signal: str

    def needs(self, fmu: Description) -> tuple[str, ...]:
        """The variables in the expression. Raises SimulatorError unless all are numbers."""
        names = _expression(self.signal, fmu).names
        for name in names:
            if not fmu.variable(name, "the outcome").recordable:
                raise SimulatorError(
                    f"the outcome: {fmu.variables[name]} is not a number over time",
                    "take a variable of type Real, Integer or Boolean",
                )
        return names

    def fingerprint(self) -> str:
        """A text with all settings of the reduction."""
        return repr(self)

    def _values(self, trajectory: Trajectory) -> Array:
        known = [name for name in trajectory if name != "time"]
        values = parse(self.signal, known)(trajectory)
        return np.broadcast_to(values, trajectory["time"].shape)


def _expression(signal: str, fmu: Description) -> Expression:
    return parse(signal, list(fmu.variables))


@dataclass(frozen=True)
class Final(_OfSignal):
    """The last value of a variable or of an expression of variables.

    >>> Final("a - 2*b")({"time": np.arange(2.0), "a": np.array([0., 5.]), "b": np.ones(2)})
    3.0
    """

    signal: str

    def __call__(self, trajectory: Trajectory) -> float:
        """The value of the signal at the stop time."""
        return float(self._values(trajectory)[-1])


@dataclass(frozen=True)
class Extreme(_OfSignal):
    """The largest or the smallest value of a signal over all communication points.

    A larger value between two points is missed; this error is of the order of the step squared.

    >>> Extreme("a", largest=False)({"time": np.arange(3.0), "a": np.array([0., -5., 1.])})
    -5.0
    """

    signal: str
    largest: bool = True

    def __call__(self, trajectory: Trajectory) -> float:
        """The largest or the smallest value of the signal."""
        values = self._values(trajectory)
        return float(np.max(values) if self.largest else np.min(values))


@dataclass(frozen=True)
class Crossing(_OfSignal):
    """The first time at which a variable or an expression crosses a value.

    Between communication points the signal is interpolated by a straight line (`cubic=False`), or
    by the cubic through four points. The error of the cubic is of the fourth power of the step if
    the signal is smooth. A signal that begins exactly at the value has not crossed it yet.

    Raises RunFailed, with the range of the signal, if there is no crossing after the time `after`.

    >>> time = np.linspace(0.0, 2.0, 5)
    >>> Crossing("a", 1.0, "down")({"time": time, "a": 4.0 - time**3 - time}).__round__(3)
    1.213
    """

    signal: str
    value: float = 0.0
    direction: Literal["down", "up", "any"] = "any"
    after: float = -math.inf
    cubic: bool = True

    def __call__(self, trajectory: Trajectory) -> float:
        """The time in s of the first crossing."""
        time = np.asarray(trajectory["time"], dtype=np.float64)
        offset = self._values(trajectory) - self.value
        up = (offset[:-1] < 0.0) & (offset[1:] >= 0.0)
        down = (offset[:-1] > 0.0) & (offset[1:] <= 0.0)
        crosses = {"up": up, "down": down, "any": up | down}[self.direction]
        for k in np.flatnonzero(crosses & (time[1:] >= self.after)):
            instant = _root(time, offset, int(k), self.cubic)
            if instant >= self.after:
                return instant
        how = "" if self.direction == "any" else f" {self.direction}wards"
        raise RunFailed(
            f"'{self.signal}' does not cross {self.value:g}{how} by time {time[-1]:g} s: it goes "
            f"from {offset[0] + self.value:g} to {offset[-1] + self.value:g}, between "
            f"{np.min(offset) + self.value:g} and {np.max(offset) + self.value:g}"
        )


def _root(time: Array, offset: Array, k: int, cubic: bool) -> float:
    """The zero of the interpolated signal in [time[k], time[k + 1]], where its sign changes."""
    t0, t1, y0, y1 = time[k], time[k + 1], offset[k], offset[k + 1]
    four = slice(k - 1, k + 3)
    smooth = k >= 1 and k + 2 < len(time) and np.all(np.diff(time[four]) > 0.0)
    if not cubic or not smooth:
        return float(t0 - y0 * (t1 - t0) / (y1 - y0))
    # The cubic is in Newton's form, in units of the step. Bisection finds its zero in the step.
    h = t1 - t0
    x = (time[four] - t0) / h
    table = offset[four].copy()
    for order in range(1, 4):
        table[order:] = (table[order:] - table[order - 1 : -1]) / (x[order:] - x[:-order])
    low, high = 0.0, 1.0
    for _ in range(np.finfo(np.float64).nmant):
        middle = 0.5 * (low + high)
        value = table[3]
        for coefficient, node in zip(table[2::-1], x[2::-1], strict=True):
            value = coefficient + (middle - node) * value
        low, high = (middle, high) if (value > 0.0) == (y0 > 0.0) else (low, middle)
    return float(t0 + h * 0.5 * (low + high))


@dataclass(frozen=True)
class Hook:
    """A Python function of the user that computes the outcome from a dict of arrays (T,).

    The dict has "time" and the variables in `record`, or every output of the FMU. `reference` is
    "file.py:function" (relative to `folder`) or "package.module:function".

    >>> hook = Hook("numpy:ptp")
    """

    reference: str
    record: tuple[str, ...] = ()
    folder: str = "."

    def needs(self, fmu: Description) -> tuple[str, ...]:
        """The variables to record; the function is imported to check that this is possible."""
        self._function()
        for name in self.record:
            if not fmu.variable(name, "the outcome").recordable:
                raise SimulatorError(
                    f"the outcome: {fmu.variables[name]} is not a number over time",
                    "record variables of type Real, Integer or Boolean",
                )
        return self.record or fmu.outputs()

    def __call__(self, trajectory: Trajectory) -> float:
        """The number that the user's function returns. Raises RunFailed if that raises an error."""
        try:
            return float(self._function()(dict(trajectory)))
        except Exception as error:
            kind = type(error).__name__
            raise RunFailed(f"'{self.reference}' raised {kind}: {error}") from error

    def fingerprint(self) -> str:
        """A text with the reference and a hash of the function's source."""
        source = FunctionSimulator(self._function()).fingerprint()
        return f"{self.reference} {self.record} {source}"

    def _function(self) -> Callable[..., Any]:
        return _loaded(self.reference, self.folder)


@cache
def _loaded(reference: str, folder: str) -> Callable[..., Any]:
    return load_function(reference, folder)


def sampled(reductions: Sequence[Reduction], trajectory: Trajectory, times: Array) -> Array:
    """Outcomes (m, q): each of q reductions, applied to the trajectory up to each of `times` (m,).

    An outcome that does not exist yet at a time, such as a later crossing, is NaN there. Raises
    RunFailed if no outcome is a finite number at any time.

    >>> from aleator.simulators.fmu.reduction import Extreme, Final
    >>> run = {"time": np.array([0.0, 1.0, 2.0]), "h": np.array([1.0, 3.0, 2.0])}
    >>> sampled([Final("h"), Extreme("h")], run, np.array([2.0, 0.0])).tolist()
    [[2.0, 3.0], [1.0, 1.0]]
    """
    values = np.full((len(times), len(reductions)), np.nan)
    failures: list[RunFailed] = []
    for row in np.argsort(-times, kind="stable").tolist():
        past = until(trajectory, float(times[row]))
        for column, reduction in enumerate(reductions):
            try:
                values[row, column] = reduction(past)
            except RunFailed as failure:
                failures.append(failure)
    if not np.any(np.isfinite(values)):
        raise failures[0] if failures else RunFailed(f"the outcome is {values[-1, -1]:g}")
    return values


def until(trajectory: Trajectory, time: float, close: float = SETTINGS.close) -> Trajectory:
    """The trajectory up to a time, with an interpolated sample at that time if it has none.

    >>> run = {"time": np.array([0.0, 1.0]), "h": np.array([4.0, 8.0]), "n": np.array([1, 2])}
    >>> {name: values.tolist() for name, values in until(run, 0.25).items()}
    {'time': [0.0, 0.25], 'h': [4.0, 5.0], 'n': [1, 1]}
    """
    instants = trajectory["time"]
    count = int(np.searchsorted(instants, time + close * abs(time), side="right"))
    if count == len(instants):
        return trajectory
    past = {name: values[:count] for name, values in trajectory.items()}
    if math.isclose(instants[count - 1], time, rel_tol=close):
        return past
    share = (time - instants[count - 1]) / (instants[count] - instants[count - 1])
    return {
        name: np.append(past[name], values[count - 1] + share * (values[count] - values[count - 1]))
        if values.dtype.kind == "f"
        else np.append(past[name], values[count - 1])
        for name, values in trajectory.items()
    }


def require_constant(conditions: Columns, time: str) -> None:
    """Raise SimulatorError if a condition other than the time varies within an experiment."""
    for name, column in conditions.items():
        if name != time and any(np.ndim(cell) for cell in column.tolist()):
            raise SimulatorError(
                f"the condition '{name}' varies within an experiment, and an FMU has one start "
                "value of it in a run",
                "give it over time as an input (inputs), leave out series (each row is then a "
                "run of its own), or leave it out by naming the others: "
                + setting(
                    "[experiments] conditions", "Experiments.from_frame(..., conditions=[...])"
                ),
            )


def require_times(course: ResolvedSettings, conditions: Columns) -> None:
    """Raise SimulatorError if the start and stop times of any run are impossible."""
    names = course.conditions
    for cells in zip(*(conditions[name].tolist() for name in names), strict=True):
        course.span(dict(zip(names, cells, strict=True)))
