"""The store of runs: one SQLite file; a run is committed as soon as it is known.

A run is known by the simulator's fingerprint, the values of the conditions that the simulator asks
for, and the parameters, all exact. Nothing of the study is part of it: experiments under equal
conditions share their runs, and so do studies with the same simulator.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from aleator.simulators import store_file
from aleator.simulators.identity import Case, Identity

SYNCED_AFTER = 1.0
"""Seconds of the simulator's work after which a commit waits for the disk."""

# A cross join is done in the order in which it is written.
_NUMBERED = (
    "SELECT place, cases.id FROM simulators CROSS JOIN sought_cases CROSS JOIN cases "
    "ON cases.simulator = simulators.id AND cases.hash = sought_cases.hash WHERE fingerprint = ?"
)
_FOUND = (
    "SELECT place, outcome, failure, attempt FROM sought_runs CROSS JOIN runs "
    'ON runs."case" = sought_runs."case" AND runs.x = sought_runs.x'
)
_INSERT = (
    'INSERT INTO runs ("case", x, outcome, failure, log, seconds, host, time, attempt) '
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
)
_AGAIN = (
    '("case", x) DO UPDATE SET outcome = excluded.outcome, failure = excluded.failure, '
    "log = excluded.log, seconds = excluded.seconds, host = excluded.host, time = excluded.time, "
    "attempt = runs.attempt + 1 WHERE runs.outcome IS NULL"
)


@dataclass(frozen=True)
class Counts:
    """Runs of one simulator, failures among them, what they took, and runs of it as it was.

    Those are the runs of others with its name and its description, which tells what is recorded.
    """

    runs: int
    failures: int
    seconds: float
    other: int


class Store:
    """The runs of any number of simulators in the file `path`, made if it is not there.

    A process that is killed loses nothing that was added. A power cut loses at most the last
    SYNCED_AFTER seconds of the simulator's work: so much is handed to the system without waiting
    for the disk, because the wait takes milliseconds. Any number of processes may use it at once.

    `writable` is false where file or folder cannot be written: runs are then found, not added.

    Raises StoreError, here and below, for a file that is not a store, is damaged, is of a newer
    format or cannot be read, and for a full disk; the file is then left as it is.

    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> model, case = Identity("3f2a", "spring"), Case.of({"load": 2.0}, ["k"])
    >>> x = np.array([4.0]).tobytes()
    >>> with TemporaryDirectory() as folder, Store(f"{folder}/runs.sqlite") as store:
    ...     added = store.add(model, [case], [(0, x, 0.5, None, None, 1e-3, "bench", 0.0, 1)])
    ...     added, store.find("3f2a", [case], [(0, x), (0, 2 * x)])
    (1, [(0, 0.5, None, 1)])
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).absolute()  # a simulator may change the current folder
        self.connection, self.writable = store_file.connected(self.path)
        self._unsynced = 0.0

    def __reduce__(self) -> tuple[type[Store], tuple[str]]:
        """Another process gets a connection of its own."""
        return Store, (str(self.path),)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Bring everything into the one file."""
        with store_file.told(self.path):
            self.connection.close()

    def find(
        self, fingerprint: str, cases: Sequence[Case], keys: Iterable[tuple[int, bytes]]
    ) -> list[tuple[int, float | bytes | None, str | None, int]]:
        """Those runs that are there: place in `keys`, outcome (see `add`), failure, attempts.

        A key is the position of the run's case and its x. Cost: some 3 microseconds a run that is
        there, next to none where its case is not.
        """
        run = self.connection.execute
        with store_file.told(self.path), store_file.transaction(self.connection, writing=False):
            numbers = self._numbers(fingerprint, cases)
            sought = (
                (place, numbers[case], x) for place, (case, x) in enumerate(keys) if case in numbers
            )
            run("DELETE FROM sought_runs")
            self.connection.executemany("INSERT INTO sought_runs VALUES (?, ?, ?)", sought)
            return run(_FOUND).fetchall()

    def add(
        self,
        simulator: Identity,
        cases: Sequence[Case],
        rows: Sequence[tuple[Any, ...]],
        again: bool = True,
    ) -> int:
        """Commit runs; the number of those that the store did not have.

        A row is: position of the case, x, outcome, failure, log, seconds, host, time, attempt; one
        of outcome and failure is None. Several values are the bytes of their float64. A run with an
        outcome is never changed. One that failed is replaced if `again`, which counts the attempt.
        """
        conflict = _AGAIN if again else "DO NOTHING"
        self._unsynced += sum(row[5] or 0.0 for row in rows)
        wait = self._unsynced >= SYNCED_AFTER
        with store_file.told(self.path):
            self.connection.execute(f"PRAGMA synchronous = {'FULL' if wait else 'NORMAL'}")
            with store_file.transaction(self.connection):
                before = self._largest()
                of_case = self._cases(simulator, cases)
                of_host = self._hosts({row[6] for row in rows})
                self.connection.executemany(
                    f"{_INSERT} ON CONFLICT {conflict}",
                    [(of_case[r[0]], *r[1:6], of_host[r[6]], *r[7:]) for r in rows],
                )
                added = self._largest() - before
        if wait:
            self._unsynced = 0.0
        return added

    def counts(self, simulator: Identity) -> Counts:
        """How many runs there are of a simulator, and of it under other fingerprints."""
        with store_file.told(self.path):
            rows = self.connection.execute(
                "SELECT fingerprint = ?, count(*), sum(failure IS NOT NULL), total(seconds) "
                "FROM runs "
                'JOIN cases ON runs."case" = cases.id '
                "JOIN simulators ON cases.simulator = simulators.id "
                "WHERE fingerprint = ? OR (name = ? AND description = ?) GROUP BY 1",
                (
                    simulator.fingerprint, simulator.fingerprint, simulator.name,
                    simulator.description,
                ),
            ).fetchall()  # fmt: skip
        found = {bool(own): (runs, failures, seconds) for own, runs, failures, seconds in rows}
        nothing = (0, 0, 0.0)
        return Counts(*found.get(True, nothing), found.get(False, nothing)[0])

    def _largest(self) -> int:
        """The number of runs ever added, as far as it tells how many are new in a transaction."""
        return int(self.connection.execute("SELECT coalesce(max(id), 0) FROM runs").fetchone()[0])

    def _numbers(self, fingerprint: str, cases: Sequence[Case]) -> dict[int, int]:
        """The numbers in the file of those cases that are there, by position.

        Asked every time, as another process may forget some.
        """
        run = self.connection.execute
        run("DELETE FROM sought_cases")
        self.connection.executemany(
            "INSERT INTO sought_cases VALUES (?, ?)", enumerate(case.hash for case in cases)
        )
        return dict(run(_NUMBERED, (fingerprint,)))

    def _cases(self, simulator: Identity, cases: Sequence[Case]) -> dict[int, int]:
        """Their numbers in the file, which has them afterwards, by position."""
        run = self.connection.execute
        run(
            "INSERT INTO simulators (fingerprint, name, description, version, first_seen) "
            "VALUES (?, ?, ?, ?, ?) ON CONFLICT DO NOTHING",
            (
                simulator.fingerprint, simulator.name, simulator.description, simulator.version,
                time.time(),
            ),
        )  # fmt: skip
        numbers = self._numbers(simulator.fingerprint, cases)
        fresh = [case for k, case in enumerate(cases) if k not in numbers]
        if not fresh:
            return numbers
        self.connection.executemany(
            "INSERT INTO cases (simulator, hash, conditions, parameters) "
            "SELECT id, ?, ?, ? FROM simulators WHERE fingerprint = ? ON CONFLICT DO NOTHING",
            [(case.hash, case.conditions, case.names, simulator.fingerprint) for case in fresh],
        )
        return self._numbers(simulator.fingerprint, cases)

    def _hosts(self, names: Iterable[str]) -> dict[str, int]:
        run = self.connection.execute
        for name in names:
            run("INSERT INTO hosts (name) VALUES (?) ON CONFLICT DO NOTHING", (name,))
        return {name: number for number, name in run("SELECT id, name FROM hosts")}
