"""What further experiments would tell, as values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from aleator.tasks.results import notebook
from aleator.tasks.results.printed import number
from aleator.types import Array


@dataclass(frozen=True, eq=False)
class NextExperiments:
    """Candidates, what each would tell `about` something, and the set that tells most together.

    Errors are standard errors of what it is about; of several quantities, or of all, their means
    over what they are now (`relative`), geometric for all. `now` is that of the experiments that
    were made, infinite where they leave it open. `alone` (C,) is that after each candidate by
    itself, with its Monte Carlo error `uncertain` (C,), zero where it is exact; NaN for one that
    cannot be simulated. `chosen` are the ids of the best set, the most useful first, `after` the
    error after each, and `ties` how many others would do as well in its place. As many times all
    `made` experiments would have to be repeated as `repetitions` says for the same; None where no
    repetition reaches it. `planned_for` has the value of a hyperparameter that ended on its limit.
    `hyperparameters` has the error of each now and after the set. `sound` and `consistent` are the
    verdicts on the identification that all of it rests on.
    """

    about: str
    relative: bool
    ids: tuple[str, ...]
    conditions: pd.DataFrame
    now: float
    alone: Array
    uncertain: Array
    chosen: tuple[str, ...]
    after: tuple[float, ...]
    ties: tuple[int, ...]
    made: int
    repetitions: float | None
    planned_for: Mapping[str, float]
    hyperparameters: pd.DataFrame
    laws: int
    runs: int
    sound: bool
    consistent: bool | None

    def _repr_html_(self) -> str:
        """The chosen experiments in a notebook."""
        now = f"The error of {self.about} is {number(self.now, 3)} now" + (
            ", over what it is." if self.relative else "."
        )
        return notebook.shown(now, self.plan(), "The set that tells most together, in this order.")

    def table(self) -> pd.DataFrame:
        """A row for each candidate by its id, the most useful first.

        Its conditions (of the first row, where it has several), `standard_error` after it alone,
        and `chosen`, how often it is in the set.
        """
        found = self.conditions.assign(
            standard_error=self.alone,
            chosen=[self.chosen.count(name) for name in self.ids],
        )
        return found.sort_values("standard_error", kind="stable")

    def plan(self) -> pd.DataFrame:
        """A row for each experiment of the set, in order: its conditions and the error after it."""
        found = self.conditions.loc[list(self.chosen)]
        return found.assign(standard_error=self.after, ties=self.ties)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain lists and numbers, as next.json holds it."""
        return {
            "about": self.about,
            "relative": self.relative,
            "now": self.now,
            "candidates": _rows(self.table()),
            "uncertain": dict(zip(self.ids, self.uncertain.tolist(), strict=True)),
            "chosen": _rows(self.plan()),
            "made": self.made,
            "repetitions": self.repetitions,
            "planned_for": dict(self.planned_for),
            "hyperparameters": _rows(self.hyperparameters),
            "laws": self.laws,
            "runs": self.runs,
            "sound": self.sound,
            "consistent": self.consistent,
        }


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows with their ids; of equal names the one that is told of a candidate counts."""
    return [
        {"id": str(name)} | {str(key): value for key, value in row.items()}
        for name, row in zip(table.index, table.to_dict("records"), strict=True)
    ]
