"""How runs are made in batches, in this process or by the workers of an executor."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from aleator.core.types import Flags
from aleator.errors import AleatorError, SimulatorError, SurroundingsError
from aleator.simulators.protocol import (
    Columns,
    Returned,
    RunFailed,
    RunStopped,
    Simulator,
    WorkerLost,
    describe,
)
from aleator.simulators.runs import NOT_FINITE, Failure, Runs
from aleator.simulators.surroundings import cause
from aleator.simulators.units import Bound, Form, is_named


@dataclass(frozen=True)
class Batching:
    """Settings of how runs are divided into batches, and of how many batches are submitted."""

    here: float = 0.02
    """Seconds of work in this process after which completed runs are stored; an interruption loses
    no more. A run that takes longer is a batch of its own. Chosen by judgement."""
    workers: float = 0.5
    """Seconds of work in a worker's batch. With Dask a batch costs an additional 11 to 14 ms
    (measured once: docs/evidence.md, "Cost of workers")."""
    most_here: int = 8192
    """The most runs of a batch in this process. It limits memory, and is chosen by judgement."""
    most: int = 65_536
    """The most runs of a worker's batch. It limits memory, and is chosen by judgement."""
    waiting: int = 2
    """Batches submitted for each worker: one is running, the others wait."""
    listening: float = 0.2
    """Seconds between two checks whether the user pressed Ctrl-C. Chosen by judgement."""


BATCHING = Batching()
# The least duration of a run in s. It is used so that no division by zero occurs.
_INSTANT = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, eq=False)
class Batch:
    """R runs that are to be made, with all that a worker needs besides the simulator.

    `conditions` has an array (R,) for each condition, by name. `parameters` are the names of the
    columns of x. `form` says which values the runs return.
    """

    conditions: Columns
    parameters: Sequence[str]
    form: Form
    runs: Runs

    @classmethod
    def of(cls, bound: Bound, runs: Runs) -> Batch:
        """A batch of these runs, with the conditions of each run."""
        form = bound.form.some(runs.case)
        return cls(bound.cases.at(runs.case), bound.parameters, form, runs)

    def __len__(self) -> int:
        return len(self.runs)

    def some(self, rows: slice) -> Batch:
        """A batch of some of the runs."""
        conditions = {name: column[rows] for name, column in self.conditions.items()}
        return Batch(conditions, self.parameters, self.form.some(rows), self.runs.some(rows))

    def stopped(self, by: BaseException) -> Runs:
        """An empty set of runs, because the exception `by` ended the batch before its first run."""
        return replace(self.runs.some(slice(0)), stopped=by)

    def failed(self, seconds: float, error: BaseException) -> Runs:
        """The only run of this batch, as a failed run that raised `error`."""
        return replace(self.runs, seconds=np.array([seconds]), failures={0: Failure.of(error)})

    def made(self, simulator: Simulator, returned: Any, seconds: float) -> Runs:
        """The runs with the values that the simulator returned.

        A run without a measured value has failed. Raises SimulatorError for a returned value of a
        wrong shape or type.
        """
        values = self.form.shaped(simulator, returned, len(self))
        each = np.full(len(values), seconds / max(len(values), 1))
        named = len(self) > 0 and is_named(returned)
        made = replace(self.runs, outcome=values, seconds=each, named=named)
        return without_outcome(made, self.form, self.form.missing(values))


def without_outcome(
    runs: Runs, form: Form, lost: Flags, why: Callable[[int, float], str] = lambda *_: ""
) -> Runs:
    """The runs, of which each that lacks a measured value becomes a failure.

    `lost` (R, W) marks the lacking values. The function `why`, of a column and its value, adds a
    reason to the message.
    """
    if not np.any(lost):
        return runs
    outcome, failures = runs.outcome.copy(), dict(runs.failures)
    for run in np.unique(np.nonzero(lost)[0]).tolist():
        column = int(np.argmax(lost[run]))
        value = runs.outcome[run, column]
        fault = form.fault(run, column, value) + why(column, value)
        failures[run] = Failure(fault, kind=NOT_FINITE)
        outcome[run] = np.nan
    return replace(runs, outcome=outcome, failures=failures)


def make(simulator: Simulator, batch: Batch, budget: float, timed: float = BATCHING.here) -> Runs:
    """Make the runs of a batch; no run begins after `budget` seconds.

    Several runs that together take less than `timed` seconds are made by one call. An exception is
    the failure of one run; if the simulator takes many runs at once, that run is found by
    bisection. A fault of the machine (see `surroundings`) or Ctrl-C is no failure: it ends the
    batch before that run, and becomes `stopped` of the result. Raises SimulatorError for errors
    that do not depend on the parameters: a wrong shape or type, and a simulator that raises for
    many runs but for none of them alone.

    >>> from aleator.simulators.function import FunctionSimulator
    >>> def inverse(x):
    ...     return 1.0 / x
    >>> runs = Runs.planned(np.zeros(3, int), np.array([[2.0], [0.0], [4.0]]))
    >>> made = make(FunctionSimulator(inverse), Batch({}, ["x"], Form(), runs), 1.0)
    >>> made.outcome.tolist(), [*made.failures]
    ([[0.5], [nan], [0.25]], [1])
    """
    alone = not getattr(simulator, "vectorized", True)
    size, began = 1 if alone else simulator.block, time.perf_counter()
    parts: list[Runs] = []
    done = 0
    while done < len(batch):
        part = _attempted(simulator, batch.some(slice(done, done + size)))
        parts.append(part)
        done += len(part)
        if part.stopped or time.perf_counter() - began >= budget:
            break
        if alone:
            each = float(part.seconds.mean())
            size = int(np.clip(timed / max(each, _INSTANT), 1, min(2 * size, simulator.block)))
    return Runs.joined(parts)


def make_packed(parcel: bytes, batch: Batch, budget: float) -> Runs:
    """Make runs in a worker process; `parcel` is the pickled simulator, unpacked once a process.

    Ctrl-C is handled by the process that submitted the batch. So a KeyboardInterrupt in a worker
    was raised by the simulator, and is the failure of that run.
    """
    simulator: Any = _Uninterrupted(_unpacked(parcel))
    return make(simulator, batch, budget)


class _Uninterrupted:
    """A simulator that raises RunFailed in place of KeyboardInterrupt."""

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


def _attempted(simulator: Simulator, batch: Batch) -> Runs:
    """The runs of one call; if it raised, the runs completed before it and the failed one."""
    began = time.perf_counter()
    columns = batch.runs.x.T.copy()
    try:
        parameters = dict(zip(batch.parameters, columns, strict=True))
        returned = simulator(batch.conditions, parameters)
        return batch.made(simulator, returned, time.perf_counter() - began)
    except (SurroundingsError, KeyboardInterrupt) as stop:
        return batch.stopped(stop)
    except AleatorError:
        raise
    except RunStopped as stop:
        return _before(simulator, stop, batch, time.perf_counter() - began)
    except BaseException as error:
        if len(batch) > 1:
            return _halves(simulator, batch, error)
        if prevented := cause(error):
            return batch.stopped(prevented)
        return batch.failed(time.perf_counter() - began, error)


def _before(simulator: Simulator, stop: RunStopped, batch: Batch, took: float) -> Runs:
    """The runs of a simulator that makes one at a time, up to the run that raised an exception."""
    done, error = len(stop.completed), stop.__cause__ or stop
    stopping = error if isinstance(error, KeyboardInterrupt) else cause(error)
    if isinstance(error, AleatorError) and not stopping:
        raise error
    each = took / (done + 1)
    made = batch.some(slice(done)).made(simulator, stop.completed, each * done)
    if stopping:
        return replace(made, stopped=stopping)
    return Runs.joined([made, batch.some(slice(done, done + 1)).failed(each, error)])


def _halves(simulator: Simulator, batch: Batch, error: BaseException) -> Runs:
    middle = len(batch) // 2
    parts: list[Runs] = []
    for rows in (slice(None, middle), slice(middle, None)):
        parts.append(_attempted(simulator, batch.some(rows)))
        if parts[-1].stopped:
            break
    whole = Runs.joined(parts)
    if not whole.failures and not whole.stopped:
        raise SimulatorError(
            f"simulator '{simulator.name}' raised when called with {len(batch)} runs, "
            f"but not with fewer: {describe(error)}",
            "leave out vectorized, or make it take arrays of any length",
        )
    return whole


def made_here(bound: Bound, runs: Runs, batching: Batching = BATCHING) -> Iterator[Runs]:
    """Make runs in this process, and yield them in order, a batch at a time.

    >>> import numpy as np
    >>> from aleator.simulators.function import FunctionSimulator
    >>> half = FunctionSimulator(lambda x: x / 2, vectorized=True)
    >>> runs = Runs.planned(np.zeros(2, int), np.array([[1.0], [4.0]]))
    >>> from aleator.simulators.units import Cases
    >>> bound = Bound(half, Cases.of({}, 1), ("x",))
    >>> [made.outcome.tolist() for made in made_here(bound, runs)]
    [[[0.5], [2.0]]]
    """
    most, done = max(bound.simulator.block, batching.most_here), 0
    while done < len(runs):
        batch = Batch.of(bound, runs.some(slice(done, done + most)))
        made = make(bound.simulator, batch, batching.here)
        yield made
        if made.stopped:
            raise made.stopped
        done += len(made)


def slots(executor: Executor) -> int:
    """The number of batches that an executor makes at once, as far as it states that.

    It is the number of processors of this machine if it states nothing.

    >>> from concurrent.futures import ThreadPoolExecutor
    >>> slots(ThreadPoolExecutor(3))
    3
    """
    for name in ("slots", "num_workers", "_max_workers"):
        number = getattr(executor, name, None)
        if isinstance(number, int) and number > 0:
            return number
    return os.cpu_count() or 1


class Dispatcher:
    """Lets the workers of an executor make runs in batches.

    `make` yields runs as batches complete, in any order. If a worker dies, its batch is halved and
    repeated until the run at fault is found, which then counts as a failed run. These halves run
    one at a time, unless the executor reports which batch killed the worker (WorkerLost).

    After Ctrl-C no more batches are submitted; the running ones are waited for and yielded, and
    then KeyboardInterrupt is raised. A second Ctrl-C raises it at once. An error that stops one
    batch (see the function `make`) stops the others in the same way. `rest` yields the running
    batches and cancels the others.

    Raises SurroundingsError for workers that end before they run anything, and SimulatorError for a
    simulator that cannot be sent to another process or unpacked there.
    """

    def __init__(self, bound: Bound, executor: Executor, batching: Batching = BATCHING) -> None:
        self._bound, self._simulator = bound, bound.simulator
        self._executor, self._batching = executor, batching
        self._parcel = _packed(bound.simulator)
        self._running: dict[Future[Runs], Runs] = {}
        self._waiting: deque[Runs] = deque()
        self._suspect: list[Runs] = []
        self._stopped: BaseException | None = None
        self._ending: Callable[[], bool] = lambda: False
        self._each = 0.0
        self._most = batching.most

    def make(self, runs: Runs, stopping: Callable[[int], None]) -> Iterator[Runs]:
        """Yield runs as made; after Ctrl-C, call `stopping` with the number of running batches."""
        self._waiting = deque([runs] if len(runs) else [])
        with interruptions_noted() as interrupted:
            self._ending = interrupted
            while self._waiting or self._running or self._suspect:
                while self._waiting and not self._suspect and self._has_room():
                    self._submit(self._next())
                if self._suspect and not self._running:
                    self._submit(self._suspect.pop())
                yield from self._completed()
                if interrupted():
                    stopping(len(self._running))
                    yield from self.rest()
                    raise KeyboardInterrupt
                if self._stopped:
                    yield from self.rest()
                    raise self._stopped

    def rest(self) -> Iterator[Runs]:
        """Yield the running batches as they complete; batches that have not begun are cancelled."""
        self._waiting.clear()
        self._suspect.clear()
        self._running = {f: runs for f, runs in self._running.items() if not f.cancel()}
        while self._running:
            yield from self._completed()
            self._waiting.clear()
            self._suspect.clear()

    def _has_room(self) -> bool:
        return len(self._running) < self._batching.waiting * slots(self._executor)

    def _next(self) -> Runs:
        """The next batch: half a second of work, or less near the end.

        Smaller batches let all workers end together. A simulator that takes arrays gets whole
        blocks: the last digits of its outcomes may depend on the length of the arrays, and must not
        depend on how long runs take.
        """
        runs, block = self._waiting.popleft(), self._simulator.block
        left = len(runs) + sum(map(len, self._waiting))
        share = left / (self._batching.waiting * slots(self._executor))
        size = max(1.0, min(self._batching.workers / self._each, share)) if self._each else 1
        size = min(int(size), self._most)
        if getattr(self._simulator, "vectorized", False):
            size = max(size // block, 1) * block
        if len(runs) > size:
            self._waiting.appendleft(runs.some(slice(size, None)))
        return runs.some(slice(size))

    def _submit(self, runs: Runs) -> None:
        batch, limit = Batch.of(self._bound, runs), 2.0 * self._batching.workers
        self._running[self._executor.submit(make_packed, self._parcel, batch, limit)] = runs

    def _completed(self) -> Iterator[Runs]:
        ready, _ = wait(self._running, self._batching.listening, return_when=FIRST_COMPLETED)
        # Batches with outcomes come first, so that the loss of an executor does not lose them.
        for future in sorted(ready, key=lambda future: future.exception() is not None):
            batch = self._running.pop(future)
            try:
                made = future.result()
            except WorkerLost as death:
                if self._ending():
                    continue  # This process ends and its workers with it, so no run is at fault.
                if len(batch) == 1:
                    yield _dead(batch, death)
                else:
                    self._waiting.extendleft(batch.halves())
                continue
            except BrokenExecutor as death:
                if self._ending():
                    continue
                # Batches are smaller for a while, so that the next death costs fewer runs.
                self._most = max(1, len(batch) // 4)
                if len(batch) == 1 and not self._running and len(ready) == 1:
                    self._require_life()
                    yield _dead(batch, death)
                else:
                    self._suspect += batch.halves()
                continue
            except AleatorError:
                raise
            except BaseException as error:
                # The error did not come from the worker: the user pressed Ctrl-C here.
                if future.exception() is not error:
                    raise
                raise SimulatorError(
                    f"simulator '{self._simulator.name}' cannot run on a worker: {describe(error)}",
                    "let the workers have the same Python, packages and files as this process",
                ) from error
            if len(made):
                self._each = float(made.seconds.mean()) + _INSTANT
            self._most = min(2 * self._most, self._batching.most)
            self._stopped = self._stopped or made.stopped
            if len(made) < len(batch):
                self._waiting.appendleft(batch.some(slice(len(made), None)))
            yield made

    def _require_life(self) -> None:
        """Raise SurroundingsError if workers die even if they are given no run."""
        try:
            self._executor.submit(os.getpid).result()
        except BrokenExecutor as death:
            raise SurroundingsError(
                f"the workers end before they have run anything ({death})",
                'let a script begin its work under `if __name__ == "__main__":`; or ask for fewer '
                "workers, if memory or processes run out",
            ) from death


@contextmanager
def interruptions_noted() -> Iterator[Callable[[], bool]]:
    """Record the first Ctrl-C, so that a run that has just ended can still be stored.

    A second Ctrl-C raises KeyboardInterrupt at once. Code inside the `with` block can ask whether
    Ctrl-C was pressed.
    """
    noted: list[int] = []

    def note(signum: int, _frame: object) -> None:
        noted.append(signum)
        if len(noted) > 1:
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False  # Only the main thread of a process receives Ctrl-C.
        return
    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: bool(noted)
    finally:
        signal.signal(signal.SIGINT, before)


def _dead(run: Runs, death: BaseException) -> Runs:
    message = f"the worker process died ({death})" if str(death) else "the worker process died"
    return replace(run, failures={0: Failure(message, kind="WorkerDied")})


def _packed(simulator: Simulator) -> bytes:
    import cloudpickle

    try:
        return bytes(cloudpickle.dumps(simulator))
    except Exception as error:
        raise SimulatorError(
            f"simulator '{simulator.name}' cannot be sent to other processes: {describe(error)}",
            "let it hold no open file, connection or lock, or run it here: without workers",
        ) from error
