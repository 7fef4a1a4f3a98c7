"""Runs of a store as a table: to look at them elsewhere, or to take them there (see `imports`).

A row a run; its columns are `condition.NAME`, `parameter.NAME`, `outcome`, `failure`, `log`,
`seconds`, `host`, `time`, `attempt`, and `fingerprint`, `simulator`, `description`, `version`.
A condition that is a number is written as one. A text is written as it is, in quotes if it looks
like a number; a blank cell is a condition that the simulator does not ask for. What a series has
several of, conditions and outcomes, is a list; `rows` and `responses` then say what of.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aleator.errors import AleatorError
from aleator.simulators.records import StoredRun

if TYPE_CHECKING:
    import pandas as pd

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
    """The condition that a cell with some text in it stands for; every number is a float.

    >>> from_cell("2"), from_cell("bench"), from_cell('"7"')
    (2.0, 'bench', '7')
    """
    return _json(text) if _is_json(text) else text


def _is_json(text: str) -> bool:
    try:
        _json(text)
    except (ValueError, RecursionError):
        return False
    return True


def _json(text: str) -> Any:
    """Raises ValueError for what is no JSON, or has half a character, which no file can hold."""
    value = json.loads(text, parse_int=float)
    json.dumps(value, ensure_ascii=False).encode()
    return value


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
