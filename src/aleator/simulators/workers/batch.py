"""What a worker does with a batch of runs: call the simulator, and tell which failed and why."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from aleator.errors import AleatorError, SimulatorError, SurroundingsError
from aleator.simulators.failure import RunFailed, describe
from aleator.simulators.form import Form, is_named
from aleator.simulators.protocol import Columns, Returned, RunStopped, Simulator
from aleator.simulators.runs import NOT_FINITE, Failure, Runs
from aleator.simulators.surroundings import cause
from aleator.simulators.workers.orphans import Orphaned
from aleator.types import Array

_ALONE = 0.02
"""Seconds of a run that is timed by itself; shorter ones are called and timed some at a time."""


def make(
    simulator: Simulator,
    conditions: Columns,
    parameters: Sequence[str],
    form: Form,
    asked: Runs,
    budget: float,
) -> Runs:
    """Make a batch of runs (the first of them), and begin nothing more once it took `budget` s.

    `conditions` are those of the runs asked for, columns (R,) by name; `parameters` names the
    columns of x; `form` is what the runs are to return. An exception is the failure of one run,
    found by halves where the simulator takes many at once. What the machine did to a run (see
    `surroundings`) is none: it ends the batch before that run, as Ctrl-C does, and is `stopped` of
    what is returned. Raises SimulatorError for what no other parameters would mend: a wrong shape
    or type, and a simulator that raises for many runs but for none of them alone.

    >>> from aleator.simulators.function import FunctionSimulator
    >>> def inverse(x):
    ...     return 1.0 / x
    >>> asked = Runs.asked(np.zeros(3, int), np.array([[2.0], [0.0], [4.0]]))
    >>> made = make(FunctionSimulator(inverse), {}, ["x"], Form(), asked, 1.0)
    >>> made.outcome.tolist(), [*made.failures]
    ([[0.5], [nan], [0.25]], [1])
    """
    columns = conditions, {name: asked.x[:, k].copy() for k, name in enumerate(parameters)}
    alone = getattr(simulator, "vectorized", True) is False
    size, began = 1 if alone else simulator.block, time.perf_counter()
    parts: list[Runs] = []
    done = 0
    while done < len(asked):
        rows = slice(done, min(done + size, len(asked)))
        part = _attempted(simulator, *_cut(columns, rows), form.some(rows), asked.some(rows))
        parts.append(part)
        done += len(part)
        if part.stopped or time.perf_counter() - began >= budget:
            break
        if alone:
            each = float(part.seconds.mean())
            size = int(np.clip(_ALONE / max(each, 1e-9), 1, min(2 * size, simulator.block)))
    return Runs.joined(parts)


def make_packed(
    parcel: bytes,
    conditions: Columns,
    parameters: Sequence[str],
    form: Form,
    asked: Runs,
    budget: float,
) -> Runs:
    """`make` in another process: `parcel` is the simulator, pickled; unpacked once a process.

    Ctrl-C is answered where the runs were asked for. A KeyboardInterrupt here is the simulator's
    own, and the failure of the run that raised it.
    """
    simulator: Any = _Deaf(_unpacked(parcel))
    return make(simulator, conditions, parameters, form, asked, budget)


class _Deaf:
    """A simulator that raises RunFailed for KeyboardInterrupt."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator

    def __getattr__(self, name: str) -> Any:
        return getattr(self._simulator, name)

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        try:
            return self._simulator(conditions, parameters)
        except KeyboardInterrupt as own:
            raise RunFailed("it raised KeyboardInterrupt") from own
        except RunStopped as stop:
            if isinstance(stop.__cause__, KeyboardInterrupt):
                raise stop from RunFailed("it raised KeyboardInterrupt")
            raise


@lru_cache(maxsize=2)
def _unpacked(parcel: bytes) -> Simulator:
    import cloudpickle

    simulator: Simulator = cloudpickle.loads(parcel)
    return simulator


def _attempted(
    simulator: Simulator, conditions: Columns, parameters: Columns, form: Form, asked: Runs
) -> Runs:
    """One call; of one that raised what completed and the run at fault."""
    count, began = len(asked), time.perf_counter()
    try:
        returned = simulator(conditions, parameters)
        values = form.shaped(simulator, returned, count)
    except Orphaned:
        raise
    except SurroundingsError as stop:
        return replace(asked.some(slice(0)), stopped=stop)
    except AleatorError:
        raise
    except RunStopped as stop:
        return _before(simulator, stop, form, asked, time.perf_counter() - began)
    except KeyboardInterrupt as stop:
        return replace(asked.some(slice(0)), stopped=stop)
    except BaseException as error:
        if count == 1:
            if prevented := cause(error):
                return replace(asked.some(slice(0)), stopped=prevented)
            return _failed(asked, time.perf_counter() - began, error)
        return _halves(simulator, conditions, parameters, form, asked, error)
    return _made(asked, values, form, time.perf_counter() - began, is_named(returned))


def _before(simulator: Simulator, stop: RunStopped, form: Form, asked: Runs, took: float) -> Runs:
    """What a simulator that runs one at a time did until it stopped."""
    done, error = len(stop.completed), stop.__cause__ or stop
    stopping = error if isinstance(error, KeyboardInterrupt) else cause(error)
    if isinstance(error, (AleatorError, Orphaned)) and not stopping:
        raise error
    form = form.some(slice(done))
    values = form.shaped(simulator, stop.completed, done)
    each = took / (done + 1)
    named = done > 0 and is_named(stop.completed)
    made = _made(asked.some(slice(done)), values, form, each * done, named)
    if stopping:
        return replace(made, stopped=stopping)
    return Runs.joined([made, _failed(asked.some(slice(done, done + 1)), each, error)])


def _made(asked: Runs, values: Array, form: Form, seconds: float, named: bool) -> Runs:
    """Runs that returned these values (R, W); one without a value that is wanted has failed."""
    missing = form.missing(values)
    failures = {}
    if np.any(missing):
        values = values.copy()
        for run in np.unique(np.nonzero(missing)[0]).tolist():
            column = int(np.argmax(missing[run]))
            fault = form.fault(run, column, values[run, column])
            failures[run] = Failure(fault, kind=NOT_FINITE)
            values[run] = np.nan
    each = np.full(len(values), seconds / max(len(values), 1))
    return replace(asked, outcome=values, seconds=each, failures=failures, named=named)


def _failed(asked: Runs, seconds: float, error: BaseException) -> Runs:
    """The one run asked for, which raised."""
    return replace(asked, seconds=np.array([seconds]), failures={0: Failure.of(error)})


def _halves(
    simulator: Simulator,
    conditions: Columns,
    parameters: Columns,
    form: Form,
    asked: Runs,
    error: BaseException,
) -> Runs:
    middle = len(asked) // 2
    parts: list[Runs] = []
    for rows in (slice(None, middle), slice(middle, None)):
        columns = _cut((conditions, parameters), rows)
        parts.append(_attempted(simulator, *columns, form.some(rows), asked.some(rows)))
        if parts[-1].stopped:
            break
    whole = Runs.joined(parts)
    if not whole.failures and not whole.stopped:
        raise SimulatorError(
            f"simulator '{simulator.name}' raised when called with {len(asked)} runs, "
            f"but not with fewer: {describe(error)}",
            "set vectorized = false, or make it take arrays of any length",
        )
    return whole


def _cut(columns: tuple[Columns, Columns], rows: slice) -> tuple[Columns, Columns]:
    first, second = ({name: c[rows] for name, c in part.items()} for part in columns)
    return first, second
