"""What a worker does with a batch of runs: call the simulator, and tell which failed and why."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from aleator.errors import SimulatorError
from aleator.simulators.failure import describe
from aleator.simulators.protocol import Columns, RunStopped, Simulator
from aleator.simulators.runs import NOT_FINITE, Failure, Runs
from aleator.types import Array

_ALONE = 0.02
"""Seconds of a run that is timed by itself; shorter ones are called and timed some at a time."""


def make(
    simulator: Simulator, conditions: Columns, parameters: Sequence[str], asked: Runs, budget: float
) -> Runs:
    """Make a batch of runs (the first of them), and begin nothing more once it took `budget` s.

    `conditions` are those of the runs asked for, columns (R,) by name; `parameters` names the
    columns of x. An exception is the failure of one run, found by halves where the simulator takes
    many at once. Raises SimulatorError for what no other parameters would mend: a wrong shape or
    type, and a simulator that raises for many runs but for none of them alone.

    >>> from aleator.simulators.function import FunctionSimulator
    >>> def inverse(x):
    ...     return 1.0 / x
    >>> asked = Runs.asked(np.zeros(3, int), np.array([[2.0], [0.0], [4.0]]))
    >>> made = make(FunctionSimulator(inverse), {}, ["x"], asked, 1.0)
    >>> made.outcome, [*made.failures]
    (array([0.5 ,  nan, 0.25]), [1])
    """
    columns = conditions, {name: asked.x[:, k].copy() for k, name in enumerate(parameters)}
    alone = getattr(simulator, "vectorized", True) is False
    size, began = 1 if alone else simulator.block, time.perf_counter()
    parts: list[Runs] = []
    done = 0
    while done < len(asked):
        rows = slice(done, min(done + size, len(asked)))
        part = _attempted(simulator, *_cut(columns, rows), asked.some(rows))
        parts.append(part)
        done += len(part)
        if part.stopped or time.perf_counter() - began >= budget:
            break
        if alone:
            each = float(part.seconds.mean())
            size = int(np.clip(_ALONE / max(each, 1e-9), 1, min(2 * size, simulator.block)))
    return Runs.joined(parts)


def make_packed(
    parcel: bytes, conditions: Columns, parameters: Sequence[str], asked: Runs, budget: float
) -> Runs:
    """`make` in another process: `parcel` is the simulator, pickled; unpacked once a process."""
    return make(_unpacked(parcel), conditions, parameters, asked, budget)


@lru_cache(maxsize=2)
def _unpacked(parcel: bytes) -> Simulator:
    import cloudpickle

    simulator: Simulator = cloudpickle.loads(parcel)
    return simulator


def _attempted(simulator: Simulator, conditions: Columns, parameters: Columns, asked: Runs) -> Runs:
    """One call; of one that raised what completed and the run at fault."""
    count, began = len(asked), time.perf_counter()
    try:
        outcome = _checked(simulator, simulator(conditions, parameters), count)
    except SimulatorError:
        raise
    except RunStopped as stop:
        return _before(stop, asked, time.perf_counter() - began)
    except KeyboardInterrupt as stop:
        return _made(asked, np.empty(0), 0.0, stopped=stop)
    except (Exception, SystemExit) as error:
        if count == 1:
            return _made(asked, np.empty(0), time.perf_counter() - began, error)
        return _halves(simulator, conditions, parameters, asked, error)
    return _made(asked, outcome, time.perf_counter() - began)


def _before(stop: RunStopped, asked: Runs, seconds: float) -> Runs:
    """What a simulator that runs one at a time did until it stopped."""
    cause = stop.__cause__
    if isinstance(cause, (Exception, SystemExit)):
        return _made(asked, stop.completed, seconds, cause)
    return _made(asked, stop.completed, seconds, stopped=cause or stop)


def _made(
    asked: Runs,
    outcome: Array,
    seconds: float,
    error: BaseException | None = None,
    stopped: BaseException | None = None,
) -> Runs:
    """The first of the runs, with their outcomes; the run after these raised `error`, if any."""
    failures = {
        row: Failure(f"it returned {outcome[row]:g}", kind=NOT_FINITE)
        for row in np.flatnonzero(~np.isfinite(outcome)).tolist()
    }
    if error is not None:
        failures[len(outcome)] = Failure.of(error)
        outcome = np.append(outcome, np.nan)
    count = len(outcome)
    return replace(
        asked.some(slice(count)),
        outcome=outcome,
        seconds=np.full(count, seconds / max(count, 1)),
        failures=failures,
        stopped=stopped,
    )


def _halves(
    simulator: Simulator,
    conditions: Columns,
    parameters: Columns,
    asked: Runs,
    error: BaseException,
) -> Runs:
    middle = len(asked) // 2
    parts: list[Runs] = []
    for rows in (slice(None, middle), slice(middle, None)):
        columns = _cut((conditions, parameters), rows)
        parts.append(_attempted(simulator, *columns, asked.some(rows)))
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


def _checked(simulator: Simulator, returned: object, count: int) -> Array:
    shape = np.shape(np.asanyarray(returned))
    if shape != (count,):
        kind = type(returned).__name__
        got = f"{kind} of shape {shape}" if shape else f"a single {kind}"
        raise SimulatorError(
            f"simulator '{simulator.name}' returned {'None' if returned is None else got} "
            f"for {count} runs, expected an array of shape ({count},)",
            "set vectorized = false if it computes one run at a time (as float() and the "
            "functions of math do); else let it return one number a run",
        )
    if np.asarray(returned).dtype.kind not in "fiu":
        raise SimulatorError(
            f"simulator '{simulator.name}' returned {np.asarray(returned).dtype} values",
            "let it return real numbers",
        )
    return np.asarray(returned, dtype=np.float64)
