"""Known standard deviations of measurement errors, from a column of the table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from aleator.errors import ExperimentsError, nearest
from aleator.observations.errors import Noise
from aleator.types import Array, Indices

if TYPE_CHECKING:
    from aleator.observations.experiments import Conditions, Experiments


def known_sds(
    noise: Noise, response: str, experiments: Experiments | Conditions, rows: Indices
) -> Array | None:
    """The sds (m, 1) of the observations in these rows (m,); None where the noise has no column.

    Raises ExperimentsError with the row for a cell that is no positive number.
    """
    if noise.column is None:
        return None
    table = experiments.table
    if noise.column not in table.columns:
        columns = [*map(str, table.columns)]
        raise ExperimentsError(
            f"noise of '{response}': sd = '{noise.column}' is not a column"
            f"{nearest(noise.column, columns)}",
            f"the columns are {', '.join(columns)}; a number or limits need no column",
        )
    cells = table[noise.column].to_numpy()[rows]
    sds = np.array([_number(cell) for cell in cells]) if cells.dtype == object else cells
    bad = np.flatnonzero(~((sds > 0.0) & np.isfinite(sds)))
    if bad.size:
        row = int(rows[bad[0]])
        name = experiments.ids[experiments.experiment[row]]
        raise ExperimentsError(
            f"{experiments.places[row]}, column '{noise.column}': the sd of the measurement "
            f"error of experiment '{name}' is '{cells[bad[0]]}'",
            "write a number > 0 there",
        )
    return sds.astype(np.float64)[:, None]


def _number(cell: object) -> float:
    """A cell of a column that is not all numbers; NaN for a text."""
    try:
        return float(str(cell))
    except ValueError:
        return np.nan
