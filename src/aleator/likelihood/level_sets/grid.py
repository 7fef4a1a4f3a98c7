"""Level sets of the simulated outcome (where it equals the measured one), found on a grid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from aleator.core.types import Array, Indices
from aleator.likelihood.level_sets import bands
from aleator.likelihood.level_sets.bands import BANDS, BandSettings
from aleator.likelihood.level_sets.cells import CELLS, At, CellSettings, crossed
from aleator.simulators.response_functions import Divisible


@dataclass(frozen=True)
class GridSettings:
    """Settings for grids: whether a grid is fine enough for a law, and how much is in memory.

    The values are chosen by judgement. `share`: the smallest share of a grid's cells that each part
    of a law (between neighboring quantiles) must have for the grid to be used. `narrow`: a part
    narrower than this share of the law's width needs no cells, because the law ends there.
    `least_change`: the smallest share of an outcome's changes that is assumed along each side of
    the grid. `block`: the number of simulated values that are processed together. `kept`: the
    number of simulated values on grids that are stored for other outcomes. `cells` and `bands`: the
    settings of cells, and of bands.
    """

    share: float = 0.09
    narrow: float = 1e-3
    least_change: float = 1e-3
    block: int = 250_000
    kept: int = 8_000_000
    cells: CellSettings = CELLS
    bands: BandSettings = BANDS


GRIDS = GridSettings()


class Values:
    """A store of the simulated values on the last grids; they do not depend on the outcomes."""

    def __init__(self, settings: GridSettings = GRIDS) -> None:
        self._most, self._settings = settings.kept, settings
        self._known: list[tuple[tuple[Array, ...], Array]] = []
        self._first: dict[int, Values] = {}

    def first(self, outcomes: int) -> Values:
        """The store for the first `outcomes` of each experiment alone."""
        return self._first.setdefault(outcomes, Values(self._settings))

    def of(self, sides: tuple[Array, ...]) -> Array | None:
        """The stored values (U, P) on the grid with these sides, or None."""
        for known, values in self._known:
            if all(np.array_equal(a, b) for a, b in zip(known, sides, strict=True)):
                return values
        return None

    def keep(self, sides: tuple[Array, ...], values: Array) -> None:
        """Store the values on a grid, and forget the oldest grids if there are too many values."""
        known = [*self._known, (sides, values)]
        while known and sum(one.size for _, one in known) > self._most:
            known = known[1:]
        self._known = known


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid in one or two parameters, on which level sets of the outcome are sought.

    `response` is the simulator or its surfaces, for all distinct conditions. `condition` (N,) is
    the number of each experiment's condition. `sides` has rising values (C + 1,) of each parameter
    in `scattered`; all other parameters have their values in `x` (n,). `alike` is the relative
    error of a slope up to which a cell is not halved; see `crossed`. `values` stores the simulated
    values on earlier grids.
    """

    response: Divisible
    condition: Indices
    scattered: tuple[int, ...]
    sides: tuple[Array, ...]
    x: Array
    alike: float
    values: Values = field(default_factory=Values)
    settings: GridSettings = GRIDS

    def serves(self, marks: Array, classes: int = 1) -> bool:
        """Whether this grid is fine enough for a law with rising quantiles `marks` (s, Q).

        The quantiles must lie inside the grid, with enough cells between any two of them. If the
        law is one of several `classes` of a mixture, these share the cells.
        """
        for side, own in zip(self.sides, marks, strict=True):
            if own[0] < side[0] or side[-1] < own[-1]:
                return False
            wide = np.diff(own) > self.settings.narrow * (own[-1] - own[0])
            cells = np.diff(np.searchsorted(side, own))
            if np.any(cells[wide] < self.settings.share / classes * (side.size - 1)):
                return False
        return True

    def traced(self, y: Array, condition: Indices) -> tuple[Array, Array]:
        """Points (N, K, n) and log weights (N, K) on the level sets {x: eta_l(x) = y_l} of y (N,).

        int p(x) delta(eta_l(x) - y_l) dx = sum_k w_lk p(x_lk). The sets are found in the intervals
        or triangles of the grid, from the outcomes and slopes at the corners (see `crossed`). Cells
        are halved where the outcome is not smooth. `condition` (N,) is the number of the condition
        of each outcome. Cost: the response of each condition at all points.
        """
        found = [
            crossed(
                rows, y[rows], own, eta, self.sides, self._at(condition), self.alike,
                self.settings.cells,
            )
            for rows, own, eta in self._simulated(condition)
        ]  # fmt: skip
        return self._in_rows(y.size, found)

    def enclosed(self, ends: Array, condition: Indices, pieces: int) -> tuple[Array, Array]:
        """Points (R, K, n) and log weights (R, K) in the bands {x: lower_r <= eta(x) <= upper_r}.

        int_band p(x) dx = sum_k w_rk p(x_rk). `ends` (2, R) are the bounds, and `condition` (R,) is
        the number of the condition of each band. `pieces` is the least number of blocks along a
        side; see `bands`. Cost: that of `traced`, whose values are used again.
        """
        found = [
            bands.enclosed(
                rows, ends[:, rows], own, eta, self.sides, self._at(condition), self.alike,
                pieces, self.settings.bands, self.settings.cells,
            )
            for rows, own, eta in self._simulated(condition)
        ]  # fmt: skip
        return self._in_rows(condition.size, found)

    def changes(self) -> Array:
        """The change of the outcome along each side (s,) of the grid, relative to all sides.

        A change is the sum of the absolute differences between neighboring points. The shares are
        averaged over the experiments by the geometric mean. Cost: the response at all points.
        """
        shape = tuple(side.size for side in self.sides)
        simulated = self._simulated(self.condition)
        eta = np.concatenate([part[condition] for _, condition, part in simulated])
        eta = np.where(np.isfinite(eta), eta, np.nan)
        by_side = [
            np.nansum(np.abs(np.diff(eta.reshape(-1, *shape), axis=1 + i)).reshape(len(eta), -1), 1)
            for i in range(len(shape))
        ]
        whole = np.maximum(np.sum(by_side, axis=0), np.finfo(np.float64).tiny)
        shares = np.maximum(by_side / whole, self.settings.least_change)
        return np.asarray(np.exp(np.mean(np.log(shares), axis=1)))

    def _at(self, condition: Indices) -> At:
        """The outcomes (R,) of rows with these conditions at values (R, s) of the parameters."""

        def at(rows: Indices, scattered: Array) -> Array:
            return self.response.at(condition[rows], self._x(scattered))

        return at

    def _in_rows(
        self, count: int, found: list[tuple[Indices, Array, Array]]
    ) -> tuple[Array, Array]:
        owner, on, weight = (np.concatenate(part) for part in zip(*found, strict=True))
        with np.errstate(divide="ignore"):
            return in_rows(count, owner, self._x(on), np.log(weight))

    def _x(self, scattered: Array) -> Array:
        """All parameters (R, n) at values (R, s) of those of the grid."""
        x = np.tile(self.x, (len(scattered), 1))
        x[:, [*self.scattered]] = scattered
        return x

    @property
    def _points(self) -> Array:
        """All points (P, n) of the grid."""
        corners = np.meshgrid(*self.sides, indexing="ij")
        return self._x(np.stack([part.ravel() for part in corners], axis=1))

    def _simulated(self, condition: Indices) -> Iterator[tuple[Indices, Indices, Array]]:
        """Blocks of the rows with these conditions: rows (B,), conditions (B,), outcomes (C, P).

        A block has C conditions, as many as fit into memory, and numbers them from zero.
        """
        count, points = int(self.condition.max()) + 1, self._points
        block, known = max(1, self.settings.block // len(points)), self.values.of(self.sides)
        made = list[Array]()
        for first in range(0, count, block):
            own = np.arange(first, min(first + block, count))
            eta = self.response.take(own).evaluate(points) if known is None else known[own]
            if known is None and count * len(points) <= self.settings.kept:
                made.append(eta)
            rows = np.flatnonzero((first <= condition) & (condition < first + block))
            for part in np.array_split(rows, -(-rows.size // block)) if rows.size else ():
                yield part, condition[part] - first, eta
        if made:
            self.values.keep(self.sides, np.concatenate(made))


def in_rows(count: int, owner: Indices, x: Array, log_weight: Array) -> tuple[Array, Array]:
    """Points (N, K, n) and log weights (N, K), with one row for each of `count` experiments.

    They are arranged from points x (H, n) with log weights (H,) in any order; `owner` (H,) is the
    experiment of each. Rows with fewer points are filled up with points of weight zero.
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
