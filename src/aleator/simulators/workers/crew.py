"""Runs handed out in batches: here, or to the workers of an executor."""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager

import cloudpickle
import numpy as np

from aleator.errors import AleatorError, SimulatorError
from aleator.simulators.function import Simulator, describe
from aleator.simulators.workers.dask_executor import WorkerLost
from aleator.simulators.workers.work import Columns, Failure, Work, work, work_of_parcel
from aleator.types import Indices

Give = Callable[[Indices], tuple[Columns, Columns]]

HERE = 0.02
"""Seconds of runs, in this process, after which those that completed are handed over."""
BATCH = 0.5
"""Seconds of runs that a worker is given at once: a batch costs about a millisecond to send."""
MOST_HERE, MOST = 8192, 65_536
"""Runs of one batch, however cheap: in this process, and of a worker."""
WAITING = 2
"""Batches for each worker that are submitted: one runs, one waits. Memory holds no more."""
LISTENING = 0.2
"""Seconds after which a note of Ctrl-C is looked for."""


def carried(simulator: Simulator, give: Give, runs: Indices) -> Iterator[tuple[Indices, Work]]:
    """Run here: `give` tells conditions and parameters of some of `runs`; done ones are yielded.

    >>> from aleator.simulators.function import FunctionSimulator
    >>> x = np.array([1.0, 4.0])
    >>> half = FunctionSimulator(lambda x: x / 2, vectorized=True)
    >>> [done.outcome for _, done in carried(half, lambda k: ({}, {"x": x[k]}), np.arange(2))]
    [array([0.5, 2. ])]
    """
    while len(runs):
        asked = runs[: max(simulator.block, MOST_HERE)]
        done = work(simulator, *give(asked), HERE)
        yield asked[: len(done)], done
        if done.stopped:
            raise done.stopped
        runs = runs[len(done) :]


class Crew:
    """The workers of an executor, and what they were given.

    `carry` yields batches as they complete, in any order. A batch whose worker died is run again
    by halves until the run at fault is found, which is a failure like any other; each half alone,
    unless the executor told which batch it was (WorkerLost). After Ctrl-C it submits nothing more
    and yields what was running, then raises KeyboardInterrupt; a second Ctrl-C does so at once.
    `rest` yields what is running for whoever stops of its own.

    Raises SimulatorError for a simulator that cannot be sent to another process, or be unpacked
    there.
    """

    def __init__(self, simulator: Simulator, executor: Executor) -> None:
        self._simulator, self._executor = simulator, executor
        self._parcel = _packed(simulator)
        self._running: dict[Future[Work], Indices] = {}
        self._waiting: deque[Indices] = deque()
        self._suspect: list[Indices] = []
        self._each = 0.0
        self._most = MOST

    @property
    def slots(self) -> int:
        """Runs that can be at work at once, as far as the executor tells."""
        for name in ("slots", "num_workers", "_max_workers"):
            number = getattr(self._executor, name, None)
            if isinstance(number, int) and number > 0:
                return number
        return os.cpu_count() or 1

    def carry(
        self, give: Give, runs: Indices, stopping: Callable[[int], None]
    ) -> Iterator[tuple[Indices, Work]]:
        """Have `runs` done by the workers; `give` tells conditions and parameters of some.

        `stopping` is told of how many batches are running when Ctrl-C comes.
        """
        self._waiting = deque([runs] if len(runs) else [])
        with interruptions_noted() as interrupted:
            while self._waiting or self._running or self._suspect:
                while self._waiting and not self._suspect and self._has_room():
                    self._submit(give, self._next())
                if self._suspect and not self._running:
                    self._submit(give, self._suspect.pop())
                yield from self._completed()
                if interrupted():
                    stopping(len(self._running))
                    yield from self.rest()
                    raise KeyboardInterrupt

    def rest(self) -> Iterator[tuple[Indices, Work]]:
        """What is running, when it is done; what is not begun is taken back."""
        self._waiting.clear()
        self._suspect.clear()
        self._running = {f: runs for f, runs in self._running.items() if not f.cancel()}
        while self._running:
            yield from self._completed()
            self._waiting.clear()
            self._suspect.clear()

    def _has_room(self) -> bool:
        return len(self._running) < WAITING * self.slots

    def _next(self) -> Indices:
        """The next batch: BATCH seconds of runs, fewer at the end, so that all workers end alike.

        Of a simulator that takes arrays whole blocks, because their last digits may depend on
        their length: so outcomes do not depend on the time that anything took.
        """
        runs, block = self._waiting.popleft(), self._simulator.block
        left = len(runs) + sum(map(len, self._waiting))
        size = max(1.0, min(BATCH / self._each, left / (WAITING * self.slots))) if self._each else 1
        size = min(int(size), self._most)
        if getattr(self._simulator, "vectorized", False):
            size = max(size // block, 1) * block
        if len(runs) > size:
            self._waiting.appendleft(runs[size:])
        return runs[:size]

    def _submit(self, give: Give, runs: Indices) -> None:
        future = self._executor.submit(work_of_parcel, self._parcel, *give(runs), 2.0 * BATCH)
        self._running[future] = runs

    def _completed(self) -> Iterator[tuple[Indices, Work]]:
        ready, _ = wait(self._running, LISTENING, return_when=FIRST_COMPLETED)
        # those with outcomes first: an executor that is lost must not take them along
        for future in sorted(ready, key=lambda future: future.exception() is not None):
            runs = self._running.pop(future)
            try:
                done = future.result()
            except WorkerLost as death:
                if len(runs) == 1:
                    yield runs, _dead(death)
                else:
                    self._waiting.extendleft(np.array_split(runs, 2))
                continue
            except BrokenExecutor as death:
                # small batches for a while: the next death then costs fewer runs
                self._most = max(1, len(runs) // 4)
                if len(runs) == 1 and not self._running and len(ready) == 1:
                    yield runs, _dead(death)
                else:
                    self._suspect += [half for half in np.array_split(runs, 2) if len(half)]
                continue
            except AleatorError:
                raise
            except Exception as error:
                raise SimulatorError(
                    f"simulator '{self._simulator.name}' cannot run on a worker: {describe(error)}",
                    "let the workers have the same Python, packages and files as this process",
                ) from error
            self._each = float(done.seconds.mean()) + 1e-9
            self._most = min(2 * self._most, MOST)
            if len(done) < len(runs):
                self._waiting.appendleft(runs[len(done) :])
            yield runs[: len(done)], done


@contextmanager
def interruptions_noted() -> Iterator[Callable[[], bool]]:
    """The first Ctrl-C is noted, so that it cannot come between a run and its keeping."""
    noted: list[int] = []

    def note(signum: int, _frame: object) -> None:
        noted.append(signum)
        if len(noted) > 1:
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False  # Ctrl-C is the main thread's
        return
    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: bool(noted)
    finally:
        signal.signal(signal.SIGINT, before)


def _dead(death: BaseException) -> Work:
    message = f"the worker process died ({death})" if str(death) else "the worker process died"
    return Work(np.full(1, np.nan), (Failure(0, message, None, "WorkerDied"),), np.zeros(1))


def _packed(simulator: Simulator) -> bytes:
    try:
        return bytes(cloudpickle.dumps(simulator))
    except Exception as error:
        raise SimulatorError(
            f"simulator '{simulator.name}' cannot be sent to other processes: {describe(error)}",
            "let it hold no open file, connection or lock, or run it here: without workers",
        ) from error
