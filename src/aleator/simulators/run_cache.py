"""The runs of one simulator under the cases of one table, in a store."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from aleator.errors import StoreError
from aleator.simulators import store_file
from aleator.simulators.bound import Bound
from aleator.simulators.identity import Case, Identity
from aleator.simulators.runs import Failure, Runs
from aleator.simulators.store import Store
from aleator.simulators.units import Units
from aleator.types import Array

_TOGETHER = 8192
"""Runs that are sought in one query: what it takes in memory stays small."""


class RunCache:
    """The runs of one simulator under the cases of one table, in a store.

    `at_start` is what the store held of the simulator, `added`
    counts the runs that were new to it.

    What came with the names of its responses is kept under a case that has these names, so that a
    study of another response does not take it for its own.
    """

    def __init__(self, store: Store, bound: Bound, units: Units) -> None:
        self.store, self.identity = store, Identity.of(bound.simulator)
        self._bound, names = bound, bound.parameters
        self._order = sorted(range(len(names)), key=lambda k: names[k])
        self._responses = units.names
        self._rows = units.rows[bound.cases.first]
        self._sizes = self._rows * len(units.responses)
        self._series = units.series
        # one response may have come without its name
        self._ways = (False, True) if len(units.responses) == 1 else (True,)
        self._cases: dict[tuple[bool, int], Case] = {}
        self.at_start = store.counts(self.identity)
        self.added = 0

    def find(self, asked: Runs) -> Runs:
        """The same runs with outcomes and failures where the store has them."""
        outcome, failures = asked.outcome.copy(), dict[int, Failure]()
        for named in self._ways:
            for start in range(0, len(asked), _TOGETHER):
                rows = slice(start, start + _TOGETHER)
                cases, keys = self._keys(asked.some(rows), named)
                for place, value, message, attempts in self.store.find(
                    self.identity.fingerprint, cases, keys
                ):
                    if message is not None:
                        failures[start + place] = Failure(message, attempts=attempts)
                        continue
                    outcome[start + place] = self._read(value, outcome.shape[1])
        worked = {k: failure for k, failure in failures.items() if np.isnan(outcome[k]).all()}
        return replace(asked, outcome=outcome, failures=worked)

    def _read(self, value: float | bytes | None, width: int) -> Array:
        """The values of a run as the store has them, NaN behind the last; raises StoreError."""
        values = np.full(width, np.nan)
        try:
            found = np.frombuffer(value, "<f8") if isinstance(value, bytes) else np.array([value])
            values[: len(found)] = found
        except (TypeError, ValueError):
            raise StoreError(
                f"{self.store.path}: a run of '{self.identity.name}' is damaged",
                store_file.MOVE_ASIDE,
            ) from None
        return values

    def add(self, made: Runs) -> None:
        """Commit runs as they were made."""
        if not self.store.writable or not len(made):
            return
        now = time.time()
        named = made.named or False not in self._ways
        cases, keys = self._keys(made, named)
        rows: list[tuple[Any, ...]] = [
            (case, x, value, None, None, seconds, made.host, now, 1)
            for (case, x), value, seconds in zip(
                keys, self._values(made), made.seconds.tolist(), strict=True
            )
        ]
        for k, failure in made.failures.items():
            rows[k] = (*rows[k][:2], None, failure.message, failure.log, *rows[k][5:])
        try:
            self.added += self.store.add(self.identity, cases, rows)
        except KeyboardInterrupt:
            # Ctrl-C came while they were written, and took the transaction back.
            self.added += self.store.add(self.identity, cases, rows)
            raise

    def _values(self, made: Runs) -> list[float | bytes]:
        """The outcome of each run as the store has it: a number, or the bytes of several."""
        sizes = self._sizes[made.case]
        if np.all(sizes == 1):
            return made.outcome[:, 0].tolist()  # type: ignore[no-any-return]
        whole = np.ascontiguousarray(made.outcome, dtype="<f8")
        return [row[:size].tobytes() for row, size in zip(whole, sizes.tolist(), strict=True)]

    def _keys(self, runs: Runs, named: bool) -> tuple[list[Case], list[tuple[int, bytes]]]:
        """The different cases of some runs; of each run the position of its case there, and x."""
        chosen, position = np.unique(runs.case, return_inverse=True)
        size = 8 * len(self._order)
        whole = np.ascontiguousarray(runs.x[:, self._order], dtype="<f8").tobytes()
        x = [whole[k * size : (k + 1) * size] for k in range(len(runs))]
        cases = [self._case(named, k) for k in chosen.tolist()]
        return cases, [*zip(position.tolist(), x, strict=True)]

    def _case(self, named: bool, case: int) -> Case:
        """A case as the store knows it, made when it is asked for first."""
        if (named, case) not in self._cases:
            self._cases[named, case] = Case.of(
                self._bound.cases.values(case),
                self._bound.parameters,
                int(self._rows[case]) if self._series else None,
                self._responses if named else (),
            )
        return self._cases[named, case]
