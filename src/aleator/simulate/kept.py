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

# Runs that are sought in one query: what it takes in memory stays small.
_TOGETHER = 8192


class Kept:
    """A runner's side of a store.

    `conditions` are the columns (N,) that the simulator asks for, `parameters` names those of x.
    `at_start` is what the store held of the simulator, `added` counts the runs that were new to it.
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
        self.added = 0

    def find(self, index: Ints, x: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Outcomes (R,) and which of the runs are known; one that failed is known as NaN."""
        outcome, known = np.full(len(index), np.nan), np.zeros(len(index), dtype=bool)
        for start in range(0, len(index), _TOGETHER):
            part = slice(start, start + _TOGETHER)
            cases, position = self._cases_of(index[part])
            keys = [*zip(position, self._keys(x[part]), strict=True)]
            found = self.store.find(self.identity.fingerprint, cases, keys)
            places = start + np.fromiter(found, np.intp, len(found))
            known[places] = True
            # None, of a failure, becomes NaN
            outcome[places] = np.array([*found.values()], dtype=np.float64)
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
        if not self.store.writable or not len(index):
            return
        now = time.time()
        cases, position = self._cases_of(index)
        rows: list[Row] = [
            (case, key, None if failed else value, *(failed or (None, None)),
             seconds, self._host, now, 1)
            for case, key, value, failed in zip(
                position, self._keys(x), outcome, failures, strict=True
            )
        ]  # fmt: skip
        try:
            self.added += self.store.add(self.identity, cases, rows)
        except KeyboardInterrupt:
            # Ctrl-C came while they were written, and took the transaction back.
            self.added += self.store.add(self.identity, cases, rows)
            raise

    def _cases_of(self, index: Ints) -> tuple[list[Case], list[int]]:
        """The different cases of some runs, and the position of each run's case among them."""
        chosen, position = np.unique(index, return_inverse=True)
        return [self.cases[k] for k in chosen.tolist()], position.tolist()

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
