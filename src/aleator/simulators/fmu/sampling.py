"""What a run is asked for: the outcomes at its times, as numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from aleator.errors import SimulatorError
from aleator.simulators.failure import RunFailed
from aleator.simulators.fmu.reduction import Reduction, Trajectory
from aleator.simulators.fmu.settings import Settled
from aleator.simulators.protocol import Columns
from aleator.types import Array


def sampled(reductions: Sequence[Reduction], trajectory: Trajectory, times: Array) -> Array:
    """Outcomes (m, q): each of q reductions, of what had happened until each of `times` (m,).

    One that does not exist yet at a time, as a crossing that comes later, is NaN there. Raises
    RunFailed if none is a finite number at any time.

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


def until(trajectory: Trajectory, time: float) -> Trajectory:
    """The trajectory until a time, where it has a sample there; else with one interpolated.

    >>> run = {"time": np.array([0.0, 1.0]), "h": np.array([4.0, 8.0]), "n": np.array([1, 2])}
    >>> {name: values.tolist() for name, values in until(run, 0.25).items()}
    {'time': [0.0, 0.25], 'h': [4.0, 5.0], 'n': [1, 1]}
    """
    instants = trajectory["time"]
    count = int(np.searchsorted(instants, time + 2e-9 * abs(time), side="right"))
    if count == len(instants):
        return trajectory
    past = {name: values[:count] for name, values in trajectory.items()}
    # FMPy takes times for equal that differ by less than a billionth.
    if math.isclose(instants[count - 1], time, rel_tol=2e-9):
        return past
    share = (time - instants[count - 1]) / (instants[count] - instants[count - 1])
    return {
        name: np.append(past[name], values[count - 1] + share * (values[count] - values[count - 1]))
        if values.dtype.kind == "f"
        else np.append(past[name], values[count - 1])
        for name, values in trajectory.items()
    }


def require_constant(conditions: Columns, time: str) -> None:
    """Raise SimulatorError for a condition other than the time that varies in an experiment."""
    for name, column in conditions.items():
        if name != time and any(np.ndim(cell) for cell in column.tolist()):
            raise SimulatorError(
                f"the condition '{name}' varies within an experiment, and an FMU has one start "
                "value of it in a run",
                "give it over time as an input (inputs), leave it out by naming the others in "
                "[experiments] conditions, or leave out series: each row is then a run of its own",
            )


def require_times(course: Settled, conditions: Columns) -> None:
    """Raise SimulatorError if the times of any run cannot be: no parameters would mend them."""
    names = course.conditions
    for cells in zip(*(conditions[name].tolist() for name in names), strict=True):
        course.span(dict(zip(names, cells, strict=True)))
