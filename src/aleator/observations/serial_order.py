"""Columns of the table that the measurement errors follow: sds, covariates, and their order."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.errors import ExperimentsError, nearest
from aleator.observations.correlated import ErrorCorrelation, SerialOrder

if TYPE_CHECKING:
    from aleator.observations.experiments import Conditions, Experiments


def numbers_of(
    column: str,
    key: str,
    meaning: str,
    experiments: Experiments | Conditions,
    rows: Indices,
    admissible: Callable[[Array], Flags],
    remedy: str,
    otherwise: str = "",
) -> Array:
    """The numbers (m, 1) in a column of the table, in these rows (m,).

    `key` names the key of the study, and `meaning` the column, in messages; `otherwise` is what to
    do without a column. Raises
    ExperimentsError, which names the row, for a column that is absent, and for a cell that is no
    finite number or not `admissible`.
    """
    table = experiments.table
    if column not in table.columns:
        columns = [*map(str, table.columns)]
        raise ExperimentsError(
            f"{key} = '{column}' is not a column{nearest(column, columns)}",
            f"the columns are {', '.join(columns)}{otherwise}",
        )
    cells = table[column].to_numpy()[rows]
    found = np.array([_number(cell) for cell in cells]) if cells.dtype == object else cells
    bad = np.flatnonzero(~(np.isfinite(found) & admissible(found)))
    if bad.size:
        row = int(rows[bad[0]])
        name = experiments.ids[experiments.experiment[row]]
        raise ExperimentsError(
            f"{experiments.places[row]}, column '{column}': {meaning} of experiment '{name}' is "
            f"'{cells[bad[0]]}'",
            remedy,
        )
    return found.astype(np.float64)[:, None]


def _number(cell: object) -> float:
    """The number in a cell of a column with texts; NaN for a text."""
    try:
        return float(str(cell))
    except ValueError:
        return np.nan


def serial_order(
    correlation: ErrorCorrelation | None,
    response: str,
    experiments: Experiments | Conditions,
    rows: Indices,
) -> SerialOrder | None:
    """The order of the observations `rows` (m,) of a response, along which errors are correlated.

    None without a correlation. Without a column they have the order of the rows, and each row of an
    experiment is a step, also one without a value; of a table with a row for each value only those
    of the response. Raises ExperimentsError, which names the row, for a censored value, a cell that
    is no number, and a step that the correlation does not take.
    """
    if correlation is None:
        return None
    seen = experiments.observations
    owner, row = seen.experiment[rows], seen.row[rows]

    def refused(at: int, problem: str, remedy: str) -> ExperimentsError:
        name = experiments.ids[owner[at]]
        where = f"{experiments.places[row[at]]}, '{response}' of experiment '{name}'"
        return ExperimentsError(f"{where}: {problem}", remedy)

    censored = np.flatnonzero(seen.censored[rows])
    if censored.size:
        raise refused(
            int(censored[0]),
            "only a bound of the value is known, and the probability of a bound given correlated "
            "errors is an integral that is not computed",
            "leave out the correlation of the noise, or the bounds",
        )
    if correlation.along is None:
        place = _steps(experiments, rows)
    else:
        place = numbers_of(
            correlation.along, f"noise of '{response}': along",
            "the place of a value along its correlated errors", experiments, row, np.isfinite,
            "write a number there",
        )[:, 0]  # fmt: skip
    order = np.lexsort((np.arange(rows.size), place, owner))
    gap = np.diff(place[order], prepend=0.0)
    first = np.diff(owner, prepend=-1) != 0
    gap[first] = 0.0
    fault = correlation.fault(gap[~first])
    if fault is not None:
        at, problem, remedy = fault
        raise refused(int(order[~first][at]), problem, remedy)
    return SerialOrder(owner, gap, order)


def _steps(experiments: Experiments | Conditions, rows: Indices) -> Array:
    """The number (m,) of the row of each observation among the rows of its experiment."""
    seen = experiments.observations
    wide = len(seen.responses) == 1 or np.bincount(seen.row).max(initial=0) > 1
    if not wide:
        return np.arange(float(rows.size))
    order = np.argsort(experiments.experiment, kind="stable")
    found = np.empty(order.size)
    found[order] = np.arange(float(order.size))
    return found[seen.row[rows]]
