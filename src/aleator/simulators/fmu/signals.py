"""Inputs of an FMU over time, from CSV files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aleator.errors import SimulatorError, nearest
from aleator.simulators.fmu.description import INTEGERS, NUMBERS, REALS, Description, Variable
from aleator.types import Array

if TYPE_CHECKING:
    import pandas as pd

TIME = "time"


@dataclass(frozen=True, eq=False)
class Signal:
    """An input over time: `time` (T,) in s, not decreasing, and `values` (T,).

    A time that comes twice is a jump. Real inputs are interpolated linearly, others hold; before
    the first time and after the last the input is held.
    """

    time: Array
    values: Array


def read_signal(reference: str, folder: Path, variable: str) -> Signal:
    """The signal "file.csv:column", or the column of the variable's own name in "file.csv".

    The file has a column `time`. Raises SimulatorError for anything that is not such a file.
    """
    name, colon, column = reference.rpartition(":")
    # "C:\\drive.csv" has a colon, and no column.
    if not colon or column.lower().endswith(".csv"):
        name, column = reference, variable
    file = folder / name
    table = _table(file)
    columns = [*map(str, table.columns)]
    for wanted in (TIME, column):
        if wanted not in columns:
            raise SimulatorError(
                f"{file}: there is no column '{wanted}'{nearest(wanted, columns)}",
                f"an input needs a column '{TIME}' and its own; there are {', '.join(columns)}",
            )
    time, values = _numbers(table, TIME, file), _numbers(table, column, file)
    if len(time) == 0 or np.any(np.diff(time) < 0.0):
        raise SimulatorError(
            f"{file}: the column '{TIME}' is empty or decreases",
            "sort the rows by time; a time that comes twice is a jump",
        )
    return Signal(time, values)


def columns_of(file: Path, fmu: Description) -> list[str]:
    """The columns of a CSV that are inputs of the FMU. Raises SimulatorError if there is none."""
    columns = [str(column) for column in _table(file).columns]
    found = [
        name
        for name in columns
        if name in fmu.variables and fmu.variables[name].causality == "input"
    ]
    if not found:
        inputs = [v.name for v in fmu.variables.values() if v.causality == "input"]
        raise SimulatorError(
            f"{file}: no column has the name of an input of the FMU",
            f"its inputs are {', '.join(inputs) or 'none'}; the columns are {', '.join(columns)}",
        )
    return found


def checked_input(variable: Variable) -> Variable:
    """The variable, if it can be given over time. Raises SimulatorError if not."""
    if variable.causality != "input" or variable.type not in NUMBERS or not variable.scalar:
        raise SimulatorError(
            f"the FMU's variable {variable} cannot be given over time",
            "name a variable with causality input that is a number; give others one value",
        )
    return variable


def assembled(signals: Mapping[str, Signal], fmu: Description) -> NDArray[Any] | None:
    """Signals on their common times, a structured array (T,) as FMPy takes it; None of none."""
    if not signals:
        return None
    time = _union([signal.time for signal in signals.values()])
    table = np.empty(
        len(time), dtype=[(TIME, np.float64), *((name, _dtype(fmu, name)) for name in signals)]
    )
    table[TIME] = time
    for name, signal in signals.items():
        table[name] = _resampled(signal, time, linear=fmu.variables[name].type in REALS)
    return table


def _dtype(fmu: Description, name: str) -> type:
    kind = fmu.variables[name].type
    if kind == "Boolean":
        return np.bool_
    return np.int64 if kind in INTEGERS or kind == "Enumeration" else np.float64


def _union(times: list[Array]) -> Array:
    """All times in order, each as often as in the signal that has it most often, at most twice."""
    every = np.unique(np.concatenate(times))
    twice = {t for time in times for t in time[1:][np.diff(time) == 0.0].tolist()}
    return np.repeat(every, [2 if t in twice else 1 for t in every.tolist()])


def _resampled(signal: Signal, time: Array, linear: bool) -> Array:
    """Values at `time`, of whose equal pairs the first is before a jump and the second after."""
    second = np.concatenate([[False], np.diff(time) == 0.0])
    before = np.clip(np.searchsorted(signal.time, time, side="left"), 0, len(signal.time) - 1)
    after = np.clip(np.searchsorted(signal.time, time, side="right") - 1, 0, None)
    exact = signal.time[before] == time
    between = np.interp(time, signal.time, signal.values) if linear else signal.values[after]
    first = np.where(exact, signal.values[before], between)
    return np.where(second & exact, signal.values[after], first)


def _table(file: Path) -> pd.DataFrame:
    import pandas as pd

    if not file.is_file():
        beside = [p.name for p in file.parent.glob("*.csv")] if file.parent.is_dir() else []
        raise SimulatorError(
            f"the file of an input, {file}, does not exist{nearest(file.name, beside)}",
            'write "file.csv:column", relative to the study file',
        )
    try:
        return pd.read_csv(file, skipinitialspace=True)
    except (ValueError, UnicodeDecodeError) as error:
        raise SimulatorError(
            f"{file} cannot be read as a CSV: {' '.join(str(error).split())}",
            f"write a header and columns with commas, one of them '{TIME}'",
        ) from error


def _numbers(table: pd.DataFrame, column: str, file: Path) -> Array:
    import pandas as pd

    values = pd.to_numeric(table[column], errors="coerce").to_numpy(dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise SimulatorError(
            f"{file}: row {bad[0] + 2}, column '{column}' is not a finite number",
            "correct the cell",
        )
    return values
