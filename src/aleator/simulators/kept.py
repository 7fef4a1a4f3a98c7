"""The runs of one simulator under the conditions of one table, found in a store and added to it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.simulators.function import Simulator
from aleator.simulators.store import Case, Identity, Row, Store
from aleator.simulators.workers.work import Work, not_finite
from aleator.types import Array, Indices

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
        self.at_start = store.counts(self.identity)
        self.added = 0

    def find(self, index: Indices, x: Array) -> tuple[Array, dict[int, tuple[str, int]]]:
        """Outcomes (R,), NaN where there is none, and of runs that failed message and attempts."""
        outcome = np.full(len(index), np.nan)
        failed: dict[int, tuple[str, int]] = {}
        for start in range(0, len(index), _TOGETHER):
            part = slice(start, start + _TOGETHER)
            cases, position = self._cases_of(index[part])
            keys = [*zip(position, self._keys(x[part]), strict=True)]
            found = self.store.find(self.identity.fingerprint, cases, keys)
            places = start + np.fromiter(found, np.intp, len(found))
            # None, of a failure, becomes NaN
            outcome[places] = np.array([*found.values()], dtype=np.float64)
            without = [place for place, value in found.items() if value is None]
            if without:
                some = [keys[place] for place in without]
                told = self.store.failed(self.identity.fingerprint, cases, some)
                failed |= {start + without[k]: reason for k, reason in told.items()}
        return outcome, failed

    def add(self, index: Indices, x: Array, done: Work) -> None:
        """Commit runs as a worker brings them; one whose outcome is not finite failed, too."""
        if not self.store.writable or not len(index):
            return
        failures: dict[int, tuple[str, str | None]] = {
            k: (not_finite(done.outcome[k]), None)
            for k in np.flatnonzero(~np.isfinite(done.outcome)).tolist()
        }
        failures |= {failure.position: (failure.message, failure.log) for failure in done.failures}
        now = time.time()
        cases, position = self._cases_of(index)
        rows: list[Row] = [
            (case, key, None if k in failures else value, *failures.get(k, (None, None)),
             seconds, done.host, now, 1)
            for k, (case, key, value, seconds) in enumerate(
                zip(
                    position, self._keys(x), done.outcome.tolist(), done.seconds.tolist(),
                    strict=True,
                )
            )
        ]  # fmt: skip
        try:
            self.added += self.store.add(self.identity, cases, rows)
        except KeyboardInterrupt:
            # Ctrl-C came while they were written, and took the transaction back.
            self.added += self.store.add(self.identity, cases, rows)
            raise

    def _cases_of(self, index: Indices) -> tuple[list[Case], list[int]]:
        """The different cases of some runs, and the position of each run's case among them."""
        chosen, position = np.unique(index, return_inverse=True)
        return [self.cases[k] for k in chosen.tolist()], position.tolist()

    def _keys(self, x: Array) -> list[bytes]:
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
