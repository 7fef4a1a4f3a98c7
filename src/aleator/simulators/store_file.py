"""The file of a store of runs: opened, checked, and every trouble with it told in one message."""

from __future__ import annotations

import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aleator.errors import StoreError, short

FORMAT = 1
"""The version of the tables below; a store of a higher one is left alone."""

_MARK = 0x414C4541  # "ALEA": a database without it is not ours to write to
# How long a process waits for another that is writing; one transaction takes milliseconds.
_PATIENCE = 60.0
# Kibibytes of the file that are held in memory: without them a store of a million runs is written
# three times as often, because new runs belong all over its index.
_CACHE = 65536

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
# `outcome` has no type: a column of reals keeps -0.0 as the integer 0.

# Results of searches: stores that were made before there were any get their table when opened.
_SEARCHES = """
CREATE TABLE IF NOT EXISTS searches (
    fingerprint TEXT NOT NULL,
    key TEXT NOT NULL,
    text TEXT NOT NULL,
    digest TEXT NOT NULL,
    PRIMARY KEY (fingerprint, key)
)
"""

# What a query is about, in the memory of the process: a join with it is one query for thousands.
_SOUGHT = """
PRAGMA temp_store = MEMORY;
CREATE TEMP TABLE sought_cases (place INTEGER PRIMARY KEY, hash TEXT);
CREATE TEMP TABLE sought_runs (place INTEGER PRIMARY KEY, "case" INTEGER, x BLOB)
"""


def connected(path: Path) -> tuple[sqlite3.Connection, bool]:
    """A connection to the store at `path`, made if it is not there, and whether it can be written.

    Raises StoreError for what is not a store, is damaged, is of a newer format, or can be neither
    written nor read.
    """
    # of os, as the questions of a path raise for a name that is too long
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
    with told(path):
        if not writable:
            return _read_only(path), False
        connection = _opened(path, "rwc")
        try:
            _check(connection, path)
            _write_ahead(connection)
            _make_tables(connection)
            connection.executescript(_SOUGHT)
        except BaseException:
            connection.close()
            raise
    return connection, True


def _opened(path: Path, mode: str) -> sqlite3.Connection:
    connection = sqlite3.connect(
        f"{path.resolve().as_uri()}?mode={mode}",
        uri=True,
        timeout=_PATIENCE,
        isolation_level=None,  # transactions begin and end where they are written
    )
    # Who adds a run has the number of its case from the same transaction: to ask again at every
    # run takes a third of the time.
    connection.execute("PRAGMA foreign_keys = OFF")
    connection.execute(f"PRAGMA cache_size = -{_CACHE}")
    return connection


def _read_only(path: Path) -> sqlite3.Connection:
    """A store that cannot be written; where nobody has, no file beside it is needed either."""
    log = path.with_name(f"{path.name}-wal")
    unwritten = not log.exists() or log.stat().st_size == 0
    connection = _opened(path, "ro&immutable=1" if unwritten else "ro")
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
    """Raise StoreError unless the file is empty or a store that this version can read."""
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


def _write_ahead(connection: sqlite3.Connection) -> None:
    """Let readers read while one process writes; SQLite does not wait by itself here."""
    give_up = time.monotonic() + _PATIENCE
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY or time.monotonic() > give_up:
                raise
            time.sleep(0.01)


def _make_tables(connection: sqlite3.Connection) -> None:
    with transaction(connection):
        # Asked again inside: another process may have been faster.
        if _number(connection, "user_version") == 0:
            for statement in _TABLES.split(";"):
                connection.execute(statement)
            connection.execute(f"PRAGMA application_id = {_MARK}")
            connection.execute(f"PRAGMA user_version = {FORMAT}")
        connection.execute(_SEARCHES)


@contextmanager
def transaction(connection: sqlite3.Connection, writing: bool = True) -> Iterator[None]:
    """What is written inside is committed as one, or not at all; what is read is of one moment."""
    connection.execute("BEGIN IMMEDIATE" if writing else "BEGIN")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Turn an error of SQLite into a StoreError that says what is wrong with the file `path`."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        problem, remedy = _TROUBLES.get(code, (f"{error}", "see that the file can be written"))
        raise StoreError(f"{short(path)}: {problem}", remedy) from error
    except UnicodeDecodeError as error:  # SQLite quotes the damaged bytes
        raise StoreError(f"{short(path)}: the store of runs is damaged", MOVE_ASIDE) from error


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
        f"another process has been writing to it for {_PATIENCE:.0f} s",
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
