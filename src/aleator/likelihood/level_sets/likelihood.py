"""The log-likelihood without noise by the simulator itself, on grids as fine as the laws."""

from __future__ import annotations

import numpy as np

from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.laws.tabulated import image_at
from aleator.likelihood.individual.parameters import holds
from aleator.likelihood.level_sets.grid import Grid
from aleator.likelihood.level_sets.sets import LevelSets
from aleator.search.value import LogLikelihood
from aleator.surrogates.responses import Run
from aleator.types import Array, Indices

CELLS, FEW = {1: 16384, 2: 256}, {1: 4096, 2: 64}
"""Cells of a grid for an answer and for a search, by how many parameters scatter.

In two parameters the first cost half a second for 60 experiments, the second 20 ms, and were off
by 0.003 and 0.05 in the log-likelihood of a front of half a standard deviation.
"""
REACH = 7.0
"""Standard normal variates to which the grid of a law goes, even steps apart."""
MARKS = np.array([-5.0, -3.0, -1.0, 1.0, 3.0, 5.0])
"""Variates between which a grid must have cells to serve a law."""
KNOWN = 64
"""Grids that are remembered."""


def traceable(inputs: Inputs) -> bool:
    """Whether level sets serve these laws: one or two scatter, and nothing else is identified."""
    return inputs.scattering in CELLS and holds(inputs, 0)


class LevelLikelihood:
    """The log-likelihood of N outcomes y (N,) as a function of alpha (K,); see `LevelSets`.

    The first grid is even and all of the inputs' box. A law that it does not resolve has a grid of
    its own quantiles; an outcome that is not reached on that one has the set of the first.
    The grids are all that is remembered: a value depends on them by their fineness only.
    `run(index (R,), x (R, n))` runs the distinct conditions, of which `condition` (N,) are those of
    the experiments.
    """

    def __init__(
        self, inputs: Inputs, run: Run, condition: Indices, outcomes: Array, cells: int
    ) -> None:
        self.inputs, self.run, self.condition = inputs, run, condition
        self.outcomes, self.cells = outcomes, cells
        box = inputs.box[[*inputs.scattered]]
        whole = self._grid(np.linspace(box[:, 0], box[:, 1], cells + 1, axis=1))
        self._known = [(whole, self._traced(whole))]

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of alpha, in its order."""
        return self.inputs.hyperparameters

    @property
    def continued(self) -> LevelLikelihood:
        """What a search climbs: the same."""
        return self

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood with its score."""
        return self._sets(alpha)(alpha)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood without its score."""
        return self._sets(alpha).evaluate(alpha)

    def values(self, alphas: Array) -> Array:
        """Totals (A,) at alphas (A, K)."""
        return np.array([self.evaluate(alpha).total for alpha in alphas])

    def take(self, rows: Indices) -> LevelLikelihood:
        """That of some of the experiments."""
        own, condition = np.unique(self.condition[rows], return_inverse=True)
        run = self.run
        return LevelLikelihood(
            self.inputs, lambda index, x: run(own[index], x), condition, self.outcomes[rows],
            self.cells,
        )  # fmt: skip

    def given(self, outcomes: Array) -> LevelLikelihood:
        """The same experiments with other outcomes (N,)."""
        return LevelLikelihood(self.inputs, self.run, self.condition, outcomes, self.cells)

    def drawn(self, alpha: Array, rng: np.random.Generator) -> Array:
        """Outcomes (N,) of the same experiments under the law alpha: a run of each."""
        x = self.inputs.sample(alpha, rng.random((self.condition.size, len(self.inputs.names))))
        return self.run(self.condition, x)

    def coarse(self) -> LevelLikelihood:
        """The same on grids of fewer cells: for a search, and for experiments that are drawn."""
        few = FEW[self.inputs.scattering]
        return LevelLikelihood(self.inputs, self.run, self.condition, self.outcomes, few)

    def _sets(self, alpha: Array) -> LevelSets:
        marks = self._values(alpha, MARKS)
        for grid, sets in self._known:
            if grid.serves(marks):
                return sets
        grid = self._grid(self._values(alpha, np.linspace(-REACH, REACH, self.cells + 1)))
        first, *others = self._known
        sets = self._traced(grid).filled(first[1])
        self._known = [first, *others[2 - KNOWN :], (grid, sets)]
        return sets

    def _values(self, alpha: Array, theta: Array) -> Array:
        """Values (s, Q) of each parameter that scatters at standard normal variates (Q,)."""
        own = self.inputs.slices
        return np.stack([
            image_at(self.inputs, i, alpha[own[i]], theta) for i in self.inputs.scattered
        ])  # fmt: skip

    def _grid(self, sides: Array) -> Grid:
        known = self.inputs.box[:, 0]
        each = tuple(np.unique(side) for side in sides)
        return Grid(self.run, self.condition, self.inputs.scattered, each, known)

    def _traced(self, grid: Grid) -> LevelSets:
        return LevelSets(self.inputs, *grid.traced(self.outcomes))
