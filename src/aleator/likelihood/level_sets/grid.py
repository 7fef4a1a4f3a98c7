"""Where a simulator without noise gives just what was measured: points of a grid's cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from aleator.core.types import Array, Indices
from aleator.likelihood.level_sets.cells import CELLS, CellSettings, crossed
from aleator.simulators.response_functions import Divisible


@dataclass(frozen=True)
class GridSettings:
    """When a grid serves a law, and how much of it is in memory; chosen by judgement.

    `share`: share of a grid's cells that each part of a law must have for the grid to serve.
    `narrow`: share of the width of a law below which a part of it needs no cells: it ends there.
    `least_change`: share of its changes that an outcome has along each side, at least. `block`:
    simulated values of the grid that are looked at together. `kept`: simulated values of grids that
    are kept for other outcomes. `cells`: the settings of cells.
    """

    share: float = 0.09
    narrow: float = 1e-3
    least_change: float = 1e-3
    block: int = 250_000
    kept: int = 8_000_000
    cells: CellSettings = CELLS


GRIDS = GridSettings()


class Values:
    """Simulated values of the last grids of one response, whatever the outcomes are."""

    def __init__(self, settings: GridSettings = GRIDS) -> None:
        self._most = settings.kept
        self._known: list[tuple[tuple[Array, ...], Array]] = []

    def of(self, sides: tuple[Array, ...]) -> Array | None:
        """Values (U, P) on the grid with these sides; None where they are not known."""
        for known, values in self._known:
            if all(np.array_equal(a, b) for a, b in zip(known, sides, strict=True)):
                return values
        return None

    def keep(self, sides: tuple[Array, ...], values: Array) -> None:
        """Remember them, as many as may be kept."""
        known = [*self._known, (sides, values)]
        while known and sum(one.size for _, one in known) > self._most:
            known = known[1:]
        self._known = known


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid on which level sets are looked for.

    `response` is that of the distinct conditions, the simulator or surfaces; `condition` (N,) are
    those of the experiments. `sides` are rising values (C + 1,) of each of the parameters
    `scattered`, one or two; the others stay at their values in `x` (n,). `alike` is the relative
    error of a slope up to which a cell is not halved; see `crossed`. `values` are those of grids
    of this response that are known.
    """

    response: Divisible
    condition: Indices
    scattered: tuple[int, ...]
    sides: tuple[Array, ...]
    x: Array
    alike: float
    values: Values = field(default_factory=Values)
    settings: GridSettings = GRIDS

    def serves(self, marks: Array) -> bool:
        """Whether this grid resolves a law with rising quantiles `marks` (s, Q).

        The law lies inside, and between any two marks there are cells enough.
        """
        for side, own in zip(self.sides, marks, strict=True):
            if own[0] < side[0] or side[-1] < own[-1]:
                return False
            wide = np.diff(own) > self.settings.narrow * (own[-1] - own[0])
            cells = np.diff(np.searchsorted(side, own))
            if np.any(cells[wide] < self.settings.share * (side.size - 1)):
                return False
        return True

    def traced(self, y: Array) -> tuple[Array, Array]:
        """Points (N, K, n) and log weights (N, K) of the sets {x: eta_l(x) = y_l}, y (N,).

        int p(x) delta(eta_l(x) - y_l) dx = sum_k w_lk p(x_lk). The outcome is linear between the
        corners of an interval or a triangle, where a set is then a point or a straight line: an
        error of second order in the size of the cells, which are halved where the outcome is not
        smooth. Cost: the response of each condition at all points.
        """
        points = self._points
        cells = self.settings.cells
        found = [
            crossed(rows, y[rows], condition, eta, self.sides, self._at, self.alike, cells)
            for rows, condition, eta in self._simulated(points)
        ]
        owner, on, weight = (np.concatenate(part) for part in zip(*found, strict=True))
        x = np.tile(self.x, (len(on), 1))
        x[:, [*self.scattered]] = on
        with np.errstate(divide="ignore"):
            return in_rows(y.size, owner, x, np.log(weight))

    def changes(self) -> Array:
        """How much an outcome changes along each side (s,), over what it changes along all.

        The geometric mean over the experiments of the sums of all steps. Cost: all points.
        """
        shape = tuple(side.size for side in self.sides)
        simulated = self._simulated(self._points)
        eta = np.concatenate([part[condition] for _, condition, part in simulated])
        by_side = [
            np.nansum(np.abs(np.diff(eta.reshape(-1, *shape), axis=1 + i)).reshape(len(eta), -1), 1)
            for i in range(len(shape))
        ]
        whole = np.maximum(np.sum(by_side, axis=0), np.finfo(np.float64).tiny)
        shares = np.maximum(by_side / whole, self.settings.least_change)
        return np.asarray(np.exp(np.mean(np.log(shares), axis=1)))

    def _at(self, rows: Indices, scattered: Array) -> Array:
        """Outcomes (R,) of experiments `rows`, each at values (R, s) of its own."""
        x = np.tile(self.x, (len(rows), 1))
        x[:, [*self.scattered]] = scattered
        return self.response.at(self.condition[rows], x)

    @property
    def _points(self) -> Array:
        """All points of the grid, (P, n)."""
        corners = np.meshgrid(*self.sides, indexing="ij")
        points = np.tile(self.x, (corners[0].size, 1))
        points[:, [*self.scattered]] = np.stack([part.ravel() for part in corners], axis=1)
        return points

    def _simulated(self, points: Array) -> Iterator[tuple[Indices, Indices, Array]]:
        """Experiments (B,), the condition (B,) of each, and the outcomes (C, P) of C conditions.

        As many at a time as fit into memory.
        """
        count = int(self.condition.max()) + 1
        block, known = max(1, self.settings.block // len(points)), self.values.of(self.sides)
        made = list[Array]()
        for first in range(0, count, block):
            own = np.arange(first, min(first + block, count))
            eta = self.response.take(own).evaluate(points) if known is None else known[own]
            if known is None and count * len(points) <= self.settings.kept:
                made.append(eta)
            rows = np.flatnonzero((first <= self.condition) & (self.condition < first + block))
            for part in np.array_split(rows, max(1, -(-rows.size // block))):
                yield part, self.condition[part] - first, eta
        if made:
            self.values.keep(self.sides, np.concatenate(made))


def in_rows(count: int, owner: Indices, x: Array, log_weight: Array) -> tuple[Array, Array]:
    """Points (N, K, n) and log weights (N, K) of each experiment; those of no weight fill the rows.

    Of points x (H, n) with log weights (H,) in any order, and their `owner` (H,).
    """
    order = np.argsort(owner, kind="stable")
    order = order[np.isfinite(log_weight[order])]
    owner, x, log_weight = owner[order], x[order], log_weight[order]
    many = np.bincount(owner, minlength=count)
    place = np.arange(owner.size) - np.repeat(np.cumsum(many) - many, many)
    most = max(many.max(), 1)
    points = np.broadcast_to(x[:1] if len(x) else 0.0, (count, most, x.shape[1])).copy()
    found = np.full((count, most), -np.inf)
    points[owner, place] = x
    found[owner, place] = log_weight
    return points, found
