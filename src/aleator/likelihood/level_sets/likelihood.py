"""The log-likelihood without noise: level sets of a response, for one law or for all near it."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs, image_at
from aleator.likelihood.individual.parameters import moving
from aleator.likelihood.level_sets.grid import GRIDS, Grid, GridSettings, Values, in_rows
from aleator.likelihood.level_sets.lines import CROSSINGS, Crossings, traced
from aleator.likelihood.level_sets.sets import LevelSets
from aleator.search.interface import LogLikelihood
from aleator.simulators.response_functions import Divisible


@dataclass(frozen=True)
class LevelSettings:
    """How fine grids and lines are, where they lie, and how many are kept.

    By judgement, but for `alike`, which `benchmarks folds` measures.

    `cells` and `fewest_cells`: cells of a parameter for an answer, of one that scatters and of two,
    of few experiments and of very many; a search goes on half as many. `lines` and `fewest_lines`:
    lines of an experiment in more than two parameters. `values`: values of the response on all grid
    points of an answer, or on all lines, above which there are fewer. `alike`: error of a slope,
    over it, up to which a cell of an answer is not halved; twice as much for a search, so that the
    difference of both is the error of an answer. `reach`: standard normal variates to which the
    grid of a law goes, even steps apart. `marks`: variates between which a grid must have cells to
    serve a law. `widths`: standard deviations that a region is wide, of laws that fill it.
    `grids` and `laws`: grids that are kept, and laws whose sets on lines are. `step`: step of
    differences of the log-likelihood over the range of a hyperparameter. `looks`: points of a side
    at which outcomes are simulated before a grid is made. `uneven`: factor by which a grid may have
    more cells along one side, and fewer along the other. `slim`: cells that a side keeps.
    `grid` and `crossings`: the settings of grids and of lines.
    """

    cells: tuple[int, int] = (16384, 96)
    fewest_cells: tuple[int, int] = (1024, 64)
    lines: int = 64
    fewest_lines: int = 16
    values: int = 8_000_000
    alike: float = 0.002
    reach: float = 7.0
    marks: tuple[float, ...] = (-5.0, -3.0, -1.0, 1.0, 3.0, 5.0)
    widths: float = 6.0
    grids: int = 64
    laws: int = 8
    step: float = 1e-4
    looks: int = 9
    uneven: float = 4.0
    slim: int = 16
    grid: GridSettings = GRIDS
    crossings: Crossings = CROSSINGS


LEVELS = LevelSettings()


def traceable(inputs: Inputs) -> bool:
    """Whether level sets serve these laws: some scatter, and are the same in all experiments."""
    return inputs.scattering > 0 and len(inputs.classes) == 1 and not inputs.regressed


def on_a_grid(inputs: Inputs) -> bool:
    """Whether sets are found once on a grid: one or two scatter, and only their density moves."""
    return 1 <= inputs.scattering <= 2 and not moving(inputs)


def searched(inputs: Inputs, conditions: int, settings: LevelSettings = LEVELS) -> int:
    """Cells of a parameter for a search, or lines of an experiment."""
    answers = cells_of(inputs, conditions, settings)
    return answers // 2 if on_a_grid(inputs) else answers // 4


def cells_of(inputs: Inputs, conditions: int, settings: LevelSettings = LEVELS) -> int:
    """Cells of a parameter for an answer, or lines of an experiment."""
    if not on_a_grid(inputs):
        of_line = settings.crossings.steps + 1 + settings.crossings.halvings
        affordable = settings.values // (of_line * conditions)
        return int(np.clip(affordable, settings.fewest_lines, settings.lines))
    scattering = inputs.scattering
    affordable = int((settings.values / conditions) ** (1.0 / scattering))
    fewest, most = (each[scattering - 1] for each in (settings.fewest_cells, settings.cells))
    return min(max(affordable, fewest), most)


class LevelLikelihood:
    """The log-likelihood of N outcomes y (N,) as a function of alpha (K,); see `LevelSets`.

    The first grid is even and all of the region. A law that it does not resolve has a grid of
    its own quantiles; an outcome that is not reached on that one has the set of the first.
    The grids are all that is remembered: a value depends on them by their fineness only.
    `response` is that of the distinct conditions on a `region` (n, 2), and `condition` (N,) are
    those of the experiments.
    """

    def __init__(
        self,
        inputs: Inputs,
        response: Divisible,
        region: Array,
        condition: Indices,
        outcomes: Array,
        cells: int,
        values: Values | None = None,
        settings: LevelSettings = LEVELS,
    ) -> None:
        self.inputs, self.response, self.region = inputs, response, region
        self.condition, self.outcomes, self.cells = condition, outcomes, cells
        self.settings = settings
        self._values = values or Values(settings.grid)
        self._known: list[tuple[Grid, LevelSets]] = []
        self._last: list[tuple[Array, LevelSets]] = []

    @property
    def name(self) -> str:
        """Name for reports."""
        return "level sets"

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of alpha, in its order."""
        return self.inputs.hyperparameters

    @property
    def continued(self) -> LevelLikelihood:
        """What a search climbs: the same, with grids of its own to remember."""
        return copy(self)

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood with its score.

        The score by a constant, or by a law whose support moves, is a difference.
        """
        found = self.sets(alpha)(alpha)
        if self._on_a_grid or not moving(self.inputs):
            return found
        assert found.scores is not None
        scores = found.scores.copy()
        for k in moving(self.inputs):
            h = self.hyperparameters[k]
            step = self.settings.step * (h.upper - h.lower)
            ends = [np.clip(alpha[k] + by, h.lower, h.upper) for by in (step, -step)]
            moved = np.tile(alpha, (2, 1))
            moved[:, k] = ends
            up, down = (self.sets(one).evaluate(one).each for one in moved)
            scores[:, k] = (up - down) / (ends[0] - ends[1])
        return replace(found, scores=scores)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood without its score."""
        return self.sets(alpha).evaluate(alpha)

    def sets(self, alpha: Array) -> LevelSets:
        """The level sets that serve for a law alpha (K,)."""
        return self._of_grid(alpha) if self._on_a_grid else self._of_lines(alpha)

    def _of_grid(self, alpha: Array) -> LevelSets:
        settings = self.settings
        marks = self._quantiles(alpha, np.array(settings.marks))
        if self._whole.serves(marks):
            return self._everywhere
        for grid, sets in self._known:
            if grid.serves(marks):
                return sets
        theta = np.linspace(-settings.reach, settings.reach, self.cells + 1)
        grid = self._grid(self._quantiles(alpha, theta))
        sets = self._traced(grid)
        if sets.empty.any():
            sets = sets.filled(self._everywhere)
        self._known = [*self._known[1 - settings.grids :], (grid, sets)]
        return sets

    def _of_lines(self, alpha: Array) -> LevelSets:
        """On lines that are laid for this law, so that they are exact where a set is smooth."""
        for known, sets in self._last:
            if np.array_equal(known, alpha):
                return sets
        sets = self._laid(alpha)
        if sets.empty.any():
            sets = sets.filled(self._everywhere)
        self._last = [*self._last[1 - self.settings.laws :], (alpha.copy(), sets)]
        return sets

    def _laid(self, alpha: Array) -> LevelSets:
        found = traced(
            self.inputs, alpha, self.response, self.condition, self.outcomes, self.cells,
            self.settings.crossings,
        )  # fmt: skip
        return LevelSets(self.inputs, *in_rows(self.outcomes.size, *found))

    def values(self, alphas: Array) -> Array:
        """Totals (A,) at alphas (A, K)."""
        return np.array([self.evaluate(alpha).total for alpha in alphas])

    def take(self, rows: Indices) -> LevelLikelihood:
        """The likelihood of some of the experiments."""
        own, condition = np.unique(self.condition[rows], return_inverse=True)
        return LevelLikelihood(
            self.inputs, self.response.take(own), self.region, condition, self.outcomes[rows],
            self.cells, settings=self.settings,
        )  # fmt: skip

    def with_outcomes(self, outcomes: Array) -> LevelLikelihood:
        """The same experiments with other outcomes (N,)."""
        return self._with(outcomes, self.cells)

    def coarse(self, times: int = 2) -> LevelLikelihood:
        """The same on grids of half as many cells: for a search, and for drawn experiments.

        Or of so many `times` fewer cells a parameter, to see what cells change.
        """
        return self._with(self.outcomes, max(self._answers // times, 1))

    def coarsest(self) -> LevelLikelihood:
        """The same as coarse as serves for many data sets in turn."""
        few = searched(self.inputs, int(self.condition.max()) + 1, self.settings)
        if self._on_a_grid:
            few = min(few, self.settings.fewest_cells[self.inputs.scattering - 1])
        return self._with(self.outcomes, few)

    def fine(self) -> LevelLikelihood:
        """The same on the grids of an answer."""
        return self._with(self.outcomes, self._answers)

    @property
    def unreached(self) -> Flags:
        """(N,) whose outcome is none of the response in the region."""
        return self._everywhere.empty

    @cached_property
    def _everywhere(self) -> LevelSets:
        """The sets on the first grid, or on lines all over the region."""
        if self._on_a_grid:
            return self._traced(self._whole)
        return self._laid(self.inputs.filling(self.region, self.settings.widths))

    @property
    def _on_a_grid(self) -> bool:
        return on_a_grid(self.inputs)

    @cached_property
    def _whole(self) -> Grid:
        """The even grid over all of the region."""
        own = self.region[[*self.inputs.scattered]]
        return self._grid(np.linspace(own[:, 0], own[:, 1], self.cells + 1, axis=1))

    @property
    def _answers(self) -> int:
        return cells_of(self.inputs, int(self.condition.max()) + 1, self.settings)

    def _with(self, outcomes: Array, cells: int) -> LevelLikelihood:
        """Other outcomes or cells of the same response, whose values on grids are shared."""
        return LevelLikelihood(
            self.inputs, self.response, self.region, self.condition, outcomes, cells, self._values,
            self.settings,
        )  # fmt: skip

    def _quantiles(self, alpha: Array, theta: Array) -> Array:
        """Values (s, Q) of each parameter that scatters at standard normal variates (Q,)."""
        own = self.inputs.slices
        return np.stack([
            image_at(self.inputs, i, alpha[own[i]], theta) for i in self.inputs.scattered
        ])  # fmt: skip

    def _grid(self, sides: Array) -> Grid:
        """A grid between sides (s, C + 1); two have their cells where the outcomes change."""
        if len(sides) == 1:
            return self._on(sides)
        few = np.linspace(0, self.cells, self.settings.looks).astype(np.intp)
        changes = self._on(sides[:, few]).changes()
        return self._on(_shared(sides, float(changes[0] / changes[1]), self.settings))

    def _on(self, sides: Iterable[Array]) -> Grid:
        each = tuple(np.unique(side) for side in sides)
        alike = self.settings.alike * max(1.0, self._answers / self.cells)
        return Grid(
            self.response, self.condition, self.inputs.scattered, each, self.region[:, 0], alike,
            self._values, self.settings.grid,
        )  # fmt: skip

    def _traced(self, grid: Grid) -> LevelSets:
        return LevelSets(self.inputs, *grid.traced(self.outcomes))


def _shared(sides: Array, ratio: float, settings: LevelSettings = LEVELS) -> tuple[Array, Array]:
    """Two sides with as many cells together, so that outcomes change alike from cell to cell.

    They change `ratio` times as much along the first. A law that is narrow beside the other has
    few cells: an outcome hardly changes along it, and what matters is where it does.

    >>> [side.size - 1 for side in _shared(np.linspace([0.0, 0.0], [1.0, 4.0], 65).T, 4.0)]
    [128, 32]
    """
    cells = sides.shape[1] - 1
    most = float(np.clip(cells / settings.slim, 1.0, settings.uneven))
    factor = float(np.clip(np.sqrt(ratio), 1.0 / most, most))
    counts = round(cells * factor), round(cells / factor)
    known = np.linspace(0.0, 1.0, cells + 1)
    first, second = (
        np.interp(np.linspace(0.0, 1.0, count + 1), known, side)
        for side, count in zip(sides, counts, strict=True)
    )
    return first, second
