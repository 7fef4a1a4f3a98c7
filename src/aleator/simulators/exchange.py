"""Runs of a store as a table, and back: to look at them elsewhere, or to bring them from there.

A row a run; its columns are `condition.NAME`, `parameter.NAME`, `outcome`, `failure`, `log`,
`seconds`, `host`, `time`, `attempt`, and `fingerprint`, `simulator`, `description`, `version`.
A condition that is a number is written as one. A text is written as it is, in quotes if it looks
like a number; a blank cell is a condition that the simulator does not ask for. What a series has
several of, conditions and outcomes, is a list; `rows` and `responses` then say what of.
"""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aleator.errors import AleatorError, StoreError
from aleator.simulators.identity import Case, Identity
from aleator.simulators.records import StoredRun
from aleator.simulators.store import Store

if TYPE_CHECKING:
    import pandas as pd

_CONDITION, _PARAMETER = "condition.", "parameter."
_OWN = ("fingerprint", "simulator", "description", "version")
_FORM = ("rows", "responses")
_REST = ("outcome", "failure", "log", "seconds", "host", "time", "attempt")


@dataclass(frozen=True)
class Imported:
    """Runs that were new, that were there already, and that are there with another outcome."""

    added: int
    present: int
    different: int


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
    order = [*_OWN, *(n for n in columns if n not in _OWN and n not in _REST), *_REST]
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
        **{f"{_CONDITION}{name}": as_cell(value) for name, value in run.conditions.items()},
        **{f"{_PARAMETER}{name}": value for name, value in run.parameters.items()},
        **_form(run),
        "outcome": json.dumps(run.outcome) if isinstance(run.outcome, tuple) else run.outcome,
        "failure": run.failure,
        "log": run.log,
        "seconds": run.seconds,
        "host": run.host,
        "time": datetime.fromtimestamp(run.time, UTC).isoformat(),
        "attempt": run.attempt,
    }


def _form(run: StoredRun) -> dict[str, Any]:
    if run.rows is None:
        return {}
    return {"rows": run.rows, "responses": json.dumps(run.responses, ensure_ascii=False)}


def as_cell(value: Any) -> Any:
    """A condition as a cell: a number, or a text that `from_cell` takes for nothing else.

    >>> as_cell(2.0), as_cell("bench"), as_cell("007.0"), as_cell("7")
    (2.0, 'bench', '007.0', '"7"')
    """
    if isinstance(value, float) and math.isfinite(value):
        return value
    plain = isinstance(value, str) and value and not _is_json(value)
    return value if plain else json.dumps(value, ensure_ascii=False)


def from_cell(text: str) -> Any:
    """The condition that a cell with some text in it stands for.

    >>> from_cell("2.0"), from_cell("bench"), from_cell('"7"')
    (2.0, 'bench', '7')
    """
    return json.loads(text) if _is_json(text) else text


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True


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
    if path.exists():
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


def read(store: Store, path: Path, simulator: Identity | None = None) -> Imported:
    """Add the runs of a CSV file that `write` wrote, or that has the same columns.

    Without the column `fingerprint` they are runs of `simulator`; `parameter.NAME` and `outcome`
    are needed, the rest is not. A run that the store has already stays as it is.

    Raises StoreError, with the row, for anything that is not a run; nothing is then added.
    """
    of_simulator: dict[Identity, dict[Case, list[StoredRun]]] = {}
    for run in _parsed(path, simulator):
        of_case = of_simulator.setdefault(run.simulator, {})
        case = Case.of(run.conditions, run.parameters, run.rows, run.responses)
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


def _parsed(path: Path, simulator: Identity | None) -> Iterable[StoredRun]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            text = file.read()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise StoreError(f"{path}: the file cannot be read: {reason}", "name a CSV file") from None
    csv.field_size_limit(max(csv.field_size_limit(), len(text)))  # a long series is one cell
    reader = csv.DictReader(io.StringIO(text, newline=""))
    columns = [*(reader.fieldnames or ())]
    _check_columns(path, columns, simulator)
    for cells in reader:
        try:
            yield _run(cells, simulator)
        except (ValueError, TypeError, OverflowError) as error:
            raise StoreError(
                f"{path}: line {reader.line_num} is not a run: {error}",
                "correct or delete the row; nothing was imported",
            ) from None


def _check_columns(path: Path, columns: list[str], simulator: Identity | None) -> None:
    strange = [
        name
        for name in columns
        if not name.startswith((_CONDITION, _PARAMETER)) and name not in (*_OWN, *_FORM, *_REST)
    ]
    if strange:
        raise StoreError(
            f"{path}: the column '{strange[0]}' is not known",
            f"name columns {_CONDITION}NAME, {_PARAMETER}NAME, {', '.join((*_OWN, *_REST))}",
        )
    lacking = [] if any(name.startswith(_PARAMETER) for name in columns) else [f"{_PARAMETER}NAME"]
    lacking += [] if "outcome" in columns else ["outcome"]
    lacking += [] if simulator or "fingerprint" in columns else ["fingerprint"]
    if lacking:
        raise StoreError(
            f"{path}: the column '{lacking[0]}' is missing",
            "name the study instead of its store: the runs are then of its simulator"
            if lacking == ["fingerprint"]
            else "see `aleator runs export` for the columns",
        )


def _run(cells: dict[str, str | None], simulator: Identity | None) -> StoredRun:
    """One row, with the number 0; raises ValueError for what is not a run."""
    if None in cells or None in cells.values():
        raise ValueError("it has another number of cells than the header")
    given = {name: value or "" for name, value in cells.items()}
    conditions = {
        name.removeprefix(_CONDITION): from_cell(cell)
        for name, cell in given.items()
        if name.startswith(_CONDITION) and cell
    }
    parameters = {
        name.removeprefix(_PARAMETER): _number(name, cell)
        for name, cell in given.items()
        if name.startswith(_PARAMETER) and cell
    }
    if given.get("outcome"):
        outcome, failure = _outcome(given["outcome"]), None
        if given.get("failure"):
            raise ValueError("it has an outcome and a failure")
    else:
        outcome, failure = None, given.get("failure")
        if not failure:
            raise ValueError("it has neither an outcome nor a failure")
    when = given.get("time")
    return StoredRun(
        number=0,
        simulator=_identity(given, simulator),
        conditions=conditions,
        parameters=parameters,
        outcome=outcome,
        failure=failure,
        log=given.get("log") or None,
        seconds=_number("seconds", given["seconds"]) if given.get("seconds") else None,
        host=given.get("host", ""),
        time=datetime.fromisoformat(when).timestamp() if when else time.time(),
        attempt=int(given.get("attempt") or 1),
        rows=int(given["rows"]) if given.get("rows") else None,
        responses=tuple(json.loads(given["responses"])) if given.get("responses") else (),
    )


def _identity(given: dict[str, str], simulator: Identity | None) -> Identity:
    fingerprint = given.get("fingerprint")
    if not fingerprint:
        if simulator is None:
            raise ValueError("its fingerprint is blank")
        return simulator
    return Identity(fingerprint, *(given.get(name, "") for name in _OWN[1:]))


def _outcome(cell: str) -> float | tuple[float, ...]:
    """A number, or the values of a series: those that nobody measured need not be finite."""
    if not cell.startswith("["):
        return _number("outcome", cell)
    values = json.loads(cell)
    if not all(isinstance(value, (int, float)) for value in values):
        raise ValueError("column 'outcome': the list is not one of numbers")
    return tuple(map(float, values))


def _number(name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise ValueError(f"column '{name}': '{cell}' is not a number") from None
    if not math.isfinite(value):
        raise ValueError(f"column '{name}': {cell} is not finite")
    return value
