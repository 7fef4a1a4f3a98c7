"""Where runs are made: tried again if they fail, remembered, and kept in the store."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import replace

import numpy as np

from aleator.simulators.bound import Bound
from aleator.simulators.memory import Memory
from aleator.simulators.run_cache import RunCache
from aleator.simulators.run_progress import RunProgress
from aleator.simulators.runs import NOT_FINITE, Failure, Runs
from aleator.simulators.units import Units
from aleator.simulators.workers.dispatcher import Dispatcher, made_here
from aleator.types import Array


class Workshop:
    """Makes the runs of a `bound` simulator here, or by the workers of an `executor`.

    What comes of them is kept in `memory` and, where there is one, in the store of `cache`. One
    that fails is tried again `retries` times. `fresh` counts those made here that have an outcome;
    `tried` counts all that were made here, which took `seconds` together, in `waited`
    seconds of the clock.
    """

    def __init__(
        self,
        bound: Bound,
        units: Units,
        cache: RunCache | None,
        executor: Executor | None,
        retries: int,
    ) -> None:
        self._bound, self._units, self._cache = bound, units, cache
        self._executor, self._retries = executor, retries
        self.memory = Memory(len(bound.parameters), units.width)
        self.fresh = self.tried = 0
        self.seconds = self.waited = 0.0

    def recall(self, keys: Sequence[bytes], failures: bool) -> None:
        """Remember what the store knows of some runs; `failures` too, unless retries are left."""
        if self._cache is None:
            return
        known = self.memory if failures else self.memory.places
        unknown = [key for key in keys if key not in known]
        found = self._judged(self._cache.find(self.memory.asked(unknown)))
        settled = {
            k: failure
            for k, failure in found.failures.items()
            if failures and (failure.attempts > self._retries or failure.kind == NOT_FINITE)
        }
        self.memory.keep(unknown, replace(found, failures=settled))

    def make(self, keys: Sequence[bytes], progress: RunProgress) -> Generator[Runs, None, None]:
        """Make runs and remember them; those that are not tried again are yielded."""
        began = time.perf_counter()
        for left in reversed(range(1 + self._retries)):
            with closing(self.made(self.memory.asked(keys), progress)) as batches:
                for made in batches:
                    received = self._received(made)
                    self.waited, began = (
                        self.waited + time.perf_counter() - began,
                        time.perf_counter(),
                    )
                    progress.count(len(received), len(received.failures))
                    if not left:
                        yield received
            keys = [key for key in keys if key in self.memory.failures]
            if not keys:
                return
            progress.retry(len(keys))

    def made(self, asked: Runs, progress: RunProgress | None = None) -> Generator[Runs, None, None]:
        """The runs as they are made; after Ctrl-C those that were at work are waited for."""
        if self._executor is None:
            yield from made_here(self._bound, asked)
            return
        workers = Dispatcher(self._bound, self._executor)
        try:
            yield from workers.make(asked, progress.stopping if progress else lambda _: None)
        except GeneratorExit:
            for made in workers.rest():
                self._received(made)
            raise

    def again(self, runs: Runs) -> Array:
        """Outcomes (R, W) of runs that are made once more and kept nowhere, NaN if they fail."""
        found = {
            key: row
            for made in self.made(runs.some(slice(None)))
            for key, row in zip(made.keys(), made.outcome, strict=True)
        }
        lost = np.full(runs.outcome.shape[1], np.nan)
        return np.array([found.get(key, lost) for key in runs.keys()])  # noqa: SIM118  a method

    def _received(self, made: Runs) -> Runs:
        """Keep runs that were made, in the store and here; with the failures of the transform."""
        if self._cache is not None:
            self._cache.add(made)
        judged = self._judged(made)
        self.tried += len(made)
        self.seconds += float(np.sum(made.seconds))
        self.fresh += len(judged) - len(judged.failures)
        self.memory.keep(judged.keys(), judged)
        return judged

    def _judged(self, runs: Runs) -> Runs:
        """Runs have failed that lack a value which is measured, or that the transform cannot take.

        A store may have such runs: another study does not measure it, or does not transform it.
        """
        form = self._bound.form.some(runs.case)
        lost = form.missing(self._units.transformed(runs.outcome)) & ~runs.empty[:, None]
        if not np.any(lost):
            return runs
        outcome, failures = runs.outcome.copy(), dict(runs.failures)
        for run in np.unique(np.nonzero(lost)[0]).tolist():
            column = int(np.argmax(lost[run]))
            value = runs.outcome[run, column]
            why = self._units.responses[column % len(form.responses)].transform.fault(value)
            fault = form.fault(run, column, value) + (f": {why}" if why else "")
            failures[run] = Failure(fault, kind=NOT_FINITE)
            outcome[run] = np.nan
        return replace(runs, outcome=outcome, failures=failures)
