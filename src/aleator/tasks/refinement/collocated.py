"""The way without surfaces: the simulator is run at the nodes of every law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.inference import diagnostics
from aleator.inference.information import Inference
from aleator.likelihood.problem import Problem
from aleator.surrogates.responses import by_calls, moving_parameters, straight
from aleator.tasks.refinement.interface import Refined, Refinement
from aleator.tasks.refinement.reach import reached, spread, support
from aleator.types import Array, Indices


@dataclass(frozen=True)
class Collocated(Refinement):
    """The simulator runs where the law is in each evaluation: there is nothing to refine."""

    def search(self, _seed: int) -> Refined:
        """The answer of one search."""
        with self.stage("preparation"):
            problem = self._prepared(self.model.inputs.box, None)
            self._require_reach(problem)
        return Refined(problem, self.full(problem, []), None)

    def hold(self, _refined: Refined, _inference: Inference, _intervals: Array) -> None:
        """There is no region that could be too narrow."""

    def _require_reach(self, problem: Problem) -> None:
        """Raise ExperimentsError for an outcome without level set that the simulator misses.

        It is sought there as with surfaces (`reached`). One between the outcomes that the
        simulator has, in the gap of a jump, is left to the diagnostics. Raises NoOutcome for an
        experiment of which no run has a value.
        """
        inputs, y = self.model.inputs, problem.outcomes
        moves, straightly = moving_parameters(inputs.box), straight(self.runner)
        whole = support(inputs)[moves]
        points = spread(whole)

        def full(x: Array) -> Array:
            every = np.tile(inputs.box[:, 0], (len(x), 1))
            every[:, moves] = x
            return every

        def run(index: Indices, x: Array) -> Array:
            return straightly(index, full(x))

        low, high, missed = np.full(y.size, -np.inf), np.full(y.size, np.inf), list[int]()
        for row in np.flatnonzero(problem.unreached).tolist():
            condition = int(problem.condition[row])
            values = run(np.full(len(points), condition), points)
            if np.isnan(values).all():
                by_calls(self.runner)(np.array([condition]), full(points[:1]))
            low[row], high[row] = np.nanmin(values), np.nanmax(values)
            if low[row] <= y[row] <= high[row]:
                continue
            side = 1.0 if y[row] > high[row] else -1.0
            start = points[np.nanargmax(side * values)]
            if reached(run, start, condition, y[row], side, whole) is None:
                missed.append(row)
        if missed:
            rows = np.array(missed)
            raise diagnostics.out_of_reach(rows, y, (low, high), self.ids)
