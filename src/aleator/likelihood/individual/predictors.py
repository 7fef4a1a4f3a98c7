"""Simulated values of the observations, each experiment at parameters of its own."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.types import Array, Flags, Indices
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import Surface
from aleator.surrogates.surface import chained, outcomes, products, products_with_gradient


@dataclass(frozen=True)
class PredictorSettings:
    """How much is simulated at once, and the steps of differences; chosen by judgement.

    `block`: simulated values of a block of experiments. `group`: experiments next to each other
    that a sample of them takes together. `step`: step of differences over the size of a parameter.
    `least_step`: the same over the width of its box, where the parameter is near zero. `basis`:
    numbers of one block of basis functions of surfaces.
    """

    block: int = 400_000
    group: int = 10
    step: float = 1e-6
    least_step: float = 1e-10
    basis: int = 4_000_000


PREDICTORS = PredictorSettings()


@dataclass(frozen=True, eq=False)
class Block:
    """Some experiments one after the other: B of them, with m observations.

    `owner` (m,) is the experiment of each observation, counted from the first of the block, and
    `starts` (B,) where the observations of each begin. `units` (V,) are what has to be run for
    them, `unit_owner` (V,) whose they are, and `place`, `column` (m,) say which value of which of
    these units an observation is.
    """

    experiments: slice
    rows: slice
    owner: Indices
    starts: Indices
    units: Indices
    unit_owner: Indices
    place: Indices
    column: Indices

    def __len__(self) -> int:
        return self.starts.size

    @cached_property
    def seen(self) -> Flags:
        """Which experiments have an observation (B,)."""
        return np.bincount(self.owner, minlength=len(self)) > 0

    def summed(self, values: Array) -> Array:
        """Sums (B, ...) over the observations (m, ...) of each experiment; zero without any."""
        if np.all(self.seen):
            return np.add.reduceat(values, self.starts, axis=0)
        sums = np.zeros((len(self), *values.shape[1:]))
        if np.any(self.seen):
            sums[self.seen] = np.add.reduceat(values, self.starts[self.seen], axis=0)
        return sums


@dataclass(frozen=True, eq=False)
class Layout:
    """N experiments (`count`) and their M observations, sorted by experiment.

    An experiment may have none: its likelihood is one, whatever the law. `experiment` (M,) is that
    of each observation, `unit` (M,) what a run has to be made for to give its value, and `column`
    (M,) which of the values of that run it is. `chosen` are the only experiments that count, where
    there are any.
    """

    count: int
    experiment: Indices
    unit: Indices
    column: Indices
    chosen: tuple[slice, ...] = ()
    settings: PredictorSettings = PREDICTORS
    _blocks: dict[int, tuple[Block, ...]] = field(default_factory=dict, repr=False)

    @property
    def size(self) -> int:
        """M, the number of observations."""
        return self.experiment.size

    def blocks(self, nodes: int) -> tuple[Block, ...]:
        """The experiments in blocks that fit into memory at so many nodes; made once for each."""
        widest = int(np.bincount(self.experiment, minlength=self.count).max())
        step = min(max(1, self.settings.block // (widest * nodes)), self.count)
        if step not in self._blocks:
            parts = self.chosen or (slice(0, self.count),)
            self._blocks[step] = tuple(
                self._block(first, min(first + step, part.stop))
                for part in parts
                for first in range(part.start, part.stop, step)
            )
        return self._blocks[step]

    def sampled(self, size: int) -> Layout:
        """Only about so many of the experiments, in groups that are spread evenly over all."""
        group = self.settings.group
        starts = np.linspace(0, self.count - group, max(1, size // group)).astype(int).tolist()
        chosen = tuple(slice(first, first + group) for first in dict.fromkeys(starts))
        return replace(self, chosen=chosen, _blocks={})

    def alone(self, experiment: int) -> Block:
        """One experiment by itself."""
        return self._block(experiment, experiment + 1)

    def _block(self, first: int, last: int) -> Block:
        begin, end = np.searchsorted(self.experiment, [first, last])
        rows = slice(int(begin), int(end))
        owner = self.experiment[rows] - first
        units, place = np.unique(self.unit[rows], return_inverse=True)
        unit_owner = np.empty(units.size, dtype=np.intp)
        unit_owner[place] = owner
        return Block(
            slice(first, last), rows, owner, np.searchsorted(owner, np.arange(last - first)),
            units, unit_owner, place, self.column[rows],
        )  # fmt: skip


class Evaluator(Protocol):
    """What gives simulated values: a runner (see `Runner`)."""

    def straight(self, unit: Indices, x: Array) -> Array:
        """Values (R, W) of units (R,) at parameters x (R, n)."""


class Predictor(Protocol):
    """What answers for the simulator: itself, or its surfaces."""

    def values(self, block: Block, x: Array) -> Array:
        """eta (m, J) of the m observations of a block at its experiments' parameters x (B, J, n).

        NaN where there is no value.
        """

    def with_slopes(self, block: Block, x: Array) -> tuple[Array, Array]:
        """eta (m, J), and its derivatives (n, m, J); zero by a parameter that is known."""


@dataclass(frozen=True, eq=False)
class Direct:
    """The simulator itself, for functions that cost less than a surface; slopes are central
    differences.

    `moving` are the parameters by which it is differentiated; steps stay in the box (n, 2).
    """

    runner: Evaluator
    moving: Indices
    box: Array
    settings: PredictorSettings = PREDICTORS

    def values(self, block: Block, x: Array) -> Array:
        """One evaluation a unit and node."""
        nodes = x.shape[1]
        points = x[block.unit_owner].reshape(-1, x.shape[2])
        found = self.runner.straight(np.repeat(block.units, nodes), points)
        whole = found.reshape(block.units.size, nodes, -1)
        return np.asarray(whole[block.place, :, block.column])

    def with_slopes(self, block: Block, x: Array) -> tuple[Array, Array]:
        """2 n + 1 evaluations a unit and node, in one call; slope 0 where one is not finite."""
        points, gaps = self._points(x)
        found = self.values(block, points.reshape(len(x), -1, x.shape[2]))
        parts = found.reshape(len(found), points.shape[1], -1)
        slopes = np.zeros((x.shape[2], len(found), x.shape[1]))
        for k, i in enumerate(self.moving):
            with np.errstate(invalid="ignore"):
                rise = parts[:, 1 + 2 * k] - parts[:, 2 + 2 * k]
            fine = np.isfinite(rise)
            # an infinite value, such as a life without end, stays what it is
            slopes[i] = (rise if np.all(fine) else np.where(fine, rise, 0.0)) / gaps[k][block.owner]
        return parts[:, 0], slopes

    def _points(self, x: Array) -> tuple[Array, list[Array]]:
        """x (B, J, n) and steps up and down from it (B, 2 n + 1, J, n), and how far they are apart.

        Steps stay in the box; where x is beyond it, on their side of x.
        """
        size = np.sqrt(np.mean(x**2, axis=(0, 1)))
        points = np.repeat(x[:, None], 1 + 2 * self.moving.size, axis=1)
        gaps = []
        for k, i in enumerate(self.moving):
            own, (low, high) = x[..., i], self.box[i]
            step = max(self.settings.step * size[i], self.settings.least_step * (high - low))
            up, down = points[:, 1 + 2 * k, :, i], points[:, 2 + 2 * k, :, i]
            np.minimum(own + step, np.maximum(own, high), out=up)
            np.maximum(own - step, np.minimum(own, low), out=down)
            gaps.append(up - down)
        return points, gaps


@dataclass(frozen=True, eq=False)
class OnSurfaces:
    """The values of surfaces known on a region (n, 2); beyond it those of its nearest point.

    `of` (M,) is the surface of each observation; the surfaces are in the parameters whose region
    has a width. Cost O(M J T) for T terms.
    """

    surface: Surface
    region: Array
    of: Indices
    settings: PredictorSettings = PREDICTORS

    def values(self, block: Block, x: Array) -> Array:
        """The surfaces at the experiments' points."""
        return self._evaluated(block, x, slopes=False)[0]

    def with_slopes(self, block: Block, x: Array) -> tuple[Array, Array]:
        """The surfaces and their gradients; a coordinate beyond the region has none."""
        return self._evaluated(block, x, slopes=True)

    def inward(self, x: Array) -> Array:
        """The coordinates (..., n) of the surfaces, those of the region's nearest points."""
        return self.surface.axes.inward(self._inside(x)[..., self._moving])

    def _inside(self, x: Array) -> Array:
        return np.clip(x, self.region[:, 0], self.region[:, 1])

    def _evaluated(self, block: Block, x: Array, slopes: bool) -> tuple[Array, Array]:
        inside, z = self._inside(x), self.inward(x)
        experiments, nodes, n = z.shape
        flat = z.reshape(-1, n)
        indices = self.surface.indices
        basis = products_with_gradient(indices, flat) if slopes else products(indices, flat)
        basis = basis.reshape(len(indices), -1, experiments, nodes)
        terms = self._terms[self.of[block.rows]]
        found = np.empty((basis.shape[1], len(terms), nodes))
        for rows in blocks(len(terms), len(basis) * nodes, self.settings.basis):
            own = basis[:, :, block.owner[rows]]
            found[:, rows] = np.einsum("mp,pdmj->dmj", terms[rows], own, optimize=False)
        logarithmic = self.surface.logarithmic[self.of[block.rows]]
        value = outcomes(found[0], logarithmic)
        if not slopes:
            return value, found[:0]
        chained(found[1:].swapaxes(0, 1), value, logarithmic)
        slope = np.zeros((x.shape[2], len(terms), nodes))
        rates = self.surface.axes.rates(inside[..., self._moving])
        for k, i in enumerate(self._moving):
            known = (inside[..., i] == x[..., i])[block.owner]
            own = rates[..., k][block.owner]
            slope[i] = np.where(known, found[1 + k] * own, 0.0)
        return value, slope

    @cached_property
    def _moving(self) -> Indices:
        return moving_parameters(self.region)

    @cached_property
    def _terms(self) -> Array:
        """Coefficients (U, P) of all surfaces."""
        whole = np.zeros((len(self.surface.error), len(self.surface.indices)))
        for group in self.surface.groups:
            whole[group.members, : group.size] = group.coefficients
        return whole
