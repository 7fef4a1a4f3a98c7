"""Covariates: columns of the table that say one thing of each experiment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from aleator.errors import ExperimentsError, nearest

if TYPE_CHECKING:
    import pandas as pd

    from aleator.observations.experiments import Conditions, Experiments


def covariates(experiments: Experiments | Conditions, names: Sequence[str]) -> pd.DataFrame:
    """The named columns of the table with a row for each of the N experiments, indexed by ids.

    Raises ExperimentsError for a name that is no column, a blank cell, and a value that differs
    between rows of one experiment: a law holds for the whole experiment.

    >>> import pandas as pd
    >>> from aleator.observations.conditions import Conditions
    >>> table = pd.DataFrame({"id": ["a", "a", "b"], "by": ["x", "x", "y"], "time": [1, 2, 1]})
    >>> covariates(Conditions.from_frame(table, id="id"), ["by"])["by"].tolist()
    ['x', 'y']
    """
    table, owner = experiments.table, experiments.experiment
    first = np.searchsorted(np.sort(owner), np.arange(len(experiments.ids)))
    rows = np.argsort(owner, kind="stable")[first]
    for name in names:
        if name not in table.columns:
            known = [str(column) for column in table.columns]
            raise ExperimentsError(
                f"a law names '{name}', which is no column of the table{nearest(name, known)}",
                f"name one of {', '.join(known)}" if known else "add the column to the table",
            )
        cells = table[name].to_numpy()
        blank = table[name].isna().to_numpy() | (cells == "")
        if blank.any():
            raise ExperimentsError(
                f"{experiments.places[int(np.argmax(blank))]}, column '{name}' of experiment "
                f"'{experiments.ids[owner[int(np.argmax(blank))]]}' is blank, and a law needs it",
                "write its value in every row, or leave the experiment out",
            )
        other = np.flatnonzero(cells != cells[rows][owner])
        if other.size:
            row = int(other[0])
            one = int(rows[owner[row]])
            raise ExperimentsError(
                f"column '{name}' of experiment '{experiments.ids[owner[row]]}' is {cells[one]} in "
                f"{experiments.places[one]} and {cells[row]} in {experiments.places[row]}, "
                "and a law holds for the whole experiment",
                "name a column that does not vary within an experiment; what varies is a condition "
                "of the simulator",
            )
    found = table[list(names)].iloc[rows]
    return found.set_axis(list(experiments.ids), axis=0)
