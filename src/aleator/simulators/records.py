"""The records of a store, run by run: listed, deleted, exported to a table, and imported."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import math
import os
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, FiniteFloat, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from aleator.errors import AleatorError, SimulatorError, StoreError
from aleator.simulators.protocol import Simulator
from aleator.simulators.store import MOVE_ASIDE, Case, Identity, Store, sqlite_errors, transaction

if TYPE_CHECKING:
    import pandas as pd


LAST_MOMENT = (datetime.max - timedelta(days=1)).replace(tzinfo=UTC).timestamp()
"""The latest time that a date can express in every time zone, in seconds since 1970."""


def _as_number(value: object) -> object:
    """The value of a cell; underscores in a text become invalid, as Python reads 1_0 as 10."""
    return value.replace("_", "?") if isinstance(value, str) else value


def _as_moment(value: object) -> object:
    """The seconds since 1970 of a date and time in text form."""
    try:
        return datetime.fromisoformat(value).timestamp() if isinstance(value, str) else value
    except (ValueError, OverflowError, OSError):
        raise ValueError("it is no time such as 2026-01-31T12:00+00:00") from None


def _as_outcome(value: Any) -> Any:
    """An outcome as a number or as several: a JSON list in a cell of a table, bytes in a store."""
    if isinstance(value, str):
        if not value.startswith("["):
            return _FINITE.validate_python(_as_number(value))
        value = json.loads(value)
        if not all(type(one) in (int, float) for one in value):
            raise ValueError("it is not a list of numbers")
    if isinstance(value, bytes):
        value = np.frombuffer(value, dtype="<f8").tolist()
    if value in ([], ()):
        raise ValueError("it is empty")
    return value


def _as_names(value: object) -> object:
    """A list of different names, from JSON text in a cell of a table."""
    names: Any = from_cell(value) if isinstance(value, str) else value
    if not isinstance(names, list | tuple) or "" in names or len({*names}) < len(names):
        raise ValueError("it is not a list of names")
    return names


_FINITE = TypeAdapter(FiniteFloat)
Number = Annotated[FiniteFloat, BeforeValidator(_as_number)]
Seconds = Annotated[Number, Field(ge=0.0)]
Whole = Annotated[int, Field(ge=1, lt=2**63), BeforeValidator(_as_number)]
Moment = Annotated[float, Field(ge=0.0, le=LAST_MOMENT), BeforeValidator(_as_moment)]
Outcome = Annotated[float | tuple[float, ...] | None, BeforeValidator(_as_outcome)]


@dataclass(frozen=True)
class SimulatorRuns:
    """The runs of one simulator: their number, failures, total seconds, and first and last time."""

    simulator: Identity
    runs: int
    failures: int
    seconds: float
    first: Moment | None
    last: Moment | None


@dataclass(frozen=True)
class StoredRun:
    """One run as the store has it; `number` is its number there, `time` is in seconds since 1970.

    `outcome` is a number or several values: row by row, and in each row one for each of the
    `responses`, if the simulator named them. After them the slopes of each value by the parameters
    in alphabetical order may follow. `rows` is the number of rows of a series, None if a
    run makes one row. Raises a ValueError for values that no store can have.
    """

    number: int
    simulator: Identity
    conditions: dict[str, Any]
    parameters: dict[str, Number]
    outcome: Outcome
    failure: str | None
    log: str | None
    seconds: Seconds | None
    host: str
    time: Moment
    attempt: Whole
    rows: Whole | None = None
    responses: Annotated[tuple[str, ...], BeforeValidator(_as_names)] = ()

    @property
    def made(self) -> tuple[Any, ...]:
        """The result of the run, as a tuple in the order that `Store.add` expects."""
        outcome = self.outcome
        return (
            np.array(outcome, "<f8").tobytes() if isinstance(outcome, tuple) else outcome,
            self.failure, self.log, self.seconds, self.host, self.time, self.attempt,
        )  # fmt: skip


_OF_SIMULATOR = "fingerprint, simulators.name, description, version"
_CASES_OF_ONE = (
    "SELECT cases.id FROM cases JOIN simulators ON simulator = simulators.id WHERE fingerprint = ?"
)
_FORGET = (
    f'DELETE FROM runs WHERE "case" IN ({_CASES_OF_ONE})',
    "DELETE FROM cases WHERE simulator IN (SELECT id FROM simulators WHERE fingerprint = ?)",
    "DELETE FROM simulators WHERE fingerprint = ?",
    "DELETE FROM searches WHERE fingerprint = ?",
)


def runs_by_simulator(store: Store) -> list[SimulatorRuns]:
    """Summaries of all simulators in the store, the most recently used first."""
    with sqlite_errors(store.path):
        rows = store.connection.execute(
            f"SELECT {_OF_SIMULATOR}, count(runs.id), total(failure IS NOT NULL), total(seconds), "
            "min(time), max(time) FROM simulators LEFT JOIN cases ON simulator = simulators.id "
            'LEFT JOIN runs ON runs."case" = cases.id '
            "GROUP BY simulators.id ORDER BY max(time) DESC, first_seen DESC"
        ).fetchall()
    found = []
    for *texts, runs, failures, seconds, first, last in rows:
        if not all(isinstance(text, str) for text in texts):
            raise _damaged(store, "the name of a simulator")
        try:
            simulator = Identity(*texts)
            found.append(SimulatorRuns(simulator, runs, int(failures), seconds, first, last))
        except ValueError:
            raise _damaged(store, f"a run of '{simulator.name}'") from None
    return found


def _damaged(store: Store, what: str) -> StoreError:
    return StoreError(f"{store.path}: {what} is damaged", MOVE_ASIDE)


def stored_runs(
    store: Store,
    fingerprint: str | None = None,
    *,
    number: int | None = None,
    failures: bool = False,
    last: int | None = None,
) -> Iterator[StoredRun]:
    """Stored runs in the order in which they were added, one after the other.

    They can be restricted to one simulator (`fingerprint`), one run (`number`), to `failures`, or
    to the `last` few.
    """
    clauses = {"fingerprint = ?": fingerprint, "runs.id = ?": number}
    chosen = {clause: value for clause, value in clauses.items() if value is not None}
    where = " AND ".join([*chosen, *(["failure IS NOT NULL"] if failures else [])])
    query = (
        f"SELECT runs.id AS number, {_OF_SIMULATOR}, conditions, parameters, x, outcome, failure, "
        'log, seconds, hosts.name, time, attempt FROM runs JOIN cases ON runs."case" = cases.id '
        "JOIN simulators ON simulator = simulators.id LEFT JOIN hosts ON host = hosts.id"
        f"{f' WHERE {where}' if where else ''} ORDER BY runs.id"
    )
    if last is not None:
        query = f"SELECT * FROM ({query} DESC LIMIT {int(last)}) ORDER BY number"
    with sqlite_errors(store.path):
        for row in store.connection.execute(query, [*chosen.values()]):
            try:
                run = _stored_run(row)
            except (AttributeError, TypeError, ValueError, RecursionError):
                raise _damaged(store, f"run {row[0]}") from None
            yield run


# Runs with equal conditions follow each other, so that their texts are read only once.
_read = lru_cache(json.loads)
_identity = lru_cache(Identity)


def _stored_run(row: Sequence[Any]) -> StoredRun:
    """A run from one row of the database. Raises TypeError or ValueError if the row is damaged."""
    number, *texts, written, names, x, outcome, failure, log, seconds, host, moment, attempt = row
    if not all(isinstance(text, str) for text in texts) or isinstance(outcome, str):
        raise TypeError
    conditions = dict(_read(written))
    form = conditions.pop("", {})
    values = np.frombuffer(x, dtype="<f8").tolist()
    return StoredRun(
        number, _identity(*texts), conditions, dict(zip(_read(names), values, strict=True)),
        outcome, failure, log, seconds, host or "", moment, attempt,
        form.get("rows"), form.get("responses", ()),
    )  # fmt: skip


def retry(store: Store, fingerprint: str | None = None) -> int:
    """Delete failed runs, of one simulator or of all, so that they run again; returns how many."""
    of_one = f' AND "case" IN ({_CASES_OF_ONE})'
    with sqlite_errors(store.path), transaction(store.connection):
        return store.connection.execute(
            "DELETE FROM runs WHERE failure IS NOT NULL" + (of_one if fingerprint else ""),
            (fingerprint,) if fingerprint else (),
        ).rowcount


def forget(store: Store, fingerprints: Sequence[str]) -> int:
    """Delete simulators with all their runs from the store; returns the number of the runs."""
    gone = sum(
        of.runs for of in runs_by_simulator(store) if of.simulator.fingerprint in fingerprints
    )
    with sqlite_errors(store.path), transaction(store.connection):
        for statement in _FORGET:
            store.connection.executemany(statement, [(text,) for text in fingerprints])
    # The file shrinks unless another process is using it.
    with sqlite_errors(store.path), suppress(sqlite3.OperationalError):
        store.connection.execute("VACUUM")
    return gone


CONDITION, PARAMETER = "condition.", "parameter."
OF_SIMULATOR = ("fingerprint", "simulator", "description", "version")
FORM = ("rows", "responses")
OF_RUN = ("outcome", "failure", "log", "seconds", "host", "time", "attempt")


def table(runs: Iterable[StoredRun]) -> pd.DataFrame:
    """Runs as a data frame with a row for each; text conditions are written as in a CSV file."""
    import pandas as pd

    columns: dict[str, list[Any]] = {}
    number = 0
    for number, run in enumerate(runs, start=1):
        for name, value in _cells(run).items():
            cells = columns.setdefault(name, [])
            cells.extend([None] * (number - 1 - len(cells)))
            cells.append(value)
    order = [
        *OF_SIMULATOR,
        *(n for n in columns if n not in OF_SIMULATOR and n not in OF_RUN),
        *OF_RUN,
    ]
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
    """A condition as a cell of a table: a number, or a text that `from_cell` reads back exactly.

    >>> as_cell(2.0), as_cell("bench"), as_cell("007.0"), as_cell("7")
    (2.0, 'bench', '007.0', '"7"')
    """
    if isinstance(value, float) and math.isfinite(value):
        return value
    plain = isinstance(value, str) and value and not _is_json(value)
    return value if plain else _json(value)


def from_cell(text: str) -> Any:
    """The value of a condition from the text in a cell; every number becomes a float.

    >>> from_cell("2"), from_cell("bench"), from_cell('"7"')
    (2.0, 'bench', '7')
    """
    return json.loads(text, parse_int=float) if _is_json(text) else text


def _is_json(text: str) -> bool:
    """Whether a text is valid JSON, without characters that no file can hold."""
    try:
        _json(json.loads(text)).encode()
    except (ValueError, RecursionError):
        return False
    return True


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def write(runs: Iterable[StoredRun], path: Path) -> int:
    """Write runs to a CSV or Parquet file, by the ending of its name; returns their number.

    Raises AleatorError for another ending, for Parquet without the package pyarrow, for a file that
    exists already, and for one that cannot be written.
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
    if os.path.exists(path):  # Path.exists would raise an error for a name that is too long.
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
    """The numbers of imported runs: added, already present, and present with another outcome."""

    added: int
    present: int
    different: int


def read(store: Store, path: Path, simulator: Simulator | None = None) -> Imported:
    """Add the runs of a CSV file that `write` wrote, or that has the same columns.

    Without the column `fingerprint` they are runs of `simulator`. Columns `parameter.NAME` and
    `outcome` are required, the others are optional. A run that the store already has is not
    changed.

    Raises StoreError, with the line, for a line that is not a run, and for a run of `simulator`
    with conditions or parameters that the simulator never uses. In that case nothing is added.
    """
    own = None if simulator is None else Identity.of(simulator)
    of_simulator: dict[Identity, dict[Case, list[StoredRun]]] = {}
    for line, run in _parsed(path, own):
        of_case = of_simulator.setdefault(run.simulator, {})
        case = Case.of(run.conditions, run.parameters, run.rows, run.responses)
        if simulator is not None and run.simulator == own and case not in of_case:
            _require_usable(f"{path}: line {line}", simulator, run)
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


def _require_usable(where: str, simulator: Simulator, run: StoredRun) -> None:
    """Raise StoreError for a run with conditions or parameters that the simulator never uses."""
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
    """The runs of a CSV file, each with the number of the line at which it ends."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            text = file.read()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise StoreError(f"{path}: the file cannot be read: {reason}", "name a CSV file") from None
    # The limit is raised because one cell may hold a long series.
    csv.field_size_limit(max(csv.field_size_limit(), len(text)))
    reader = csv.DictReader(io.StringIO(text, newline=""))
    try:
        _check_columns(path, [*(reader.fieldnames or ())], simulator)
        for cells in reader:
            yield reader.line_num, _run(cells, simulator)
    except (csv.Error, ValueError, TypeError, OverflowError, RecursionError) as error:
        fault = _fault(error) if isinstance(error, ValidationError) else error
        raise StoreError(
            f"{path}: line {reader.line_num} is not a run: {fault}",
            "correct or delete the row; nothing was imported",
        ) from None


def _check_columns(path: Path, columns: list[str], simulator: Identity | None) -> None:
    for k, name in enumerate(columns):
        named = name.startswith((CONDITION, PARAMETER)) and name not in (CONDITION, PARAMETER)
        if not named and name not in (*OF_SIMULATOR, *FORM, *OF_RUN):
            raise StoreError(
                f"{path}: the column '{name}' is not known",
                f"name columns {CONDITION}NAME, {PARAMETER}NAME, "
                f"{', '.join((*OF_SIMULATOR, *OF_RUN))}",
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


def _fault(error: ValidationError) -> str:
    """The problem of the first cell whose value is invalid for its column."""
    first = error.errors()[0]
    column = ".".join(map(str, first["loc"])).replace("parameters.", PARAMETER)
    return f"column '{column}': '{str(first['input'])[:40]}': {first['msg']}"


def _run(cells: Mapping[str | None, str | None], simulator: Identity | None) -> StoredRun:
    """The run in one line of a table, with the number 0. Raises ValueError if it is not a run."""
    if None in cells or None in cells.values():
        raise ValueError("it has another number of cells than the header")
    filled = {str(name): cell for name, cell in cells.items() if cell}
    if "fingerprint" in filled:
        texts = (filled.get(name, "") for name in OF_SIMULATOR)
        simulator = Identity(*texts)
    if simulator is None:
        raise ValueError("its fingerprint is blank")
    defaults = {"outcome": None, "failure": None, "log": None, "seconds": None, "host": ""}
    run = _RUN.validate_python({
        **defaults, "time": time.time(), "attempt": 1,
        **{name: cell for name, cell in filled.items() if name in (*FORM, *OF_RUN)},
        "number": 0, "simulator": simulator,
        "conditions": {
            name.removeprefix(CONDITION): from_cell(cell)
            for name, cell in filled.items() if name.startswith(CONDITION)
        },
        "parameters": {
            name.removeprefix(PARAMETER): cell
            for name, cell in filled.items() if name.startswith(PARAMETER)
        },
    })  # fmt: skip
    if (run.outcome is None) == (run.failure is None):
        raise ValueError(
            "it has neither an outcome nor a failure"
            if run.failure is None
            else "it has an outcome and a failure"
        )
    count, size = len(np.atleast_1d(run.outcome)), (run.rows or 1) * max(1, len(run.responses))  # type: ignore[arg-type]
    if run.outcome is not None and count not in (size, size * (1 + len(run.parameters))):
        raise ValueError(
            f"column 'outcome': {count} values, and by its rows and responses there are {size}"
        )
    return run


_RUN = TypeAdapter(StoredRun)
