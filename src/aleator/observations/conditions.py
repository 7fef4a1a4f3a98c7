"""Conditions without outcomes: what a prediction is asked for."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from aleator.errors import ExperimentsError
from aleator.observations import tables
from aleator.observations import tables as files
from aleator.observations.experiments import TableRows, rows_of
from aleator.observations.responses import Observations, Response, Transform
from aleator.types import Indices

if TYPE_CHECKING:
    import pandas as pd

OUTCOME = "outcome"


@dataclass(frozen=True, eq=False, init=False)
class Conditions:
    """N experiments without outcomes: R rows of conditions.

    `ids` (N,) are distinct texts; `conditions` has R rows and a named column for each condition:
    float64 where every cell is a number, else objects. `table` has R rows and every column but the
    ids; `experiment` (R,) is the experiment of each row, arange(N) where each row is one,
    and `places` (R,) say where each stands.
    `responses` are those of the identification; `transform` is short for one response that has it.

    Raises ExperimentsError if the sizes differ or an id appears twice.

    >>> import pandas as pd
    >>> Conditions(("a", "b"), pd.DataFrame({"ratio": [0.9, 0.8]})).ids
    ('a', 'b')
    """

    ids: tuple[str, ...]
    conditions: pd.DataFrame
    table: pd.DataFrame
    experiment: Indices
    places: Sequence[str]
    responses: tuple[Response, ...]

    def __init__(
        self,
        ids: tuple[str, ...],
        conditions: pd.DataFrame,
        transform: str = Transform.NONE,
        *,
        responses: Sequence[Response] = (),
        table: pd.DataFrame | None = None,
        experiment: Indices | None = None,
        places: Sequence[str] | None = None,
    ) -> None:
        experiment = np.arange(len(ids)) if experiment is None else np.array(experiment, np.intp)
        check_sizes(ids, conditions, experiment)
        values = {
            "ids": ids, "conditions": conditions, "experiment": experiment,
            "places": [f"experiment '{ids[k]}'" for k in experiment] if places is None else places,
            "table": conditions if table is None else table,
            "responses": tuple(responses) or (Response(OUTCOME, Transform.named(transform)),),
        }  # fmt: skip
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def transform(self) -> Transform:
        """The transform that all responses have; none where they differ."""
        found = {response.transform for response in self.responses}
        return found.pop() if len(found) == 1 else Transform.NONE

    @property
    def simple(self) -> bool:
        """Whether each experiment is one row of which one value is asked for."""
        alone = np.array_equal(self.experiment, np.arange(len(self.ids)))
        return len(self.responses) == 1 and alone

    @property
    def observations(self) -> Observations:
        """What is asked for: every response at every row. The values are NaN."""
        order = np.argsort(self.experiment, kind="stable")
        row = np.repeat(order, len(self.responses))
        response = np.tile(np.arange(len(self.responses)), len(order))
        values = np.full(len(row), np.nan)
        return Observations(self.experiment[row], row, response, values, values, self.responses)

    @classmethod
    def from_frame(
        cls,
        frame: pd.DataFrame,
        *,
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        transform: str = Transform.NONE,
        responses: Sequence[Response] = (),
    ) -> Conditions:
        """Take `conditions` (default: every column but the id) from a data frame.

        Raises ExperimentsError as Experiments.from_frame does.

        >>> import pandas as pd
        >>> Conditions.from_frame(pd.DataFrame({"ratio": [0.9, 0.8]})).ids
        ('1', '2')
        """
        rows = rows_of(tables.from_frame(frame), id, conditions)
        return cls._of(rows, Transform.named(transform), responses)

    @classmethod
    def from_csv(
        cls,
        path: str | Path,
        *,
        id: str | None = None,
        conditions: Sequence[str] | None = None,
        numbers: Collection[str] = (),
        transform: str = Transform.NONE,
        responses: Sequence[Response] = (),
        delimiter: str = ",",
        decimal: str = ".",
    ) -> Conditions:
        """Take `conditions` (default: every column but the id) from a delimited file.

        Those named in `numbers` must be numbers; the others may be text.
        Raises ExperimentsError as Experiments.from_csv does.
        """
        rows = rows_of(files.read(path, delimiter, decimal), id, conditions, numbers=numbers)
        return cls._of(rows, Transform.named(transform), responses)

    @classmethod
    def _of(
        cls, rows: TableRows, transform: Transform, responses: Sequence[Response]
    ) -> Conditions:
        return cls(
            rows.ids, rows.conditions, transform, responses=responses,
            table=rows.table, experiment=rows.experiment, places=rows.source.rows,
        )  # fmt: skip


def check_sizes(ids: tuple[str, ...], conditions: pd.DataFrame, experiment: Indices) -> None:
    """Raise ExperimentsError unless there is an experiment a row, and each id is there once."""
    if len(experiment) != len(conditions):
        raise ExperimentsError(
            f"{len(experiment)} ids for {len(conditions)} rows of conditions", "give one id a row"
        )
    if len(set(ids)) != len(ids):
        twice = next(name for k, name in enumerate(ids) if name in ids[:k])
        raise ExperimentsError(f"the id '{twice}' appears twice", "give each experiment its own id")
    if not np.array_equal(np.unique(experiment), np.arange(len(ids))):
        raise ExperimentsError(
            f"rows belong to {len(np.unique(experiment))} experiments, and there are "
            f"{len(ids)} ids",
            "number the experiment of each row from zero, and give each a row",
        )
