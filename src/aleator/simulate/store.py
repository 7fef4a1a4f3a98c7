"""The store of runs: one SQLite file; a run is committed as soon as it is known.

A run is known by the simulator's fingerprint, the values of the conditions that the simulator asks
for, and the parameters, all exact. Nothing of the study is part of it: experiments under equal
conditions share their runs, and so do studies with the same simulator.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from aleator.simulate import store_file
from aleator.simulate.function import Simulator

SYNCED_AFTER = 1.0
"""Seconds of the simulator's work after which a commit waits for the disk."""

# Values of one query; SQLite takes some thousands, and more gain nothing.
_CHUNK = 200

Row = tuple[int, bytes, float | None, str | None, str | None, float | None, str, float, int]
"""A run to be written: position of its case, x, outcome, failure, log, seconds, host, time,
attempt. It has an outcome or a failure."""


@dataclass(frozen=True)
class Identity:
    """Which simulator it is: runs are reused only under the same `fingerprint`.

    `name` and `description` are for people; `version` is the user's own, or empty.
    """

    fingerprint: str
    name: str
    description: str = ""
    version: str = ""

    @classmethod
    def of(cls, simulator: Simulator) -> Identity:
        """The identity of a simulator.

        >>> from aleator.simulate.function import FunctionSimulator
        >>> def length(load, stiffness):
        ...     return load / stiffness
        >>> identity = Identity.of(FunctionSimulator(length, version="2.1"))
        >>> identity.name, identity.version
        ('length', '2.1')
        """
        return cls(
            simulator.fingerprint(),
            simulator.name,
            str(getattr(simulator, "description", type(simulator).__name__)),
            str(getattr(simulator, "version", "")),
        )


@dataclass(frozen=True)
class Case:
    """What many runs have in common: values of conditions (as JSON), names of parameters.

    The parameters are in the order of the alphabet, so that a study may list them in any.
    """

    conditions: str
    parameters: tuple[str, ...]

    @classmethod
    def of(cls, conditions: Mapping[str, Any], parameters: Iterable[str]) -> Case:
        """The case of some conditions; floats are written so that they read back exactly.

        >>> Case.of({"load": 1.0, "bench": "A"}, ["y", "x"])
        Case(conditions='{"bench": "A", "load": 1.0}', parameters=('x', 'y'))
        """
        plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in conditions.items()}
        text = json.dumps(plain, sort_keys=True, ensure_ascii=False, default=repr)
        return cls(text, tuple(sorted(parameters)))

    @property
    def names(self) -> str:
        """The names of the parameters as JSON."""
        return json.dumps(self.parameters, ensure_ascii=False)

    @property
    def hash(self) -> str:
        """A short text that no other case of the simulator has."""
        return hashlib.sha256(f"{self.conditions}\n{self.names}".encode()).hexdigest()[:32]


@dataclass(frozen=True)
class Counts:
    """Runs of one simulator, failures among them, what they took, and runs of others so named."""

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
    >>> model, case = Identity("3f2a", "spring"), Case.of({"load": 2.0}, ["k"])
    >>> x = np.array([4.0]).tobytes()
    >>> with TemporaryDirectory() as folder, Store(f"{folder}/runs.sqlite") as store:
    ...     added = store.add(model, [case], [(0, x, 0.5, None, None, 1e-3, "bench", 0.0, 1)])
    ...     added, store.find("3f2a", case, [x])[x]
    (1, 0.5)
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
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

    def find(self, fingerprint: str, case: Case, xs: Sequence[bytes]) -> dict[bytes, float | None]:
        """The outcomes of those runs that are there; None for one that failed."""
        found: dict[bytes, float | None] = {}
        with store_file.told(self.path):
            row = self.connection.execute(
                "SELECT cases.id FROM cases JOIN simulators ON cases.simulator = simulators.id "
                "WHERE fingerprint = ? AND hash = ?",
                (fingerprint, case.hash),
            ).fetchone()
            if row is None:
                return found
            for start in range(0, len(xs), _CHUNK):
                part = xs[start : start + _CHUNK]
                marks = ", ".join("?" * len(part))
                query = f'SELECT x, outcome FROM runs WHERE "case" = ? AND x IN ({marks})'
                found.update(self.connection.execute(query, (row[0], *part)))
        return found

    def add(
        self, simulator: Identity, cases: Sequence[Case], rows: Sequence[Row], again: bool = True
    ) -> int:
        """Commit runs; the number of those that the store did not have.

        A run with an outcome is never changed. One that failed is replaced if `again`, which
        counts the attempt.
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
        """How many runs there are of a simulator, and of others that have its name."""
        with store_file.told(self.path):
            rows = self.connection.execute(
                "SELECT fingerprint = ?, count(*), sum(failure IS NOT NULL), total(seconds) "
                "FROM runs "
                'JOIN cases ON runs."case" = cases.id '
                "JOIN simulators ON cases.simulator = simulators.id "
                "WHERE fingerprint = ? OR name = ? GROUP BY 1",
                (simulator.fingerprint, simulator.fingerprint, simulator.name),
            ).fetchall()
        found = {bool(own): (runs, failures, seconds) for own, runs, failures, seconds in rows}
        nothing = (0, 0, 0.0)
        return Counts(*found.get(True, nothing), found.get(False, nothing)[0])

    def _largest(self) -> int:
        """The number of runs ever added, as far as it tells how many are new in a transaction."""
        return int(self.connection.execute("SELECT coalesce(max(id), 0) FROM runs").fetchone()[0])

    def _cases(self, simulator: Identity, cases: Sequence[Case]) -> list[int]:
        """Their numbers in the file; asked every time, as another process may forget some."""
        run = self.connection.execute
        run(
            "INSERT INTO simulators (fingerprint, name, description, version, first_seen) "
            "VALUES (?, ?, ?, ?, ?) ON CONFLICT DO NOTHING",
            (
                simulator.fingerprint, simulator.name, simulator.description, simulator.version,
                time.time(),
            ),
        )  # fmt: skip
        (owner,) = run(
            "SELECT id FROM simulators WHERE fingerprint = ?", (simulator.fingerprint,)
        ).fetchone()
        numbers = []
        for case in cases:
            key = (owner, case.hash)
            row = run("SELECT id FROM cases WHERE simulator = ? AND hash = ?", key).fetchone()
            if row is None:
                values = (*key, case.conditions, case.names)
                row = run(
                    "INSERT INTO cases (simulator, hash, conditions, parameters) "
                    "VALUES (?, ?, ?, ?) RETURNING id",
                    values,
                ).fetchone()
            numbers.append(int(row[0]))
        return numbers

    def _hosts(self, names: Iterable[str]) -> dict[str, int]:
        run = self.connection.execute
        for name in names:
            run("INSERT INTO hosts (name) VALUES (?) ON CONFLICT DO NOTHING", (name,))
        return {name: number for number, name in run("SELECT id, name FROM hosts")}


_INSERT = (
    'INSERT INTO runs ("case", x, outcome, failure, log, seconds, host, time, attempt) '
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
)
_AGAIN = (
    '("case", x) DO UPDATE SET outcome = excluded.outcome, failure = excluded.failure, '
    "log = excluded.log, seconds = excluded.seconds, host = excluded.host, time = excluded.time, "
    "attempt = runs.attempt + 1 WHERE runs.outcome IS NULL"
)
