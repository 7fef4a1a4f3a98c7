"""How runs are executed: made, tried again if they fail, remembered, and stored."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np

from aleator.core.progress import Progress, duration
from aleator.core.types import Array, Indices
from aleator.errors import StoreError
from aleator.simulators.dispatch import (
    BATCHING,
    Batching,
    Dispatcher,
    made_here,
    without_outcome,
)
from aleator.simulators.runs import NOT_FINITE, Failure, Memory, Runs, row_bytes
from aleator.simulators.store import MOVE_ASIDE, Case, Identity, Store, keep, kept
from aleator.simulators.units import Bound, Units


class RunProgress:
    """Reports to `progress` how many of `total` new runs are done, after some `patience` seconds.

    `reused` is the number of runs that were known before. `outlook` is what is expected after these
    runs; it is added to each report.

    >>> RunProgress.text(30, 100, reused=10, failed=2, retried=0, rate=4.0)
    '30 of 100 runs, 10 of them known, 2 failed, 4 runs/s, about 18 s left'
    """

    def __init__(
        self,
        progress: Progress,
        total: int,
        reused: int,
        outlook: str = "",
        patience: float = 1.0,
    ) -> None:
        self._patience, self._outlook = patience, f"; {outlook}" if outlook else ""
        self._progress, self._total, self._reused = progress, total + reused, reused
        self._done = self._failed = self._retried = 0
        self._began = time.monotonic()

    def count(self, done: int, failed: int) -> None:
        """Count `done` more runs, of which `failed` have no outcome."""
        self._done, self._failed = self._done + done, self._failed + failed
        seconds = time.monotonic() - self._began
        if seconds > self._patience and self._done + self._reused < self._total:
            text = self.text(
                self._done + self._reused, self._total, self._reused, self._failed, self._retried,
                self._done / seconds,
            )  # fmt: skip
            self._progress.update(text + self._outlook, self._done + self._reused, self._total)

    def retry(self, number: int) -> None:
        """Record that this number of failed runs is tried again."""
        self._retried = number
        self._done, self._failed = self._done - number, self._failed - number

    def stopping(self, batches: int) -> None:
        """Report after Ctrl-C how many running batches are still waited for."""
        self._progress.update(
            f"stopping: {batches} batches of runs are still at work and will be kept; Ctrl-C "
            "again leaves them"
        )

    @staticmethod
    def text(done: int, total: int, reused: int, failed: int, retried: int, rate: float) -> str:
        """The progress as one line of text; `rate` is in runs a second."""
        parts = [f"{done:,} of {total:,} runs"]
        parts += [f"{reused:,} of them known"] if reused else []
        parts += [f"{failed:,} failed"] if failed else []
        parts += [f"{retried:,} tried again"] if retried else []
        parts.append(f"{rate:.3g} runs/s")
        parts.append(f"about {duration((total - done) / rate)} left")
        return ", ".join(parts)


class RunCache:
    """The stored runs of one simulator, for the conditions of one table.

    `at_start` has the counts of its runs when the store was opened. If the simulator named its
    responses, a run is stored with these names, so that a study of another response does not use
    it. One query asks for up to `together` runs (by judgement, to limit memory).
    """

    def __init__(self, store: Store, bound: Bound, units: Units, together: int = 8192) -> None:
        self._together = together
        self.store, self.identity = store, Identity.of(bound.simulator)
        self._bound, names = bound, bound.parameters
        self._order = sorted(range(len(names)), key=lambda k: names[k])
        self._width, self._slopes = bound.form.width, bound.form.slopes
        self._responses = units.names
        self._rows = units.rows[bound.cases.first]
        self._sizes = self._rows * len(units.responses)
        self._series = units.series
        # A simulator may return a single response with or without its name: look for both.
        self._ways = (False, True) if len(units.responses) == 1 else (True,)
        self._cases: dict[tuple[bool, int], Case] = {}
        self.at_start = store.counts(self.identity)

    def find(self, runs: Runs) -> Runs:
        """The given runs with their outcomes and failures, as far as the store has them."""
        outcome, failures = runs.outcome.copy(), dict[int, Failure]()
        for named in self._ways:
            for start in range(0, len(runs), self._together):
                rows = slice(start, start + self._together)
                cases, keys = self._keys(runs.some(rows), named)
                for place, value, message, attempts in self.store.find(
                    self.identity.fingerprint, cases, keys
                ):
                    if message is not None:
                        failures[start + place] = Failure(message, attempts=attempts)
                        continue
                    outcome[start + place] = self._read(value, int(runs.case[start + place]))
        worked = {k: failure for k, failure in failures.items() if np.isnan(outcome[k]).all()}
        return replace(runs, outcome=outcome, failures=worked)

    def before(self, question: str) -> Runs:
        """The runs with an outcome that were stored when a `question` was first asked.

        They are returned as runs that are to be made, in the order in which they were stored. The
        number of the last of them is kept under the question, a text that says all that matters of
        it: later runs are left out when it is asked again.
        """
        fingerprint, key = self.identity.fingerprint, f"asked {question}"
        number = kept(self.store, fingerprint, key)
        if number is None:
            number = str(self.store.newest(fingerprint))
            keep(self.store, fingerprint, key, number)
        keys, width = self._up_to(int(number)), len(self._order)
        of = np.array([case for case, _ in keys], dtype=np.intp)
        x = np.empty((len(keys), width))
        x[:, self._order] = np.frombuffer(b"".join(x for _, x in keys), "<f8").reshape(-1, width)
        return Runs.planned(of, x, int(self._sizes.max()))

    def by_case(self) -> Indices:
        """The number of runs with an outcome that the store has of each case."""
        keys = self._up_to(self.store.newest(self.identity.fingerprint))
        return np.bincount([case for case, _ in keys], minlength=len(self._bound.cases))

    def _up_to(self, number: int) -> list[tuple[int, bytes]]:
        """The different runs with an outcome up to a number: the case and the bytes of x."""
        count = len(self._bound.cases)
        cases = [self._case(named, k) for named in self._ways for k in range(count)]
        found = self.store.up_to(self.identity.fingerprint, cases, number)
        return [*dict.fromkeys((place % count, x) for place, x in found)]

    def _read(self, value: float | bytes | None, case: int) -> Array:
        """The stored values of a run, padded with NaN; raises StoreError if they are damaged.

        A run may have been stored with slopes or without.
        """
        values, size = np.full(self._bound.form.columns, np.nan), int(self._sizes[case])
        try:
            found = np.frombuffer(value, "<f8") if isinstance(value, bytes) else np.array([value])
            values[:size] = found[:size]
            if found.size > size:
                slopes = found[size:].reshape(size, len(self._order))
                if self._slopes:
                    rates = values[self._width :].reshape(self._width, self._slopes)
                    rates[:size, self._order] = slopes
        except (TypeError, ValueError):
            raise StoreError(
                f"{self.store.path}: a run of '{self.identity.name}' is damaged",
                MOVE_ASIDE,
            ) from None
        return values

    def add(self, made: Runs) -> None:
        """Commit runs to the store after they were made."""
        if not self.store.writable or not len(made):
            return
        now = time.time()
        named = made.named or False not in self._ways
        cases, keys = self._keys(made, named)
        rows: list[tuple[Any, ...]] = [
            (case, x, None, fault.message, fault.log, seconds, made.host, now, 1)
            if (fault := made.failures.get(k))
            else (case, x, value, None, None, seconds, made.host, now, 1)
            for k, ((case, x), value, seconds) in enumerate(
                zip(keys, self._values(made), made.seconds.tolist(), strict=True)
            )
        ]
        try:
            self.store.add(self.identity, cases, rows)
        except KeyboardInterrupt:
            # Ctrl-C came during the writing, and the transaction was undone: write again.
            self.store.add(self.identity, cases, rows)
            raise

    def _values(self, made: Runs) -> list[float | bytes]:
        """The outcome of each run as it is stored: a number, or the bytes of several numbers.

        These are the values and, where the simulator gives them, the slopes of each value in the
        alphabetical order of the parameters.
        """
        sizes = self._sizes[made.case]
        if np.all(sizes == 1) and not self._slopes:
            return made.outcome[:, 0].tolist()  # type: ignore[no-any-return]
        whole = np.ascontiguousarray(made.outcome, dtype="<f8")
        rates = whole[:, self._width :].reshape(len(whole), self._width, self._slopes)
        return [
            row[:size].tobytes() + (rate[:size, self._order].tobytes() if self._slopes else b"")
            for row, rate, size in zip(whole, rates, sizes.tolist(), strict=True)
        ]

    def _keys(self, runs: Runs, named: bool) -> tuple[list[Case], list[tuple[int, bytes]]]:
        """The distinct cases of some runs, and for each run the number of its case and its x."""
        chosen, position = np.unique(runs.case, return_inverse=True)
        x = row_bytes(runs.x[:, self._order])
        cases = [self._case(named, k) for k in chosen.tolist()]
        return cases, [*zip(position.tolist(), x, strict=True)]

    def _case(self, named: bool, case: int) -> Case:
        """The conditions of one case, in the form of the store."""
        if (named, case) not in self._cases:
            self._cases[named, case] = Case.of(
                self._bound.cases.at(case),
                self._bound.parameters,
                int(self._rows[case]) if self._series else None,
                self._responses if named else (),
            )
        return self._cases[named, case]


class Execution:
    """Makes the runs of a `bound` simulator in this process, or by the workers of an `executor`.

    Runs are remembered in `memory` and, with a `cache`, stored. A run that fails is tried again up
    to `retries` times. `tried` counts all runs that were made, `fresh` those of them with an
    outcome, and `repeated` those that were made again as a check. `seconds` is the work of all of
    them together, `waited` the time that passed meanwhile.
    """

    def __init__(
        self,
        bound: Bound,
        units: Units,
        cache: RunCache | None,
        executor: Executor | None,
        retries: int,
        batching: Batching = BATCHING,
    ) -> None:
        self._batching = batching
        self._bound, self._units, self._cache = bound, units, cache
        self._executor, self._retries = executor, retries
        self.memory = Memory(len(bound.parameters), bound.form.columns)
        self.fresh = self.tried = self.repeated = 0
        self.seconds = self.waited = 0.0

    def recall(self, keys: Sequence[bytes], failures: bool) -> None:
        """Take the stored results of runs into memory, with failures if `failures` is true.

        A failed run that may still be tried again is not taken.
        """
        if self._cache is None:
            return
        known = self.memory if failures else self.memory.places
        unknown = [key for key in keys if key not in known]
        found = self._judged(self._cache.find(self.memory.planned(unknown)))
        settled = {
            k: failure
            for k, failure in found.failures.items()
            if failures and (failure.attempts > self._retries or failure.kind == NOT_FINITE)
        }
        self.memory.keep(unknown, replace(found, failures=settled))

    def make(self, keys: Sequence[bytes], progress: RunProgress) -> Generator[Runs, None, None]:
        """Make runs and remember them; yield each run whose result is final."""
        began = time.perf_counter()
        for left in reversed(range(1 + self._retries)):
            with closing(self.made(self.memory.planned(keys), progress)) as batches:
                for made in batches:
                    received, now = self._received(made), time.perf_counter()
                    self.waited, began = self.waited + now - began, now
                    progress.count(len(received), len(received.failures))
                    if not left:
                        yield received
            keys = [key for key in keys if key in self.memory.failures]
            if not keys:
                return
            progress.retry(len(keys))

    def made(self, runs: Runs, progress: RunProgress | None = None) -> Generator[Runs, None, None]:
        """Yield runs as they are made; after Ctrl-C the running batches are waited for."""
        if self._executor is None:
            yield from made_here(self._bound, runs, self._batching)
            return
        workers = Dispatcher(self._bound, self._executor, self._batching)
        try:
            yield from workers.make(runs, progress.stopping if progress else lambda _: None)
        except GeneratorExit:
            for made in workers.rest():
                self._received(made)
            raise

    def again(self, runs: Runs) -> Array:
        """Outcomes (R, W) of runs that are made again and not remembered; NaN for failures."""
        self.repeated += len(runs)
        found = {
            key: row
            for made in self.made(runs.some(slice(None)))
            for key, row in zip(made.keys(), made.outcome, strict=True)
        }
        lost = np.full(runs.outcome.shape[1], np.nan)
        return np.array([found.get(key, lost) for key in runs.keys()])  # noqa: SIM118  a method

    def _received(self, made: Runs) -> Runs:
        """Store and remember new runs; one with a value that its transform refuses has failed."""
        if self._cache is not None:
            self._cache.add(made)
        judged = self._judged(made)
        self.tried += len(made)
        self.seconds += float(np.sum(made.seconds))
        self.fresh += len(judged) - len(judged.failures)
        self.memory.keep(judged.keys(), judged)
        return judged

    def _judged(self, runs: Runs) -> Runs:
        """The runs, with a failure for each that lacks a measured value or cannot be transformed.

        A store may have such a run as a success, from a study that measures another response.
        """
        form, responses = self._bound.form.some(runs.case), self._units.responses
        lost = form.missing(self._units.transformed(runs.outcome)) & ~runs.empty[:, None]

        def why(column: int, value: float) -> str:
            fault = responses[column % len(responses)].transform.fault(value)
            return f": {fault}" if fault else ""

        return without_outcome(runs, form, lost, why)
