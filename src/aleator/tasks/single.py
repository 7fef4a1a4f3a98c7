"""Runs seen value by value: for tasks that look at one outcome at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.errors import SimulatorError
from aleator.observations.experiments import Conditions, Experiments
from aleator.simulators import Runner
from aleator.types import Array, Indices


@dataclass(frozen=True, eq=False)
class Single:
    """One value of a unit each, under a name of its own; `owner` is the id of its experiment.

    `unit`, `column` (V,) say which value of which unit of the runner each is.
    """

    runner: Runner
    ids: tuple[str, ...]
    owner: tuple[str, ...]
    unit: Indices
    column: Indices

    def __call__(self, index: Indices, x: Array) -> Array:
        """Values `index` (R,) at parameters x (R, n); raises SimulatorError where a run failed."""
        whole = self.runner.values(self.unit[index], x)
        found = np.asarray(whole[np.arange(len(whole)), self.column[index]])
        lost = np.flatnonzero(np.isnan(found))
        if lost.size:
            why = self.runner.failures.failures
            reason = next(iter(why.values())).message if why else "no value"
            raise SimulatorError(
                f"a run failed for {self.ids[index[lost[0]]]}: {reason}",
                "let `aleator box STUDY.toml` find where every run works",
            )
        return found


def of_values(runner: Runner, table: Experiments | Conditions) -> Single:
    """Every observation of a table, named by experiment, row and response."""
    seen = table.observations
    several = np.bincount(table.experiment, minlength=len(table.ids)) > 1
    place = _places(table.experiment)
    names = [
        _name(
            table.ids[l],
            int(place[row]) + 1 if several[l] else None,
            seen.responses[k].name if len(seen.responses) > 1 else None,
        )
        for l, row, k in zip(seen.experiment, seen.row, seen.response, strict=True)
    ]
    owner = tuple(table.ids[l] for l in seen.experiment)
    return Single(runner, tuple(names), owner, runner.unit, runner.column)


def one_each(runner: Runner) -> bool:
    """Whether each run serves an experiment and gives one value: nothing to be told apart."""
    return runner.units == len(runner.ids) and bool(
        np.array_equal(runner.unit, np.arange(runner.units))
    )


def _places(experiment: Indices) -> Indices:
    """Where each row stands in its experiment, from 0."""
    order = np.argsort(experiment, kind="stable")
    sizes = np.bincount(experiment)
    place = np.empty(len(experiment), dtype=np.intp)
    place[order] = np.arange(len(experiment)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return place


def _name(owner: str, row: int | None, response: str | None) -> str:
    parts = [owner, *([f"row {row}"] if row else []), *([response] if response else [])]
    return ", ".join(parts)
