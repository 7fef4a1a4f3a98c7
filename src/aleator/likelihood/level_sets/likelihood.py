"""The log-likelihood without noise, from level sets of the response.

Level sets on a grid serve for all laws that the grid resolves; sets on lines are found for one law.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.laws import Hyperparameter
from aleator.laws.classes import separated
from aleator.laws.images import image_at
from aleator.laws.inputs import Inputs
from aleator.laws.mixture import Mixture
from aleator.likelihood.individual.parameters import distance, moving, scattered_density
from aleator.likelihood.level_sets import band_lines, curves, lines
from aleator.likelihood.level_sets.bands import Points
from aleator.likelihood.level_sets.curves import CURVES, CurveSettings
from aleator.likelihood.level_sets.grid import GRIDS, Grid, GridSettings, Values, in_rows
from aleator.likelihood.level_sets.lines import CROSSINGS, Crossings
from aleator.likelihood.level_sets.sets import JoinedSets, LevelSets, Sets, filled
from aleator.search.interface import LogLikelihood
from aleator.simulators.response_functions import Divisible


@dataclass(frozen=True)
class LevelSettings:
    """Settings of level sets: how fine grids and lines are, where they lie, how many are stored.

    The values are chosen by judgement, except `alike`, which `benchmarks folds` measures.

    `cells` and `fewest_cells`: the usual and, for very many experiments, the smallest number of
    grid cells per parameter for a reported result. Each has two numbers: for one scattering
    parameter and for two. A search uses half as many cells. `lines` and `fewest_lines`: the usual
    and the smallest number of lines per experiment, for more than two parameters. `values`: the
    number of response values on all grid points, or on all lines, above which fewer cells or lines
    are used. `together`: the number of cells, and of steps along a curve, for several outcomes of
    an experiment. `near`: the distance of laws up to which the sets of several outcomes serve; see
    `distance`. `alike`: the relative error of a slope up to which a cell is not halved, for a
    reported result; in a search it is twice as large, so that the difference of both shows the
    error of the result. `reach`: the largest standard normal variate of the grid of a law, whose
    points are evenly spaced in this variate. `marks`: standard normal variates between which a grid
    must have enough cells to be used for a law. `widths`: a law that fills a region has this number
    of standard deviations in the region's width. `grids` and `laws`: the largest numbers of grids,
    and of laws with their sets on lines, that are stored. `points`: the number of points of all
    sets above which fewer are stored; 20 million are half a gigabyte for two parameters. `step`:
    the step for differences of the log-likelihood, relative to the range of a hyperparameter.
    `looks`: the number of points per side at which outcomes are simulated before a grid is made.
    `uneven`: the largest factor by which a grid may have more cells along one side and fewer along
    the other. `slim`: the smallest number of cells along a side. `grid`, `crossings` and `curves`:
    the settings of grids, of lines, and of several outcomes.
    """

    cells: tuple[int, int] = (16384, 96)
    fewest_cells: tuple[int, int] = (1024, 64)
    lines: int = 64
    fewest_lines: int = 16
    values: int = 8_000_000
    together: int = 64
    near: float = 1.0
    alike: float = 0.002
    reach: float = 7.0
    marks: tuple[float, ...] = (-5.0, -3.0, -1.0, 1.0, 3.0, 5.0)
    widths: float = 6.0
    grids: int = 64
    laws: int = 8
    points: int = 20_000_000
    step: float = 1e-4
    looks: int = 9
    uneven: float = 4.0
    slim: int = 16
    grid: GridSettings = GRIDS
    crossings: Crossings = CROSSINGS
    curves: CurveSettings = CURVES


LEVELS = LevelSettings()
Key = TypeVar("Key")
BY_LEVEL_SETS = "level sets"
"""The name of a likelihood by level sets in a result."""


def traceable(inputs: Inputs) -> bool:
    """Whether level sets can be used: parameters scatter, with the same laws in all experiments.

    A mixture with a point is excluded, because it has no density.
    """
    pointed = any(isinstance(law, Mixture) and law.points for law in inputs.laws.values())
    return inputs.scattering > 0 and not pointed and not inputs.regressed


def on_a_grid(inputs: Inputs, outcomes: int = 1) -> bool:
    """Whether level sets are found on a grid that serves for many laws.

    This needs one outcome of an experiment, and one or two scattering parameters whose possible
    values do not depend on alpha.
    """
    return outcomes == 1 and 1 <= inputs.scattering <= 2 and not moving(inputs)


def searched(
    inputs: Inputs, conditions: int, outcomes: int = 1, settings: LevelSettings = LEVELS
) -> int:
    """The number of grid cells per parameter, or of lines per experiment, for a search."""
    answers = cells_of(inputs, conditions, outcomes, settings)
    lines = outcomes == 1 and not on_a_grid(inputs)
    return answers // 4 if lines else answers // 2


def cells_of(
    inputs: Inputs, conditions: int, outcomes: int = 1, settings: LevelSettings = LEVELS
) -> int:
    """The number of grid cells per parameter, or of lines per experiment, for a reported result."""
    if outcomes > 1:
        return settings.together
    if not on_a_grid(inputs):
        of_line = settings.crossings.steps + 1 + settings.crossings.halvings
        affordable = settings.values // (of_line * conditions)
        return int(np.clip(affordable, settings.fewest_lines, settings.lines))
    scattering = inputs.scattering
    affordable = int((settings.values / conditions) ** (1.0 / scattering))
    fewest, most = (each[scattering - 1] for each in (settings.fewest_cells, settings.cells))
    return min(max(affordable, fewest), most)


class LevelLikelihood:
    """The log-likelihood of outcomes y (N, m) as a function of alpha (K,); see `LevelSets`.

    Each experiment has m outcomes. One outcome may be censored: `bounds` (2, N) are then the lower
    and the upper bound of each experiment's outcome, equal where it is exact; None if all are
    exact. With one outcome, the first grid covers the whole `region`
    (n, 2) evenly. For a law that is too narrow for it, a new grid is made of quantiles of the law.
    An outcome without a level set on that grid keeps the set on the first grid. With several
    outcomes, the sets of a law also serve for laws near it. Only sets are stored between calls;
    they affect the value only through their fineness. `response` is the simulator or its surfaces
    for all distinct outcomes, and `condition` (N, m) is the number of each outcome in it; with one
    outcome both may be (N,).
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
        bounds: Array | None = None,
    ) -> None:
        self.inputs, self.response, self.region = inputs, response, region
        self.condition, self.outcomes, self.cells = condition, outcomes, cells
        self.bounds = bounds
        self.each = 1 if outcomes.ndim == 1 else outcomes.shape[1]
        self.settings = settings
        self._values = values or Values(settings.grid)
        self._known: list[tuple[Grid, Sets]] = []
        self._last: list[tuple[Array, Sets]] = []

    @property
    def name(self) -> str:
        """The name in reports."""
        return BY_LEVEL_SETS

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha."""
        return self.inputs.hyperparameters

    @property
    def continued(self) -> LevelLikelihood:
        """The objective of a search: a copy of this likelihood that stores its own grids."""
        return copy(self)

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood at alpha (K,) with its score.

        The score by the value of a constant, or by hyperparameters that move the support of a law,
        is a central difference.
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
        """The log-likelihood at alpha (K,) without its score."""
        return self.sets(alpha).evaluate(alpha)

    def sets(self, alpha: Array) -> Sets:
        """The level sets from which the likelihood of the law alpha (K,) is computed."""
        return self._of_grid(alpha) if self._on_a_grid else self._of_lines(alpha)

    def _of_grid(self, alpha: Array) -> Sets:
        settings, classes = self.settings, separated(self.inputs, alpha)
        marks = [_quantiles(*one[:2], np.array(settings.marks)) for one in classes]

        def serves(grid: Grid) -> bool:
            return all(grid.serves(each, len(classes)) for each in marks)

        if serves(self._whole):
            return self._everywhere
        for grid, sets in self._known:
            if serves(grid):
                return sets
        theta = np.linspace(-settings.reach, settings.reach, self.cells + 1)
        sides = np.concatenate([_quantiles(*one[:2], theta) for one in classes], axis=1)
        grid = self._grid(np.sort(sides, axis=1))
        sets = self._traced(grid, len(classes))
        if sets.empty.any():
            sets = filled(sets, self._everywhere)
        self._known = _stored([*self._known, (grid, sets)], settings.grids, settings.points)
        return sets

    def _of_lines(self, alpha: Array) -> Sets:
        """The level sets that are found for this law; stored for the last laws.

        Those of several outcomes also serve for laws near it.
        """
        inputs, settings = self.inputs, self.settings
        wide = self.each > 1 and len(inputs.classes) == 1 and not moving(inputs)
        for known, sets in self._last:
            same = np.array_equal(known, alpha)
            if same or (wide and distance(inputs, (), known, alpha) < settings.near):
                return sets
        sets = self._laid(alpha)
        if sets.empty.any():
            sets = filled(sets, self._everywhere)
        last = [*self._last, (alpha.copy(), sets)]
        self._last = _stored(last, settings.laws, settings.points)
        return sets

    def _laid(self, alpha: Array) -> Sets:
        """The sets of this law, which are those of all its classes together."""
        cells, settings = self.cells, self.settings

        def traced(rows: Indices | slice) -> LevelSets:
            seen = self.response, self.condition[rows], self.outcomes[rows], cells

            def of_law(inputs: Inputs, own: Array) -> Points:
                if self.each > 1:
                    return curves.traced(inputs, own, *seen, settings.curves)
                return lines.traced(inputs, own, *seen, settings.crossings)

            return self._of_classes(alpha, len(seen[2]), of_law)

        def enclosed(ends: Array, condition: Indices) -> LevelSets:
            seen = self.response, condition, ends, cells, settings.crossings

            def of_law(inputs: Inputs, own: Array) -> Points:
                return band_lines.enclosed(inputs, own, *seen)

            return self._of_classes(alpha, condition.size, of_law)

        return traced(np.s_[:]) if self.bounds is None else self._joined(traced, enclosed)

    def _of_classes(
        self, alpha: Array, count: int, of_law: Callable[[Inputs, Array], Points]
    ) -> LevelSets:
        """The sets of `count` experiments or bands, from the points `of_law` of each class."""
        parts = []
        for inputs, own, log_share in separated(self.inputs, alpha):
            owner, x, log_weight = of_law(inputs, own)
            if inputs is not self.inputs:
                # Each point counts for the share of its class in the density there.
                log_weight += log_share + scattered_density(inputs, own, x)
                log_weight -= scattered_density(self.inputs, alpha, x)
            parts.append((owner, x, log_weight))
        every = [np.concatenate(part) for part in zip(*parts, strict=True)]
        return LevelSets(self.inputs, *in_rows(count, *every))

    def values(self, alphas: Array) -> Array:
        """The total log-likelihoods (A,) at alphas (A, K)."""
        return np.array([self.evaluate(alpha).total for alpha in alphas])

    def take(self, rows: Indices) -> LevelLikelihood:
        """The likelihood of the experiments `rows` alone."""
        condition = self.condition[rows]
        own, place = np.unique(condition, return_inverse=True)
        return LevelLikelihood(
            self.inputs, self.response.take(own), self.region, place.reshape(condition.shape),
            self.outcomes[rows], self.cells, settings=self.settings,
            bounds=None if self.bounds is None else self.bounds[:, rows],
        )  # fmt: skip

    def with_outcomes(self, outcomes: Array, bounds: Array | None = None) -> LevelLikelihood:
        """The likelihood of the same experiments with other outcomes (N m,) and bounds (2, N)."""
        return self._with(outcomes.reshape(self.outcomes.shape), self.cells, bounds)

    def first(self, outcomes: int) -> LevelLikelihood:
        """The likelihood of the first `outcomes` of each experiment, on grids for a search."""
        condition = self.condition[:, :outcomes]
        own, place = np.unique(condition, return_inverse=True)
        some = self.outcomes[:, 0] if outcomes == 1 else self.outcomes[:, :outcomes]
        return LevelLikelihood(
            self.inputs, self.response.take(own), self.region, place.reshape(some.shape), some,
            searched(self.inputs, own.size, outcomes, self.settings),
            self._values.first(outcomes), self.settings,
        )  # fmt: skip

    def probabilities(self, alpha: Array, first: Array) -> Array:
        """P(y_k below the measured one | y_1, ..., y_(k-1), alpha) of all outcomes (N, m).

        This is Rosenblatt's transform (1952): under the right law the probabilities are independent
        and uniform. Those of the outcomes number one are given as `first` (N,). The others are
        shares of the level set of the earlier outcomes, on which the outcome is simulated.
        """
        found = [first]
        for k in range(1, self.each):
            sets = self.first(k).sets(alpha)
            assert isinstance(sets, LevelSets)
            share = sets.shares(alpha)
            rows, point = np.nonzero(share)
            value = np.full(share.shape, np.nan)
            value[rows, point] = self.response.at(self.condition[rows, k], sets.x[rows, point])
            found.append(_below(self.outcomes[:, k], value, share))
        return np.stack(found, axis=1)

    def coarse(self, times: int = 2) -> LevelLikelihood:
        """This likelihood on coarser grids, with 1/`times` of the cells per parameter.

        Half as many cells serve for a search and for simulated experiments. Other numbers show how
        much the number of cells changes the result.
        """
        return self._with(self.outcomes, max(self._answers // times, 1), self.bounds)

    def coarsest(self) -> LevelLikelihood:
        """This likelihood on the coarsest acceptable grids, for the analysis of many data sets."""
        few = searched(self.inputs, int(self.condition.max()) + 1, self.each, self.settings)
        if self._on_a_grid:
            few = min(few, self.settings.fewest_cells[self.inputs.scattering - 1])
        return self._with(self.outcomes, few, self.bounds)

    def fine(self) -> LevelLikelihood:
        """This likelihood on the fine grids that are used for reported results."""
        return self._with(self.outcomes, self._answers, self.bounds)

    @property
    def unreached(self) -> Flags:
        """Flags (N,) of the outcomes that the response does not reach anywhere in the region."""
        return self._everywhere.empty

    @cached_property
    def _everywhere(self) -> Sets:
        """The level sets on the first grid, or on lines that cover the whole region."""
        if self._on_a_grid:
            return self._traced(self._whole)
        return self._laid(self.inputs.filling(self.region, self.settings.widths))

    @property
    def _on_a_grid(self) -> bool:
        return on_a_grid(self.inputs, self.each)

    @cached_property
    def _whole(self) -> Grid:
        """The first grid, which covers the whole region evenly."""
        own = self.region[[*self.inputs.scattered]]
        return self._grid(np.linspace(own[:, 0], own[:, 1], self.cells + 1, axis=1))

    @property
    def _answers(self) -> int:
        return cells_of(self.inputs, int(self.condition.max()) + 1, self.each, self.settings)

    def _with(self, outcomes: Array, cells: int, bounds: Array | None) -> LevelLikelihood:
        """This likelihood with other outcomes and cells, which shares the stored responses."""
        return LevelLikelihood(
            self.inputs, self.response, self.region, self.condition, outcomes, cells, self._values,
            self.settings, bounds,
        )  # fmt: skip

    def _grid(self, sides: Array) -> Grid:
        """A grid with these sides (s, C + 1).

        If it has two sides, more of the cells go to the side along which outcomes change more.
        """
        if len(sides) == 1:
            return self._on(sides)
        few = np.linspace(0, sides.shape[1] - 1, self.settings.looks).astype(np.intp)
        changes = self._on(sides[:, few]).changes()
        return self._on(_shared(sides, float(changes[0] / changes[1]), self.settings))

    def _on(self, sides: Iterable[Array]) -> Grid:
        each = tuple(np.unique(side) for side in sides)
        alike = self.settings.alike * max(1.0, self._answers / self.cells)
        return Grid(
            self.response, self.condition, self.inputs.scattered, each, self.region[:, 0], alike,
            self._values, self.settings.grid,
        )  # fmt: skip

    def _traced(self, grid: Grid, classes: int = 1) -> Sets:
        """The sets on a grid, whose cells the `classes` of a mixture share."""
        if self.bounds is None:
            return LevelSets(self.inputs, *grid.traced(self.outcomes, self.condition))
        whole = grid.settings.bands.pieces * classes
        # Across its ridge the law of correlated parameters is narrower than along each of them.
        pieces = max(side.size for side in grid.sides) if self.inputs.correlated else whole

        def traced(rows: Indices) -> LevelSets:
            found = grid.traced(self.outcomes[rows], self.condition[rows])
            return LevelSets(self.inputs, *found)

        def enclosed(ends: Array, condition: Indices) -> LevelSets:
            return LevelSets(self.inputs, *grid.enclosed(ends, condition, pieces))

        return self._joined(traced, enclosed)

    def _joined(
        self,
        traced: Callable[[Indices], LevelSets],
        enclosed: Callable[[Array, Indices], LevelSets],
    ) -> JoinedSets:
        """The sets of exact outcomes, by their rows, and the bands of all distinct bounds."""
        assert self.bounds is not None
        exact = self.bounds[0] == self.bounds[1]
        parts, place = list[LevelSets](), np.empty(exact.size, dtype=np.intp)
        if exact.any():
            parts.append(traced(np.flatnonzero(exact)))
            place[exact] = np.arange(np.count_nonzero(exact))
        if not exact.all():
            each = np.vstack([self.condition[~exact], self.bounds[:, ~exact]])
            bands, own = np.unique(each, axis=1, return_inverse=True)
            parts.append(enclosed(bands[1:], bands[0].astype(np.intp)))
            place[~exact] = np.count_nonzero(exact) + own.ravel()
        return JoinedSets(self.inputs, tuple(parts), place)


def _stored(known: list[tuple[Key, Sets]], most: int, points: int) -> list[tuple[Key, Sets]]:
    """The last of the known sets: at most `most`, with at most so many points, but at least one."""
    known = known[-most:]
    while len(known) > 1 and sum(sets.size for _, sets in known) > points:
        known = known[1:]
    return known


def _below(y: Array, value: Array, share: Array) -> Array:
    """P(value < y) for y (N,), with values (N, K) of probabilities `share` (N, K).

    The distribution function is linear between neighboring values; NaN where none is known.
    """
    share = np.where(np.isfinite(value), share, 0.0)
    order = np.argsort(np.where(share > 0.0, value, np.inf), axis=1)
    value, share = (np.take_along_axis(each, order, axis=1) for each in (value, share))
    with np.errstate(invalid="ignore"):
        share = share / share.sum(axis=1, keepdims=True)
    level = np.cumsum(share, axis=1) - 0.5 * share
    found = np.full(y.size, np.nan)
    for l, known in enumerate((share > 0.0).sum(axis=1)):
        if known:
            ends = 0.5 * level[l, 0], 0.5 + 0.5 * level[l, known - 1]
            own = value[l, :known], level[l, :known]
            found[l] = np.interp(y[l], *own, left=ends[0], right=ends[1])
    return found


def _quantiles(inputs: Inputs, alpha: Array, theta: Array) -> Array:
    """The values (s, Q) of the s scattering parameters at standard normal variates (Q,)."""
    own = inputs.slices
    return np.stack([image_at(inputs, i, alpha[own[i]], theta) for i in inputs.scattered])


def _shared(sides: Array, ratio: float, settings: LevelSettings = LEVELS) -> tuple[Array, Array]:
    """Two sides with the same number of cells in total, shared by the changes of the outcome.

    The outcomes change `ratio` times as much along the first side as along the second. With the new
    sides they change about equally from cell to cell in both directions.

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
