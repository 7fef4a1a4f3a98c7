"""What a worker does with a batch of runs: call the simulator, and tell which failed and why."""

from __future__ import annotations

import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import cloudpickle
import numpy as np
from numpy.typing import NDArray

from aleator.errors import SimulatorError
from aleator.simulators.failure import RunFailed
from aleator.simulators.function import RunStopped, Simulator, describe
from aleator.types import Array

Columns = Mapping[str, NDArray[Any]]

_ALONE = 0.02
"""Seconds of a run that is timed by itself; shorter ones are called and timed some at a time."""


@dataclass(frozen=True)
class Failure:
    """A run without an outcome: its position in the batch, what it raised, and its log if any."""

    position: int
    message: str
    log: str | None = None
    kind: str = ""

    @classmethod
    def of(cls, position: int, error: BaseException) -> Failure:
        """What an exception says.

        >>> Failure.of(3, RunFailed("it ended with exit code 3", "too hot"))
        Failure(position=3, message='it ended with exit code 3', log='too hot', kind='RunFailed')
        """
        if isinstance(error, RunFailed):
            return cls(position, error.message, error.log or None, "RunFailed")
        return cls(position, describe(error), None, type(error).__name__)


@dataclass(frozen=True, eq=False)
class Work:
    """The first k runs of a batch: `outcome` (k,), NaN for each of `failures`, `seconds` (k,).

    k is less than was asked for where the time was up, or where `stopped` (Ctrl-C) says why.
    """

    outcome: Array
    failures: tuple[Failure, ...]
    seconds: Array
    host: str = field(default_factory=platform.node)
    stopped: BaseException | None = None

    def __len__(self) -> int:
        return len(self.outcome)


def work(simulator: Simulator, conditions: Columns, parameters: Columns, budget: float) -> Work:
    """Run a batch, and begin nothing more once it took `budget` seconds.

    An exception is the failure of one run, found by halves where the simulator takes many at once.
    Raises SimulatorError for what no other parameters would mend: a wrong shape or type, and a
    simulator that raises for many runs but for none of them alone.

    >>> from aleator.simulators.function import FunctionSimulator
    >>> def inverse(x):
    ...     return 1.0 / x
    >>> done = work(FunctionSimulator(inverse), {}, {"x": np.array([2.0, 0.0, 4.0])}, 1.0)
    >>> done.outcome, [failure.position for failure in done.failures]
    (array([0.5 ,  nan, 0.25]), [1])
    """
    count = len(next(iter(parameters.values())))
    alone = getattr(simulator, "vectorized", True) is False
    size, began = 1 if alone else simulator.block, time.perf_counter()
    done: list[Work] = []
    k = 0
    while k < count:
        part = slice(k, min(k + size, count))
        piece = _attempted(simulator, _cut(conditions, part), _cut(parameters, part))
        done.append(piece)
        k += len(piece)
        if piece.stopped or time.perf_counter() - began >= budget:
            break
        if alone:
            each = float(piece.seconds.mean())
            size = int(np.clip(_ALONE / max(each, 1e-9), 1, min(2 * size, simulator.block)))
    return _joined(done)


def not_finite(outcome: float) -> str:
    """What is said of a run whose outcome is no finite number."""
    return f"it returned {outcome:g}"


def work_of_parcel(parcel: bytes, conditions: Columns, parameters: Columns, budget: float) -> Work:
    """`work` in another process: `parcel` is the simulator, pickled; unpacked once a process."""
    return work(_unpacked(parcel), conditions, parameters, budget)


@lru_cache(maxsize=2)
def _unpacked(parcel: bytes) -> Simulator:
    simulator: Simulator = cloudpickle.loads(parcel)
    return simulator


def _attempted(simulator: Simulator, conditions: Columns, parameters: Columns) -> Work:
    """One call; of one that raised what completed and the run at fault."""
    count, began = len(next(iter(parameters.values()))), time.perf_counter()
    try:
        outcome = _checked(simulator, simulator(conditions, parameters), count)
    except SimulatorError:
        raise
    except RunStopped as stop:
        return _before(stop, time.perf_counter() - began)
    except KeyboardInterrupt as stop:
        return Work(np.empty(0), (), np.empty(0), stopped=stop)
    except (Exception, SystemExit) as error:
        if count == 1:
            seconds = np.full(1, time.perf_counter() - began)
            return Work(np.full(1, np.nan), (Failure.of(0, error),), seconds)
        return _halves(simulator, conditions, parameters, error)
    return Work(outcome, (), np.full(count, (time.perf_counter() - began) / count))


def _before(stop: RunStopped, seconds: float) -> Work:
    """What a simulator that runs one at a time did until it stopped."""
    cause, k = stop.__cause__, len(stop.completed)
    if isinstance(cause, (Exception, SystemExit)):
        outcome, failures = np.append(stop.completed, np.nan), (Failure.of(k, cause),)
        return Work(outcome, failures, np.full(k + 1, seconds / (k + 1)))
    return Work(stop.completed, (), np.full(k, seconds / max(k, 1)), stopped=cause or stop)


def _halves(
    simulator: Simulator, conditions: Columns, parameters: Columns, error: BaseException
) -> Work:
    count = len(next(iter(parameters.values())))
    done: list[Work] = []
    for part in (slice(None, count // 2), slice(count // 2, None)):
        done.append(_attempted(simulator, _cut(conditions, part), _cut(parameters, part)))
        if done[-1].stopped:
            break
    whole = _joined(done)
    if not whole.failures and not whole.stopped:
        raise SimulatorError(
            f"simulator '{simulator.name}' raised when called with {count} runs, "
            f"but not with fewer: {describe(error)}",
            "set vectorized = false, or make it take arrays of any length",
        )
    return whole


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


def _cut(columns: Columns, part: slice) -> dict[str, NDArray[Any]]:
    return {name: column[part] for name, column in columns.items()}


def _joined(parts: list[Work]) -> Work:
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    return Work(
        np.concatenate([part.outcome for part in parts]),
        tuple(
            Failure(start + f.position, f.message, f.log, f.kind)
            for start, part in zip(starts, parts, strict=False)
            for f in part.failures
        ),
        np.concatenate([part.seconds for part in parts]),
        stopped=parts[-1].stopped,
    )
