"""The store of runs: one SQLite file, to which each run is committed as soon as it is made.

The key of a run is the simulator's fingerprint, the exact values of the conditions that the
simulator takes, and the exact parameters. It contains nothing of the study: experiments under equal
conditions share their runs, and so do studies with the same simulator.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from aleator.errors import StoreError, short
from aleator.simulators.protocol import Simulator


@dataclass(frozen=True)
class Identity:
    """The identity of a simulator: runs are reused only under the same `fingerprint`.

    `name` and `description` are for readers. `version` is the text that the user gave, or empty.
    """

    fingerprint: str
    name: str
    description: str = ""
    version: str = ""

    @classmethod
    def of(cls, simulator: Simulator) -> Identity:
        """The identity of a simulator: its fingerprint, name, description and version.

        >>> from aleator.simulators.function import FunctionSimulator
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
    """The common key of many runs: values of conditions (as JSON) and names of parameters.

    The parameters are in alphabetical order, so that their order in a study does not matter. For a
    series the conditions contain lists of values. The number of its rows, and the names of the
    responses if the simulator returned them, are stored under the empty name, which no condition
    has.
    """

    conditions: str
    parameters: tuple[str, ...]

    @classmethod
    def of(
        cls,
        conditions: Mapping[str, Any],
        parameters: Iterable[str],
        rows: int | None = None,
        responses: Sequence[str] = (),
    ) -> Case:
        """The case of these conditions; floats are written with all digits.

        >>> Case.of({"load": 1.0, "bench": "A"}, ["y", "x"])
        Case(conditions='{"bench": "A", "load": 1.0}', parameters=('x', 'y'))
        """
        plain = {name: _plain(value) for name, value in conditions.items()}
        if rows is not None or responses:
            plain[""] = {"rows": rows or 1, "responses": [*responses]}
        text = json.dumps(plain, sort_keys=True, ensure_ascii=False, default=repr)
        return cls(text, tuple(sorted(parameters)))

    @property
    def names(self) -> str:
        """The names of the parameters as a JSON list."""
        return json.dumps(self.parameters, ensure_ascii=False)

    @cached_property
    def hash(self) -> str:
        """A short text that identifies the case among all cases of its simulator."""
        return hashlib.sha256(f"{self.conditions}\n{self.names}".encode()).hexdigest()[:32]


def _plain(value: Any) -> Any:
    """The value of a condition in a form that JSON can hold; the numbers 2 and 2.0 are the same."""
    value = value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value
    return float(value) if type(value) is int else value


FORMAT = 1
"""The version of the database tables; a store of a higher version is not opened."""

_MARK = 0x414C4541  # The letters "ALEA" mark a store, so that no other database is changed.


@dataclass(frozen=True)
class StoreSettings:
    """Settings of how a store of runs uses its file."""

    patience: float = 60.0
    """Seconds that a process waits for another one that is writing. A transaction takes
    milliseconds. Chosen by judgement."""
    cache: int = 65_536
    """Kibibytes of the file that are kept in memory. New runs belong at scattered places of its
    index; without this memory, a store of a million runs was written to disk three times as often
    (seen once; `python -m benchmarks runs` measures the cost of a million runs)."""
    unsynced: float = 1.0
    """Seconds of simulator work after which a commit waits until the disk has the data. A power cut
    loses no more. Chosen by judgement."""


SETTINGS = StoreSettings()

_TABLES = """
CREATE TABLE simulators (
    id INTEGER PRIMARY KEY,
    fingerprint TEXT NOT NULL UNIQUE,
    name TEXT NOT NULL,
    description TEXT NOT NULL,
    version TEXT NOT NULL,
    first_seen REAL NOT NULL
);
CREATE TABLE cases (
    id INTEGER PRIMARY KEY,
    simulator INTEGER NOT NULL REFERENCES simulators ON DELETE CASCADE,
    hash TEXT NOT NULL,
    conditions TEXT NOT NULL,
    parameters TEXT NOT NULL,
    UNIQUE (simulator, hash)
);
CREATE TABLE hosts (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE runs (
    id INTEGER PRIMARY KEY,
    "case" INTEGER NOT NULL REFERENCES cases ON DELETE CASCADE,
    x BLOB NOT NULL,
    outcome,
    failure TEXT,
    log TEXT,
    seconds REAL,
    host INTEGER REFERENCES hosts,
    time REAL NOT NULL,
    attempt INTEGER NOT NULL,
    UNIQUE ("case", x),
    CHECK ((outcome IS NULL) = (failure IS NOT NULL))
)
"""
# The column `outcome` has no type, because SQLite would change -0.0 to 0 in a column of reals.

# Results of searches. A store of an earlier version gets this table when it is opened.
_SEARCHES = """
CREATE TABLE IF NOT EXISTS searches (
    fingerprint TEXT NOT NULL,
    key TEXT NOT NULL,
    text TEXT NOT NULL,
    digest TEXT NOT NULL,
    PRIMARY KEY (fingerprint, key)
)
"""

# Temporary tables in memory hold the keys of a query, so that one query serves thousands of keys.
_SOUGHT = """
PRAGMA temp_store = MEMORY;
CREATE TEMP TABLE sought_cases (place INTEGER PRIMARY KEY, hash TEXT);
CREATE TEMP TABLE sought_runs (place INTEGER PRIMARY KEY, "case" INTEGER, x BLOB)
"""


def connected(path: Path, settings: StoreSettings = SETTINGS) -> tuple[sqlite3.Connection, bool]:
    """A connection to the store at `path`, and whether it can be written; a new file if needed.

    Raises StoreError for a file that is not a store, is damaged, has a newer format, or can be
    neither written nor read.
    """
    # os.path is used, because methods of Path raise an error for a name that is too long.
    there, above = os.path.exists(path), os.path.isdir(path.parent)
    if os.path.isdir(path):
        raise StoreError(f"{short(path)} is a folder, not a store of runs", "name a file in it")
    writable = os.access(path.parent, os.W_OK) and (not there or os.access(path, os.W_OK))
    if not writable and not there:
        raise StoreError(
            f"{short(path)}: a store of runs cannot be made in the folder {short(path.parent)}: "
            + ("it is read-only" if above else "there is no such folder"),
            "name a file elsewhere (--store FILE), or keep no runs (--no-store)",
        )
    with sqlite_errors(path):
        if not writable:
            return _read_only(path, settings), False
        connection = _opened(path, "rwc", settings)
        try:
            _check(connection, path)
            _write_ahead(connection, settings.patience)
            _make_tables(connection)
            connection.executescript(_SOUGHT)
        except BaseException:
            connection.close()
            raise
    return connection, True


def _opened(path: Path, mode: str, settings: StoreSettings) -> sqlite3.Connection:
    connection = sqlite3.connect(
        f"{path.resolve().as_uri()}?mode={mode}",
        uri=True,
        timeout=settings.patience,
        isolation_level=None,  # Transactions are begun and ended explicitly.
    )
    # Checks of foreign keys are off: they take a third of the time, and a run is added in the
    # transaction in which the number of its case was read.
    connection.execute("PRAGMA foreign_keys = OFF")
    connection.execute(f"PRAGMA cache_size = -{settings.cache}")
    return connection


def _read_only(path: Path, settings: StoreSettings) -> sqlite3.Connection:
    """A connection to a store that cannot be written.

    If the store has no write-ahead log, it is opened so that SQLite needs no other file beside it.
    """
    log = path.with_name(f"{path.name}-wal")
    unwritten = not log.exists() or log.stat().st_size == 0
    connection = _opened(path, "ro&immutable=1" if unwritten else "ro", settings)
    try:
        _check(connection, path)
        if _number(connection, "user_version") == 0:
            raise StoreError(f"{short(path)} is empty, and cannot be written", "name another store")
        connection.executescript(_SOUGHT)
    except BaseException:
        connection.close()
        raise
    return connection


def _check(connection: sqlite3.Connection, path: Path) -> None:
    """Raise StoreError unless the file is empty or is a store that this version can read."""
    # A transaction is needed because another process may be making the store now.
    with transaction(connection, writing=False):
        version, mark = _number(connection, "user_version"), _number(connection, "application_id")
        tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if mark != _MARK and (mark or version or tables):
        raise StoreError(
            f"{short(path)} is an SQLite database, but not a store of runs",
            "name another file: this one is left as it is",
        )
    if version > FORMAT:
        raise StoreError(
            f"{short(path)} was written by a newer Aleator: its format is {version}, and this "
            f"version knows {FORMAT}",
            "install that version, or name another file with --store; this one is left as it is",
        )


def _number(connection: sqlite3.Connection, pragma: str) -> int:
    return int(connection.execute(f"PRAGMA {pragma}").fetchone()[0])


def _write_ahead(connection: sqlite3.Connection, patience: float, pause: float = 0.01) -> None:
    """Let others read while one process writes (write-ahead log), with a wait for the lock.

    SQLite itself does not wait for this lock, so it is requested again until `patience` is over.
    """
    give_up = time.monotonic() + patience
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            if _code(error) != sqlite3.SQLITE_BUSY or time.monotonic() > give_up:
                raise
            time.sleep(pause)


def _make_tables(connection: sqlite3.Connection) -> None:
    with transaction(connection):
        # This is read within the transaction, as another process may have made the tables.
        if _number(connection, "user_version") == 0:
            for statement in _TABLES.split(";"):
                connection.execute(statement)
            connection.execute(f"PRAGMA application_id = {_MARK}")
            connection.execute(f"PRAGMA user_version = {FORMAT}")
        connection.execute(_SEARCHES)


@contextmanager
def transaction(connection: sqlite3.Connection, writing: bool = True) -> Iterator[None]:
    """Commit all that the block writes, or nothing; all that it reads belongs to one moment."""
    connection.execute("BEGIN IMMEDIATE" if writing else "BEGIN")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


@contextmanager
def sqlite_errors(path: Path) -> Iterator[None]:
    """Turn an SQLite error into a StoreError that says what is wrong with the file `path`."""
    try:
        yield
    except sqlite3.Error as error:
        usual = f"{error}", "see that the file can be written"
        problem, remedy = _TROUBLES.get(_code(error), usual)
        raise StoreError(f"{short(path)}: {problem}", remedy) from error
    except UnicodeDecodeError as error:  # The message of SQLite contains the damaged bytes.
        raise StoreError(f"{short(path)}: the store of runs is damaged", MOVE_ASIDE) from error


def _code(error: sqlite3.Error) -> int:
    """The kind of an SQLite error: the lowest byte of its code."""
    return getattr(error, "sqlite_errorcode", 0) % 256


MOVE_ASIDE = (
    "move the file aside (it is left as it is) and start again; `sqlite3 FILE .recover` may save "
    "runs from it"
)
_TROUBLES = {
    sqlite3.SQLITE_FULL: (
        "the disk is full, and the last runs could not be written",
        "free some space and start again: every run that was written before is kept",
    ),
    sqlite3.SQLITE_IOERR: (
        "the disk cannot be read or written (it may be full)",
        "see to the disk and start again: every run that was written before is kept",
    ),
    sqlite3.SQLITE_NOTADB: ("this is not a store of runs, or it is damaged", MOVE_ASIDE),
    sqlite3.SQLITE_CORRUPT: ("the store of runs is damaged", MOVE_ASIDE),
    sqlite3.SQLITE_BUSY: (
        "another process has been writing to it for too long",
        "end that process, or name another file with --store",
    ),
    sqlite3.SQLITE_READONLY: (
        "the store of runs cannot be written",
        "make file and folder writable, or name another file with --store",
    ),
    sqlite3.SQLITE_CANTOPEN: (
        "the store of runs cannot be opened",
        "make file and folder readable and writable, or name another file with --store",
    ),
}


# SQLite evaluates a cross join in the order in which it is written, which is the fast one here.
_NUMBERED = (
    "SELECT place, cases.id FROM simulators CROSS JOIN sought_cases CROSS JOIN cases "
    "ON cases.simulator = simulators.id AND cases.hash = sought_cases.hash WHERE fingerprint = ?"
)
_FOUND = (
    "SELECT place, outcome, failure, attempt FROM sought_runs CROSS JOIN runs "
    'ON runs."case" = sought_runs."case" AND runs.x = sought_runs.x'
)
_EARLIER = (
    "SELECT place, x FROM simulators CROSS JOIN sought_cases CROSS JOIN cases "
    "ON cases.simulator = simulators.id AND cases.hash = sought_cases.hash "
    'CROSS JOIN runs ON runs."case" = cases.id '
    "WHERE fingerprint = ? AND runs.id <= ? AND outcome IS NOT NULL ORDER BY runs.id"
)
_NEWEST = (
    "SELECT coalesce(max(runs.id), 0) FROM simulators JOIN cases ON simulator = simulators.id "
    'JOIN runs ON runs."case" = cases.id WHERE fingerprint = ?'
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
    """Numbers of stored runs of one simulator: all, failures, their seconds, and older ones.

    `other` counts runs of an earlier state of the simulator: they have the same name and
    description, but another fingerprint.
    """

    runs: int
    failures: int
    seconds: float
    other: int


class Store:
    """The runs of any number of simulators in the file `path`, which is made if it does not exist.

    A process that is killed loses nothing that was added. A power cut loses at most the last second
    of the simulator's work (`settings.unsynced`): a commit waits for the disk, which takes
    milliseconds, only after that much work. Any number of processes may use the file at once.
    `writable` is false if the file or its folder cannot be written: stored runs are then used, but
    none are added. `added` counts the runs that were added by this object.

    All methods raise StoreError for a file that is not a store, is damaged, has a newer format or
    cannot be read, and for a full disk. The file is then left as it is.

    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> model, case = Identity("3f2a", "spring"), Case.of({"load": 2.0}, ["k"])
    >>> x = np.array([4.0]).tobytes()
    >>> with TemporaryDirectory() as folder, Store(f"{folder}/runs.sqlite") as store:
    ...     added = store.add(model, [case], [(0, x, 0.5, None, None, 1e-3, "bench", 0.0, 1)])
    ...     added, store.find("3f2a", [case], [(0, x), (0, 2 * x)])
    (1, [(0, 0.5, None, 1)])
    """

    def __init__(self, path: str | Path, settings: StoreSettings = SETTINGS) -> None:
        self.path = Path(path).absolute()  # A simulator may change the current folder.
        self.settings = settings
        self.connection, self.writable = connected(self.path, settings)
        self._unsynced, self.added = 0.0, 0

    def __reduce__(self) -> tuple[type[Store], tuple[str, StoreSettings]]:
        """Pickle path and settings only: another process opens its own connection."""
        return Store, (str(self.path), self.settings)

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
        """Close the connection, so that all data are in the one file."""
        with sqlite_errors(self.path):
            self.connection.close()

    def find(
        self, fingerprint: str, cases: Sequence[Case], keys: Iterable[tuple[int, bytes]]
    ) -> list[tuple[int, float | bytes | None, str | None, int]]:
        """The stored runs of these keys: position in `keys`, outcome, failure, attempts.

        A key is the position of the run's case in `cases`, and the bytes of its x. An outcome has
        the form that `add` describes. Cost: some 3 microseconds a stored run, almost none for a
        case that is not stored.
        """
        run = self.connection.execute
        with sqlite_errors(self.path), transaction(self.connection, writing=False):
            numbers = self._numbers(fingerprint, cases)
            sought = (
                (place, numbers[case], x) for place, (case, x) in enumerate(keys) if case in numbers
            )
            run("DELETE FROM sought_runs")
            self.connection.executemany("INSERT INTO sought_runs VALUES (?, ?, ?)", sought)
            return run(_FOUND).fetchall()

    def newest(self, fingerprint: str) -> int:
        """The number of the last run of a simulator; 0 if it has none. Numbers grow with time."""
        with sqlite_errors(self.path):
            return int(self.connection.execute(_NEWEST, (fingerprint,)).fetchone()[0])

    def up_to(
        self, fingerprint: str, cases: Sequence[Case], number: int
    ) -> list[tuple[int, bytes]]:
        """The keys of the runs with an outcome up to a number, in the order of their numbers.

        A key is the position of the run's case in `cases`, and the bytes of its x. Cost: some
        microseconds a run.
        """
        run = self.connection.execute
        with sqlite_errors(self.path), transaction(self.connection, writing=False):
            self._sought(cases)
            return run(_EARLIER, (fingerprint, number)).fetchall()

    def add(
        self,
        simulator: Identity,
        cases: Sequence[Case],
        rows: Sequence[tuple[Any, ...]],
        again: bool = True,
    ) -> int:
        """Commit runs, and return the number of new ones.

        A row has the position of the case, x, outcome, failure, log, seconds, host, time and
        attempt. Either outcome or failure is None. Several values are the bytes of their 64-bit
        floats. A run with an outcome is never changed. With `again` a failed run is replaced, and
        its attempts are counted.
        """
        conflict = _AGAIN if again else "DO NOTHING"
        self._unsynced += sum(seconds or 0.0 for *_, seconds, _, _, _ in rows)
        wait = self._unsynced >= self.settings.unsynced
        with sqlite_errors(self.path):
            self.connection.execute(f"PRAGMA synchronous = {'FULL' if wait else 'NORMAL'}")
            with transaction(self.connection):
                before = self._largest()
                of_case = self._cases(simulator, cases)
                of_host = self._hosts({host for *_, host, _, _ in rows})
                self.connection.executemany(
                    f"{_INSERT} ON CONFLICT {conflict}",
                    [
                        (of_case[case], *made, of_host[host], moment, attempt)
                        for case, *made, host, moment, attempt in rows
                    ],
                )
                added = self._largest() - before
        if wait:
            self._unsynced = 0.0
        self.added += added
        return added

    def counts(self, simulator: Identity) -> Counts:
        """Numbers of runs of a simulator, with this fingerprint and with others."""
        with sqlite_errors(self.path):
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
        """The largest number of a run; its growth in a transaction is the number of new runs."""
        return int(self.connection.execute("SELECT coalesce(max(id), 0) FROM runs").fetchone()[0])

    def _numbers(self, fingerprint: str, cases: Sequence[Case]) -> dict[int, int]:
        """The database numbers of those cases that are stored, by position in `cases`.

        They are read every time, because another process may delete cases.
        """
        self._sought(cases)
        return dict(self.connection.execute(_NUMBERED, (fingerprint,)))

    def _sought(self, cases: Sequence[Case]) -> None:
        """Write the cases of the next query into a table in memory, with their positions."""
        self.connection.execute("DELETE FROM sought_cases")
        self.connection.executemany(
            "INSERT INTO sought_cases VALUES (?, ?)", enumerate(case.hash for case in cases)
        )

    def _cases(self, simulator: Identity, cases: Sequence[Case]) -> dict[int, int]:
        """The database numbers of all cases, by position; missing cases are added."""
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


def kept(store: Store, fingerprint: str, key: str) -> str | None:
    """The text stored for a simulator under a key; None if there is none, or it is damaged.

    From a store that cannot be written no such text is read.
    """
    if not store.writable:
        return None
    with sqlite_errors(store.path):
        row = store.connection.execute(
            "SELECT text, digest FROM searches WHERE fingerprint = ? AND key = ?",
            (fingerprint, key),
        ).fetchone()
    return row[0] if row and row[1] == _digest(key, row[0]) else None


def keep(store: Store, fingerprint: str, key: str, text: str) -> None:
    """Store a text for a simulator under a key, in place of an earlier one."""
    if not store.writable:
        return
    with sqlite_errors(store.path), transaction(store.connection):
        store.connection.execute(
            "INSERT OR REPLACE INTO searches VALUES (?, ?, ?, ?)",
            (fingerprint, key, text, _digest(key, text)),
        )


def _digest(key: str, text: object) -> str:
    return hashlib.sha256(f"{key}{text}".encode()).hexdigest()
