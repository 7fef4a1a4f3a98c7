"""Runs out of a table into a store: those that `exchange` wrote, or that were made elsewhere."""

from __future__ import annotations

import csv
import io
import json
import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from aleator.errors import SimulatorError, StoreError
from aleator.simulators.exchange import CONDITION, FORM, OWN, PARAMETER, REST, from_cell
from aleator.simulators.identity import Case, Identity
from aleator.simulators.protocol import Simulator
from aleator.simulators.records import LAST_MOMENT, StoredRun
from aleator.simulators.store import Store

_MOST = 2**31


@dataclass(frozen=True)
class Imported:
    """Runs that were new, that were there already, and that are there with another outcome."""

    added: int
    present: int
    different: int


def read(store: Store, path: Path, simulator: Simulator | None = None) -> Imported:
    """Add the runs of a CSV file that `exchange.write` wrote, or that has the same columns.

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
    given = {str(name): value or "" for name, value in cells.items()}
    conditions = {
        name.removeprefix(CONDITION): from_cell(cell)
        for name, cell in given.items()
        if name.startswith(CONDITION) and cell
    }
    parameters = {
        name.removeprefix(PARAMETER): _number(name, cell)
        for name, cell in given.items()
        if name.startswith(PARAMETER) and cell
    }
    rows = _whole("rows", given["rows"]) if given.get("rows") else None
    responses = _names(given["responses"]) if given.get("responses") else ()
    outcome, failure = _made(given, (rows or 1) * max(1, len(responses)))
    seconds = _number("seconds", given["seconds"]) if given.get("seconds") else None
    if seconds is not None and seconds < 0.0:
        raise ValueError(f"column 'seconds': {seconds:g} is negative")
    return StoredRun(
        number=0,
        simulator=_identity(given, simulator),
        conditions=conditions,
        parameters=parameters,
        outcome=outcome,
        failure=failure,
        log=given.get("log") or None,
        seconds=seconds,
        host=given.get("host", ""),
        time=_moment(given["time"]) if given.get("time") else time.time(),
        attempt=_whole("attempt", given.get("attempt") or "1"),
        rows=rows,
        responses=responses,
    )


def _identity(given: Mapping[str, str], simulator: Identity | None) -> Identity:
    fingerprint = given.get("fingerprint")
    if not fingerprint:
        if simulator is None:
            raise ValueError("its fingerprint is blank")
        return simulator
    return Identity(fingerprint, *(given.get(name, "") for name in OWN[1:]))


def _made(
    given: Mapping[str, str], size: int
) -> tuple[float | tuple[float, ...] | None, str | None]:
    """The outcome of so many values, or else the failure."""
    cell, failure = given.get("outcome"), given.get("failure")
    if not cell:
        if not failure:
            raise ValueError("it has neither an outcome nor a failure")
        return None, failure
    if failure:
        raise ValueError("it has an outcome and a failure")
    values = _listed(cell) if cell.startswith("[") else _number("outcome", cell)
    count = len(values) if isinstance(values, tuple) else 1
    if count != size:
        raise ValueError(
            f"column 'outcome': {count} values, and by its rows and responses there are {size}"
        )
    return values, None


def _listed(cell: str) -> tuple[float, ...]:
    """The values of a series: those that nobody measured need not be finite."""
    values = json.loads(cell)
    if not all(type(value) in (int, float) for value in values):
        raise ValueError("column 'outcome': the list is not one of numbers")
    return tuple(map(float, values))


def _names(cell: str) -> tuple[str, ...]:
    names: Any = from_cell(cell)
    texts = isinstance(names, list) and all(isinstance(name, str) and name for name in names)
    if not texts or len({*names}) < len(names):
        raise ValueError(f"column 'responses': {cell[:40]} is not a list of names")
    return tuple(names)


def _number(name: str, cell: str) -> float:
    try:
        value = math.nan if "_" in cell else float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"column '{name}': '{cell[:40]}' is not a finite number")
    return value


def _whole(name: str, cell: str) -> int:
    value = _number(name, cell)
    if not (value.is_integer() and 1 <= value < _MOST):
        raise ValueError(f"column '{name}': '{cell[:40]}' is not a whole number from 1")
    return int(value)


def _moment(cell: str) -> float:
    """Seconds since 1970 of a date with a time."""
    try:
        value = datetime.fromisoformat(cell).timestamp()
    except (ValueError, OverflowError, OSError):
        value = math.nan
    if not 0.0 <= value <= LAST_MOMENT:
        raise ValueError(f"column 'time': '{cell[:40]}' is no time such as 2026-01-31T12:00+00:00")
    return value
