"""The runs of one simulator under the conditions of one table, found in a store and added to it."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.simulate.failure import RunFailed
from aleator.simulate.function import Simulator, describe
from aleator.simulate.store import Case, Identity, Row, Store

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

CHEAP = 20e-6
"""Seconds of a run that is sooner repeated than found in a store."""
ENOUGH = 10_000
"""Runs of a simulator as cheap as that which a store holds all the same."""


class Kept:
    """A runner's side of a store.

    `conditions` are the columns (N,) that the simulator asks for, `parameters` names those of x.
    Of a simulator whose runs take less than CHEAP only ENOUGH are kept: a million of them would
    take longer to find than to run. `at_start` is what the store held of the simulator, `added`
    counts the runs that were new to it, `left_out` those that were too cheap to be kept.
    """

    def __init__(
        self,
        store: Store,
        simulator: Simulator,
        conditions: Mapping[str, NDArray[Any]],
        number: int,
        parameters: Sequence[str],
    ) -> None:
        self.store, self.identity = store, Identity.of(simulator)
        self._order = sorted(range(len(parameters)), key=lambda k: parameters[k])
        self.cases = [
            Case.of({name: column[k] for name, column in conditions.items()}, parameters)
            for k in range(number)
        ]
        self._host = platform.node()
        self.at_start = store.counts(self.identity)
        self.added = self.left_out = 0
        self._sought = 0
        self._ran, self._seconds = self.at_start.runs, self.at_start.seconds

    @property
    def cheap(self) -> bool:
        """Whether the runs so far took less than CHEAP in the mean."""
        return self._seconds < CHEAP * self._ran

    def find(self, index: Ints, x: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Outcomes (R,) and which of the runs are known; one that failed is known as NaN."""
        outcome, known = np.full(len(index), np.nan), np.zeros(len(index), dtype=bool)
        self._sought += len(index)
        if self.cheap and self._sought > ENOUGH:
            return outcome, known
        keys = self._keys(x)
        for at in np.unique(index).tolist():
            mine = np.flatnonzero(index == at).tolist()
            found = self.store.find(
                self.identity.fingerprint, self.cases[at], [keys[k] for k in mine]
            )
            if not found:
                continue
            for k in mine:
                if keys[k] in found:
                    value = found[keys[k]]
                    known[k], outcome[k] = True, np.nan if value is None else value
        return outcome, known

    def add(self, index: Ints, x: Floats, outcome: Floats, seconds: float) -> None:
        """Commit runs that took so many seconds each; one that is not finite failed."""
        failures = [
            None if np.isfinite(value) else (f"it returned {value:g}", None) for value in outcome
        ]
        self._commit(index, x, outcome.tolist(), failures, seconds)

    def add_failure(self, at: np.intp, x: Floats, error: BaseException, seconds: float) -> None:
        """Commit one run that raised."""
        message, log = describe(error), None
        if isinstance(error, RunFailed):
            message, log = error.message, error.log or None
        self._commit(np.array([at]), x[None, :], [np.nan], [(message, log)], seconds)

    def _commit(
        self,
        index: Ints,
        x: Floats,
        outcome: Sequence[float],
        failures: Sequence[tuple[str, str | None] | None],
        seconds: float,
    ) -> None:
        self._ran += len(index)
        self._seconds += seconds * len(index)
        if not self.store.writable or not len(index):
            return
        if self.cheap and self.at_start.runs + self.added >= ENOUGH:
            self.left_out += len(index)
            return
        now = time.time()
        chosen, position = np.unique(index, return_inverse=True)
        rows: list[Row] = [
            (case, key, None if failed else value, *(failed or (None, None)),
             seconds, self._host, now, 1)
            for case, key, value, failed in zip(
                position.tolist(), self._keys(x), outcome, failures, strict=True
            )
        ]  # fmt: skip
        cases = [self.cases[k] for k in chosen.tolist()]
        try:
            self.added += self.store.add(self.identity, cases, rows)
        except KeyboardInterrupt:
            # Ctrl-C came while they were written, and took the transaction back.
            self.added += self.store.add(self.identity, cases, rows)
            raise

    def _keys(self, x: Floats) -> list[bytes]:
        size = 8 * len(self._order)
        whole = np.ascontiguousarray(x[:, self._order], dtype="<f8").tobytes()
        return [whole[k * size : (k + 1) * size] for k in range(len(x))]


@contextmanager
def keeping(
    kept: Kept | None, study: str, say: Callable[[str], None] | None = None
) -> Iterator[None]:
    """Tell what a store has for a runner, and what it holds of the runs when something stops them.

    `study` is the file that the commands `aleator runs ...` are given.
    """
    if kept is None or say is None:
        yield
        return
    _tell_at_start(kept, study, say)
    try:
        yield
    except BaseException:
        if kept.added:
            say(
                f"{kept.added:,} new runs are kept in {kept.store.path}: the same command goes "
                "on from there"
            )
        raise
    if kept.left_out:
        say(
            f"{kept.left_out:,} runs are not kept: each took less than {1e6 * CHEAP:.0f} "
            "microseconds, and is sooner repeated than found"
        )


def _tell_at_start(kept: Kept, study: str, say: Callable[[str], None]) -> None:
    path, identity = kept.store.path, kept.identity
    stored = kept.at_start
    if stored.runs:
        failed = f", {stored.failures:,} of them failures" if stored.failures else ""
        say(f"{path} has {stored.runs:,} runs of this simulator{failed}; none is repeated")
    if stored.other:
        say(
            f"{path} has {stored.other:,} runs of '{identity.name}' as it was before it changed; "
            f"they are not used (aleator runs list {study})"
        )
    if not kept.store.writable:
        say(f"{path} is read-only: its runs are used, new ones are not kept")
