"""The records of a store, run by run, and how it forgets them."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from aleator.errors import StoreError
from aleator.simulators import store_file
from aleator.simulators.identity import Identity
from aleator.simulators.store import Store

LAST_MOMENT = 253_370_764_800.0
"""Seconds from 1970 to the year 9999, the last that a date can tell everywhere."""


@dataclass(frozen=True)
class Holding:
    """The runs of one simulator: how many, what they took in seconds, from when to when."""

    simulator: Identity
    runs: int
    failures: int
    seconds: float
    first: float | None
    last: float | None


@dataclass(frozen=True)
class StoredRun:
    """One run as the store has it; `number` names it there, `time` is in seconds since 1970.

    `outcome` is a number; or several values, row by row and of each row the `responses`, if the
    simulator named them. `rows` is how many rows a series has, None where a run is one row.
    """

    number: int
    simulator: Identity
    conditions: dict[str, Any]
    parameters: dict[str, float]
    outcome: float | tuple[float, ...] | None
    failure: str | None
    log: str | None
    seconds: float | None
    host: str
    time: float
    attempt: int
    rows: int | None = None
    responses: tuple[str, ...] = ()

    @property
    def made(self) -> tuple[Any, ...]:
        """What came of it, in the order of `Store.add`."""
        outcome = self.outcome
        return (
            np.array(outcome, "<f8").tobytes() if isinstance(outcome, tuple) else outcome,
            self.failure, self.log, self.seconds, self.host, self.time, self.attempt,
        )  # fmt: skip


_OF_SIMULATOR = "fingerprint, simulators.name, description, version"
_FORGET = (
    'DELETE FROM runs WHERE "case" IN (SELECT cases.id FROM cases JOIN simulators '
    "ON simulator = simulators.id WHERE fingerprint = ?)",
    "DELETE FROM cases WHERE simulator IN (SELECT id FROM simulators WHERE fingerprint = ?)",
    "DELETE FROM simulators WHERE fingerprint = ?",
    "DELETE FROM searches WHERE fingerprint = ?",
)
_JOINED = 'runs JOIN cases ON runs."case" = cases.id JOIN simulators ON simulator = simulators.id'


def holdings(store: Store) -> list[Holding]:
    """Every simulator that the store knows, the last seen first."""
    with store_file.told(store.path):
        rows = store.connection.execute(
            f"SELECT {_OF_SIMULATOR}, count(runs.id), total(failure IS NOT NULL), total(seconds), "
            "min(time), max(time) FROM simulators LEFT JOIN cases ON simulator = simulators.id "
            'LEFT JOIN runs ON runs."case" = cases.id '
            "GROUP BY simulators.id ORDER BY max(time) DESC, first_seen DESC"
        ).fetchall()
    if not all(isinstance(text, str) for row in rows for text in row[:4]):
        raise _damaged(store, "the name of a simulator")
    found = [Holding(Identity(*r[:4]), r[4], int(r[5]), *r[6:]) for r in rows]
    for held in found:
        if not all(moment is None or _is_moment(moment) for moment in (held.first, held.last)):
            raise _damaged(store, f"a run of '{held.simulator.name}'")
    return found


def _damaged(store: Store, what: str) -> StoreError:
    return StoreError(f"{store.path}: {what} is damaged", store_file.MOVE_ASIDE)


def _is_moment(value: object) -> bool:
    return isinstance(value, (int, float)) and 0.0 <= value <= LAST_MOMENT


def stored_runs(
    store: Store,
    fingerprint: str | None = None,
    *,
    number: int | None = None,
    failures: bool = False,
    last: int | None = None,
) -> Iterator[StoredRun]:
    """Runs in the order in which they came: of one simulator, one of them, failures, the last."""
    wanted = {
        "fingerprint = ?": fingerprint,
        "runs.id = ?": number,
        "failure IS NOT NULL": True if failures else None,
    }
    chosen = {clause: value for clause, value in wanted.items() if value is not None}
    query = (
        f"SELECT runs.id AS number, {_OF_SIMULATOR}, conditions, parameters, x, outcome, failure, "
        f"log, seconds, hosts.name, time, attempt FROM {_JOINED} "
        "LEFT JOIN hosts ON host = hosts.id"
        + (f" WHERE {' AND '.join(chosen)}" if chosen else "")
        + " ORDER BY runs.id"
    )
    if last is not None:
        query = f"SELECT * FROM ({query} DESC LIMIT {int(last)}) ORDER BY number"
    values = [value for clause, value in chosen.items() if "?" in clause]
    with store_file.told(store.path):
        for row in store.connection.execute(query, values):
            try:
                run = _stored_run(row)
            except (AttributeError, TypeError, ValueError, RecursionError):
                raise StoreError(
                    f"{store.path}: run {row[0]} is damaged", store_file.MOVE_ASIDE
                ) from None
            yield run


# Runs of one case come together: its texts are read once, and a million runs share them.
_read = lru_cache(maxsize=1024)(json.loads)
_identity = lru_cache(maxsize=64)(Identity)


def _stored_run(row: Sequence[Any]) -> StoredRun:
    """One row of the file; raises TypeError or ValueError where it is not what was written."""
    names, x = _read(row[6]), np.frombuffer(row[7], dtype="<f8").tolist()
    conditions = dict(_read(row[5]))
    form = conditions.pop("", {})
    outcome, failure, log, seconds, host, moment, attempt = row[8:]
    if isinstance(outcome, bytes):
        outcome = tuple(np.frombuffer(outcome, dtype="<f8").tolist())
    elif outcome is not None:
        outcome = float(outcome)
    texts = (*row[1:5], failure or "", log or "", host or "")
    if not all(isinstance(text, str) for text in texts) or outcome == ():
        raise TypeError
    if not _is_moment(moment) or (seconds is not None and not seconds >= 0.0):
        raise ValueError
    return StoredRun(
        row[0],
        _identity(*row[1:5]),
        conditions,
        dict(zip(names, x, strict=True)),
        outcome,
        *(failure, log, seconds, host, moment, attempt),
        *[form.get("rows"), tuple(form.get("responses", ()))],
    )


def retry(store: Store, fingerprint: str | None = None) -> int:
    """Forget the failures, of one simulator or of all, so that they run again: their number."""
    of_one = (
        ' AND "case" IN (SELECT cases.id FROM cases JOIN simulators ON simulator = simulators.id '
        "WHERE fingerprint = ?)"
    )
    with store_file.told(store.path), store_file.transaction(store.connection):
        return store.connection.execute(
            "DELETE FROM runs WHERE failure IS NOT NULL" + (of_one if fingerprint else ""),
            (fingerprint,) if fingerprint else (),
        ).rowcount


def forget(store: Store, fingerprints: Sequence[str]) -> int:
    """Forget simulators with all their runs: the number of the runs."""
    gone = sum(h.runs for h in holdings(store) if h.simulator.fingerprint in fingerprints)
    with store_file.told(store.path), store_file.transaction(store.connection):
        for statement in _FORGET:
            store.connection.executemany(statement, [(text,) for text in fingerprints])
    # The file shrinks unless another process is using it.
    with store_file.told(store.path), suppress(sqlite3.OperationalError):
        store.connection.execute("VACUUM")
    return gone
