"""Runs that cost less than remembering them: made here, neither remembered nor stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from aleator.errors import SimulatorError
from aleator.simulators.form import Form
from aleator.simulators.protocol import Columns, RunStopped, Simulator
from aleator.simulators.runs import Runs
from aleator.simulators.workers.batch import make
from aleator.types import Array


def straight(
    simulator: Simulator, conditions: Columns, parameters: Mapping[str, Array], form: Form
) -> Array:
    """Values (R, W) of runs under `conditions` (R,) with `parameters` (R,), as they were returned.

    A run that raises is NaN; a number that is not finite stays as it is. Raises SimulatorError for
    a wrong shape or type.

    >>> from aleator.simulators.function import FunctionSimulator
    >>> inverse = FunctionSimulator(lambda x: 1.0 / x, vectorized=True)
    >>> straight(inverse, {}, {"x": np.array([2.0, 0.0])}, Form()).tolist()
    [[0.5], [inf]]
    """
    count = len(next(iter(parameters.values())))
    size = simulator.block
    values = np.empty((count, form.width))
    for start in range(0, count, size):
        rows = slice(start, min(start + size, count))
        some = {name: column[rows] for name, column in conditions.items()}
        given = {name: column[rows] for name, column in parameters.items()}
        values[rows] = _called(simulator, some, given, form.some(rows))
    return values


def _called(simulator: Simulator, conditions: Columns, parameters: Columns, form: Form) -> Array:
    count = len(next(iter(parameters.values())))
    try:
        return form.shaped(simulator, simulator(conditions, parameters), count)
    except (SimulatorError, KeyboardInterrupt):
        raise
    except BaseException as error:
        if isinstance(error, RunStopped) and isinstance(error.__cause__, KeyboardInterrupt):
            raise error.__cause__ from None
        return _carefully(simulator, conditions, parameters, form)


def _carefully(simulator: Simulator, conditions: Columns, parameters: Columns, form: Form) -> Array:
    """The same where a run raises: that one is NaN."""
    x = np.column_stack([*parameters.values()])
    left = np.arange(len(x), dtype=np.intp)
    values = np.full((len(x), form.width), np.nan)
    anything = replace(form, observed=np.zeros(values.shape, dtype=np.bool_))
    while left.size:
        made = make(
            simulator,
            {name: column[left] for name, column in conditions.items()},
            [*parameters],
            anything.some(left),
            Runs.asked(left, x[left], form.width),
            np.inf,
        )
        if made.stopped:
            raise made.stopped
        values[left[: len(made)]] = made.outcome
        left = left[len(made) :]
    return values
