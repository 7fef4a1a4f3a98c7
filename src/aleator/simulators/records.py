"""The records of a store, run by run: listed, forgotten, written to a table, and read from one."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import math
import os
import sqlite3
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.errors import AleatorError, SimulatorError, StoreError
from aleator.simulators.protocol import Simulator
from aleator.simulators.store import MOVE_ASIDE, Case, Identity, Store, sqlite_errors, transaction

if TYPE_CHECKING:
    import pandas as pd


LAST_MOMENT = (datetime.max - timedelta(days=1)).replace(tzinfo=UTC).timestamp()
"""The last moment, in seconds since 1970, that a date can tell in every time zone."""


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
    with sqlite_errors(store.path):
        rows = store.connection.execute(
            f"SELECT {_OF_SIMULATOR}, count(runs.id), total(failure IS NOT NULL), total(seconds), "
            "min(time), max(time) FROM simulators LEFT JOIN cases ON simulator = simulators.id "
            'LEFT JOIN runs ON runs."case" = cases.id '
            "GROUP BY simulators.id ORDER BY max(time) DESC, first_seen DESC"
        ).fetchall()
    if not all(isinstance(text, str) for *texts, _, _, _, _, _ in rows for text in texts):
        raise _damaged(store, "the name of a simulator")
    found = [
        Holding(Identity(*identity), runs, int(failures), seconds, first, last)
        for *identity, runs, failures, seconds, first, last in rows
    ]
    for one in found:
        if not all(moment is None or _is_moment(moment) for moment in (one.first, one.last)):
            raise _damaged(store, f"a run of '{one.simulator.name}'")
    return found


def _damaged(store: Store, what: str) -> StoreError:
    return StoreError(f"{store.path}: {what} is damaged", MOVE_ASIDE)


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
    with sqlite_errors(store.path):
        for row in store.connection.execute(query, values):
            try:
                run = _stored_run(row)
            except (AttributeError, TypeError, ValueError, RecursionError):
                raise StoreError(f"{store.path}: run {row[0]} is damaged", MOVE_ASIDE) from None
            yield run


# Runs of one case come together: its texts are read once, and a million runs share them.
_read = lru_cache(json.loads)
_identity = lru_cache(Identity)


def _stored_run(row: Sequence[Any]) -> StoredRun:
    """One row of the file; raises TypeError or ValueError where it is not what was written."""
    number, *texts, written, names, x, outcome, failure, log, seconds, host, moment, attempt = row
    conditions = dict(_read(written))
    form = conditions.pop("", {})
    if isinstance(outcome, bytes):
        outcome = tuple(np.frombuffer(outcome, dtype="<f8").tolist())
    elif outcome is not None:
        outcome = float(outcome)
    every = (*texts, failure or "", log or "", host or "")
    if not all(isinstance(text, str) for text in every) or outcome == ():
        raise TypeError
    if not _is_moment(moment) or (seconds is not None and not seconds >= 0.0):
        raise ValueError
    return StoredRun(
        number,
        _identity(*texts),
        conditions,
        dict(zip(_read(names), np.frombuffer(x, dtype="<f8").tolist(), strict=True)),
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
    with sqlite_errors(store.path), transaction(store.connection):
        return store.connection.execute(
            "DELETE FROM runs WHERE failure IS NOT NULL" + (of_one if fingerprint else ""),
            (fingerprint,) if fingerprint else (),
        ).rowcount


def forget(store: Store, fingerprints: Sequence[str]) -> int:
    """Forget simulators with all their runs: the number of the runs."""
    gone = sum(h.runs for h in holdings(store) if h.simulator.fingerprint in fingerprints)
    with sqlite_errors(store.path), transaction(store.connection):
        for statement in _FORGET:
            store.connection.executemany(statement, [(text,) for text in fingerprints])
    # The file shrinks unless another process is using it.
    with sqlite_errors(store.path), suppress(sqlite3.OperationalError):
        store.connection.execute("VACUUM")
    return gone


CONDITION, PARAMETER = "condition.", "parameter."
OWN = ("fingerprint", "simulator", "description", "version")
FORM = ("rows", "responses")
REST = ("outcome", "failure", "log", "seconds", "host", "time", "attempt")


def table(runs: Iterable[StoredRun]) -> pd.DataFrame:
    """Runs as a data frame, a row a run; text conditions are as they are in a CSV file."""
    import pandas as pd

    columns: dict[str, list[Any]] = {}
    number = 0
    for number, run in enumerate(runs, start=1):
        for name, value in _cells(run).items():
            cells = columns.setdefault(name, [])
            cells.extend([None] * (number - 1 - len(cells)))
            cells.append(value)
    order = [*OWN, *(n for n in columns if n not in OWN and n not in REST), *REST]
    padded = {name: columns.pop(name, []) for name in order}
    for cells in padded.values():
        cells.extend([None] * (number - len(cells)))
    return pd.DataFrame(padded)


def _cells(run: StoredRun) -> dict[str, Any]:
    return {
        "fingerprint": run.simulator.fingerprint,
        "simulator": run.simulator.name,
        "description": run.simulator.description,
        "version": run.simulator.version,
        **{f"{CONDITION}{name}": as_cell(value) for name, value in run.conditions.items()},
        **{f"{PARAMETER}{name}": value for name, value in run.parameters.items()},
        **({} if run.rows is None else {"rows": run.rows, "responses": _json(run.responses)}),
        "outcome": json.dumps(run.outcome) if isinstance(run.outcome, tuple) else run.outcome,
        "failure": run.failure,
        "log": run.log,
        "seconds": run.seconds,
        "host": run.host,
        "time": datetime.fromtimestamp(run.time, UTC).isoformat(),
        "attempt": run.attempt,
    }


def as_cell(value: Any) -> Any:
    """A condition as a cell: a number, or a text that `from_cell` takes for nothing else.

    >>> as_cell(2.0), as_cell("bench"), as_cell("007.0"), as_cell("7")
    (2.0, 'bench', '007.0', '"7"')
    """
    if isinstance(value, float) and math.isfinite(value):
        return value
    plain = isinstance(value, str) and value and not _is_json(value)
    return value if plain else _json(value)


def from_cell(text: str) -> Any:
    """The condition that a cell with some text in it stands for; every number is a float.

    >>> from_cell("2"), from_cell("bench"), from_cell('"7"')
    (2.0, 'bench', '7')
    """
    return json.loads(text, parse_int=float) if _is_json(text) else text


def _is_json(text: str) -> bool:
    """Whether a text is JSON without half a character, which no file can hold."""
    try:
        _json(json.loads(text)).encode()
    except (ValueError, RecursionError):
        return False
    return True


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def write(runs: Iterable[StoredRun], path: Path) -> int:
    """Write runs to a CSV or a Parquet file, which its name tells: their number.

    Raises AleatorError for another ending, for Parquet without pyarrow, and for a file that is
    there or cannot be written.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise AleatorError(
            f"{path}: '{path.suffix}' is no kind of table", "end it in .csv or .parquet"
        )
    if path.suffix == ".parquet" and importlib.util.find_spec("pyarrow") is None:
        raise AleatorError(
            f"{path}: a Parquet file needs pyarrow, which is not installed",
            "pip install pyarrow, or write a .csv file",
        )
    if os.path.exists(path):  # of a name that is too long too, where that of a path raises
        raise AleatorError(f"{path} is there already", "name another file, or delete it")
    frame = table(runs)
    try:
        if path.suffix == ".csv":
            # Python writes floats so that they read back exactly.
            frame.to_csv(path, index=False, lineterminator="\n")
        else:
            frame.to_parquet(path, index=False)
    except OSError as error:
        path.unlink(missing_ok=True)
        raise AleatorError(
            f"{path}: the file cannot be written: {error.strerror}", "name another file"
        ) from None
    return len(frame)


@dataclass(frozen=True)
class Imported:
    """Runs that were new, that were there already, and that are there with another outcome."""

    added: int
    present: int
    different: int


def read(store: Store, path: Path, simulator: Simulator | None = None) -> Imported:
    """Add the runs of a CSV file that `write` wrote, or that has the same columns.

    Without the column `fingerprint` they are runs of `simulator`; `parameter.NAME` and `outcome`
    are needed, the rest is not. A run that the store has already stays as it is.

    Raises StoreError, with the line, for anything that is not a run, and for a run of `simulator`
    that it can never be asked for; nothing is then added.
    """
    own = None if simulator is None else Identity.of(simulator)
    of_simulator: dict[Identity, dict[Case, list[StoredRun]]] = {}
    for line, run in _parsed(path, own):
        of_case = of_simulator.setdefault(run.simulator, {})
        case = Case.of(run.conditions, run.parameters, run.rows, run.responses)
        if simulator is not None and run.simulator == own and case not in of_case:
            _require_asked(f"{path}: line {line}", simulator, run)
        of_case.setdefault(case, []).append(run)
    total = added = different = 0
    for identity, of_case in of_simulator.items():
        placed = [
            (k, _x(case, run), run)
            for k, (case, runs) in enumerate(of_case.items())
            for run in runs
        ]
        there = store.find(identity.fingerprint, [*of_case], (key[:2] for key in placed))
        different += sum(outcome != placed[place][2].made[0] for place, outcome, *_ in there)
        rows = [(k, x, *run.made) for k, x, run in placed]
        added += store.add(identity, [*of_case], rows, again=False)
        total += len(rows)
    return Imported(added, total - added, different)


def _x(case: Case, run: StoredRun) -> bytes:
    return np.array([run.parameters[name] for name in case.parameters], dtype="<f8").tobytes()


def _require_asked(where: str, simulator: Simulator, run: StoredRun) -> None:
    """Raise StoreError for a run with names that the simulator is never called with."""
    remedy = "correct the names of the columns; nothing was imported"
    try:
        asked = simulator.asks([*run.conditions], [*run.parameters])
    except SimulatorError as error:
        raise StoreError(
            f"{where} can be no run of this simulator: {error.problem}", remedy
        ) from None
    idle = [name for name in run.conditions if name not in asked]
    if idle:
        raise StoreError(
            f"{where}: column '{CONDITION}{idle[0]}': simulator '{simulator.name}' never asks for "
            f"'{idle[0]}', so that the run would never be used",
            f"{remedy}; a blank cell is a condition that is not asked for",
        )
    if bool(getattr(simulator, "series", False)) != (run.rows is not None):
        raise StoreError(
            f"{where}: one run of simulator '{simulator.name}' makes "
            + ("one row" if run.rows is not None else "all rows of an experiment"),
            "leave the column 'rows' blank"
            if run.rows is not None
            else "write how many in the column 'rows', and their outcomes as a list",
        )


def _parsed(path: Path, simulator: Identity | None) -> Iterable[tuple[int, StoredRun]]:
    """The runs of a file, each with the line that it ends at."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            text = file.read()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise StoreError(f"{path}: the file cannot be read: {reason}", "name a CSV file") from None
    csv.field_size_limit(max(csv.field_size_limit(), len(text)))  # a long series is one cell
    reader = csv.DictReader(io.StringIO(text, newline=""))
    try:
        _check_columns(path, [*(reader.fieldnames or ())], simulator)
        for cells in reader:
            yield reader.line_num, _run(cells, simulator)
    except (csv.Error, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise StoreError(
            f"{path}: line {reader.line_num} is not a run: {error}",
            "correct or delete the row; nothing was imported",
        ) from None


def _check_columns(path: Path, columns: list[str], simulator: Identity | None) -> None:
    for k, name in enumerate(columns):
        named = name.startswith((CONDITION, PARAMETER)) and name not in (CONDITION, PARAMETER)
        if not named and name not in (*OWN, *FORM, *REST):
            raise StoreError(
                f"{path}: the column '{name}' is not known",
                f"name columns {CONDITION}NAME, {PARAMETER}NAME, {', '.join((*OWN, *REST))}",
            )
        if name in columns[:k]:
            raise StoreError(f"{path}: the column '{name}' appears twice", "keep one of the two")
    lacking = [] if any(name.startswith(PARAMETER) for name in columns) else [f"{PARAMETER}NAME"]
    lacking += [] if "outcome" in columns else ["outcome"]
    lacking += [] if simulator or "fingerprint" in columns else ["fingerprint"]
    if lacking:
        raise StoreError(
            f"{path}: the column '{lacking[0]}' is missing",
            "name the study instead of its store: the runs are then of its simulator"
            if lacking == ["fingerprint"]
            else "see `aleator runs export` for the columns",
        )


def _run(cells: Mapping[str | None, str | None], simulator: Identity | None) -> StoredRun:
    """One row, with the number 0; raises ValueError for what is not a run."""
    if None in cells or None in cells.values():
        raise ValueError("it has another number of cells than the header")
    given = {str(name): cell for name, cell in cells.items() if cell}
    found = {name: read(name, given[name]) for name, read in _CELLS.items() if name in given}
    outcome: Any = found.get("outcome")
    failure = given.get("failure")
    if outcome is None and failure is None:
        raise ValueError("it has neither an outcome nor a failure")
    if outcome is not None and failure is not None:
        raise ValueError("it has an outcome and a failure")
    rows, responses = found.get("rows"), found.get("responses", ())
    count, size = len(np.atleast_1d(outcome)), (rows or 1) * max(1, len(responses))
    if outcome is not None and count != size:
        raise ValueError(
            f"column 'outcome': {count} values, and by its rows and responses there are {size}"
        )
    if "fingerprint" in given:
        simulator = Identity(given["fingerprint"], *(given.get(name, "") for name in OWN[1:]))
    if simulator is None:
        raise ValueError("its fingerprint is blank")
    return StoredRun(
        number=0,
        simulator=simulator,
        conditions={
            name.removeprefix(CONDITION): from_cell(cell)
            for name, cell in given.items()
            if name.startswith(CONDITION)
        },
        parameters={
            name.removeprefix(PARAMETER): _number(name, cell)
            for name, cell in given.items()
            if name.startswith(PARAMETER)
        },
        outcome=outcome,
        failure=failure,
        log=given.get("log"),
        seconds=found.get("seconds"),
        host=given.get("host", ""),
        time=found.get("time", time.time()),
        attempt=found.get("attempt", 1),
        rows=rows,
        responses=responses,
    )


def _number(name: str, cell: str) -> float:
    try:
        value = math.nan if "_" in cell else float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _odd(name, cell, "is not a finite number")
    return value


def _whole(name: str, cell: str) -> int:
    value = _number(name, cell)
    if not (value.is_integer() and 1 <= value < sys.maxsize):
        raise _odd(name, cell, "is not a whole number from 1")
    return int(value)


def _outcome(name: str, cell: str) -> float | tuple[float, ...]:
    """A number, or the values of a series: those that nobody measured need not be finite."""
    if not cell.startswith("["):
        return _number(name, cell)
    values = json.loads(cell)
    if not all(type(value) in (int, float) for value in values):
        raise _odd(name, cell, "is not a list of numbers")
    return tuple(map(float, values))


def _names(name: str, cell: str) -> tuple[str, ...]:
    names: Any = from_cell(cell)
    texts = isinstance(names, list) and all(isinstance(one, str) and one for one in names)
    if not texts or len({*names}) < len(names):
        raise _odd(name, cell, "is not a list of names")
    return tuple(names)


def _seconds(name: str, cell: str) -> float:
    if (value := _number(name, cell)) < 0.0:
        raise _odd(name, cell, "is negative")
    return value


def _moment(name: str, cell: str) -> float:
    """Seconds since 1970 of a date with a time."""
    try:
        value = datetime.fromisoformat(cell).timestamp()
    except (ValueError, OverflowError, OSError):
        value = math.nan
    if not _is_moment(value):
        raise _odd(name, cell, "is no time such as 2026-01-31T12:00+00:00")
    return value


_CELLS: Mapping[str, Callable[[str, str], Any]] = {
    "rows": _whole, "responses": _names, "outcome": _outcome, "seconds": _seconds,
    "time": _moment, "attempt": _whole,
}  # fmt: skip


def _odd(name: str, cell: str, what: str, most: int = 40) -> ValueError:
    return ValueError(f"column '{name}': '{cell[:most]}' {what}")
