"""The way without surfaces: the simulator is run at the nodes of every law."""

from __future__ import annotations

from dataclasses import dataclass

from aleator.inference.information import Inference
from aleator.tasks.refinement.interface import Refined, Refinement
from aleator.types import Array


@dataclass(frozen=True)
class Collocated(Refinement):
    """The simulator runs where the law is in each evaluation: there is nothing to refine."""

    def search(self, _seed: int) -> Refined:
        """The answer of one search."""
        with self.stage("preparation"):
            problem = self._prepared(self.model.inputs.box, None)
        return Refined(problem, self.full(problem, []), None)

    def resumed(self, _refined: Refined) -> Refined:
        """The answer of one search: no run is kept in surfaces."""
        return self.search(0)

    def hold(self, _refined: Refined, _inference: Inference, _intervals: Array) -> None:
        """There is no region that could be too narrow."""
