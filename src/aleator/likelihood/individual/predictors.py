"""Simulated values of all observations, where each experiment has its own parameters."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.types import Array, Flags, Indices
from aleator.laws.levels import Grouping
from aleator.likelihood.individual.clusters import Clusters
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import Surface
from aleator.surrogates.processes import ProcessMeans
from aleator.surrogates.surface import chained, outcomes, products, products_with_gradient


@dataclass(frozen=True)
class PredictorSettings:
    """Settings for simulated values: sizes of blocks and steps of numerical derivatives.

    The values are chosen by judgement. `block`: the largest number of simulated values of a block
    of experiments. `groups`: the number of groups of neighboring experiments, each a block, that
    make a sample of the experiments; of 10,000 experiments 40 groups took 8.7 s in place of 5.7
    (`benchmarks cost`). `step`: the step of differences, relative to the size of a parameter.
    `least_step`: the smallest step, relative to the width of the parameter's range. `basis`: the
    largest number of values in one block of basis functions of response surfaces: 0.8 MB, which a
    processor's cache holds (31 surfaces of 150 terms at 2,147 points: 14 ms, 20 ms in one block).
    """

    block: int = 400_000
    groups: int = 10
    step: float = 1e-6
    least_step: float = 1e-10
    basis: int = 100_000


PREDICTORS = PredictorSettings()


@dataclass(frozen=True, eq=False)
class Block:
    """A block of B consecutive experiments with m observations.

    `owner` (m,) is the experiment of each observation, counted from the first of the block;
    `starts` (B,) is the index of each experiment's first observation. `units` (V,) are the
    simulations that the block needs, and `unit_owner` (V,) are their experiments. An observation is
    the value `column` (m,) of the unit `place` (m,). Where experiments share parameters, `clusters`
    says which; they are whole.
    """

    experiments: slice
    rows: slice
    owner: Indices
    starts: Indices
    units: Indices
    unit_owner: Indices
    place: Indices
    column: Indices
    clusters: Clusters | None = None

    def __len__(self) -> int:
        return self.starts.size

    @property
    def independent(self) -> slice:
        """The places of the block's independent terms: experiments, or clusters of them."""
        return self.experiments if self.clusters is None else self.clusters.every

    @cached_property
    def seen(self) -> Flags:
        """Flags (B,) of the experiments that have an observation."""
        return np.bincount(self.owner, minlength=len(self)) > 0

    @cached_property
    def plain(self) -> bool:
        """Whether observation k is the first value of unit k."""
        return not self.column.any() and np.array_equal(self.place, np.arange(len(self.units)))

    def summed(self, values: Array) -> Array:
        """Sums (B, ...) of values (m, ...) over the observations of each experiment; 0 if none."""
        if np.all(self.seen):
            return np.add.reduceat(values, self.starts, axis=0)
        sums = np.zeros((len(self), *values.shape[1:]))
        if np.any(self.seen):
            sums[self.seen] = np.add.reduceat(values, self.starts[self.seen], axis=0)
        return sums


@dataclass(frozen=True, eq=False)
class Layout:
    """N experiments (`count`) and their M observations, sorted by experiment.

    An experiment without observations has the likelihood one under every law. `experiment` (M,) is
    the experiment of each observation. `unit` (M,) is the simulation that gives its value, and
    `column` (M,) is the index of the value in the result. If `chosen` has slices, only the
    experiments in them count. Where experiments share parameters, `grouping` says which, and blocks
    consist of whole clusters.
    """

    count: int
    experiment: Indices
    unit: Indices
    column: Indices
    chosen: tuple[slice, ...] = ()
    grouping: Grouping | None = None
    settings: PredictorSettings = PREDICTORS
    _blocks: dict[int, tuple[Block, ...]] = field(default_factory=dict, repr=False)

    @property
    def size(self) -> int:
        """The number M of observations."""
        return self.experiment.size

    def blocks(self, nodes: int) -> tuple[Block, ...]:
        """Blocks of experiments that fit into memory with this number of nodes; cached."""
        widest = int(np.bincount(self.experiment, minlength=self.count).max())
        step = min(max(1, self.settings.block // (widest * nodes)), self.count)
        if step not in self._blocks:
            parts = self.chosen or (slice(0, self.count),)
            self._blocks[step] = tuple(
                self._block(*ends) for part in parts for ends in self._cut(part, step)
            )
        return self._blocks[step]

    def sampled(self, size: int) -> Layout:
        """The layout with about `size` of the experiments, in groups spread evenly over all."""
        group = max(1, size // self.settings.groups)
        if self.grouping is not None:
            whole = self._cut(slice(0, self.count), group)
            few = np.linspace(0, len(whole) - 1, self.settings.groups).astype(int).tolist()
            some = tuple(slice(*whole[k]) for k in dict.fromkeys(few))
            return replace(self, chosen=some, _blocks={})
        starts = np.linspace(0, self.count - group, self.settings.groups).astype(int).tolist()
        chosen = tuple(slice(first, first + group) for first in dict.fromkeys(starts))
        return replace(self, chosen=chosen, _blocks={})

    def only(self, which: Flags) -> Layout:
        """The layout with the experiments `which` (N,) alone; they share no parameters."""
        ends = np.flatnonzero(np.diff(which, prepend=False, append=False)).reshape(-1, 2)
        return replace(self, chosen=tuple(slice(*own) for own in ends.tolist()), _blocks={})

    def alone(self, experiment: int) -> Block:
        """The block of one experiment alone, or with those among which its cluster lies."""
        first, last = experiment, experiment + 1
        if self.grouping is not None:
            ends = self._closed
            first = int(ends[np.searchsorted(ends, experiment, side="right") - 1])
            last = int(ends[np.searchsorted(ends, last)])
        return self._block(first, last)

    def _cut(self, part: slice, step: int) -> list[tuple[int, int]]:
        """First and last experiments of blocks with about `step` experiments of a part."""
        ends = np.append(np.arange(part.start, part.stop, step), part.stop)
        if self.grouping is not None:
            ends = np.unique(self._closed[np.searchsorted(self._closed, ends)])
        return [*zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]

    @cached_property
    def _closed(self) -> Indices:
        """The numbers of experiments in front of which no cluster is begun and not ended."""
        assert self.grouping is not None
        cluster = self.grouping.cluster
        last = np.zeros(cluster.max() + 1, dtype=np.intp)
        np.maximum.at(last, cluster, np.arange(cluster.size))
        reach = np.maximum.accumulate(last[cluster])
        return np.append(0, 1 + np.flatnonzero(reach == np.arange(cluster.size)))

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
            None if self.grouping is None else Clusters.of(self.grouping, slice(first, last)),
        )  # fmt: skip


class Evaluator(Protocol):
    """The part of a `Runner` that is used here: it gives simulated values."""

    def straight(self, unit: Indices, x: Array) -> Array:
        """The simulated values (R, W) of units (R,) at parameters x (R, n)."""


class Predictor(Protocol):
    """The interface that gives simulated values: the simulator itself, or response surfaces."""

    def values(self, block: Block, x: Array) -> Array:
        """Simulated values eta (m, J) of the m observations of a block.

        x (B, J, n) are J parameter points of each experiment. A value that does not exist is NaN.
        """

    def with_slopes(self, block: Block, x: Array) -> tuple[Array, Array]:
        """Simulated values eta (m, J) and their derivatives (n, m, J) by the parameters.

        The derivatives by fixed parameters are zero.
        """


@dataclass(frozen=True, eq=False)
class Direct:
    """The simulator itself, for simulators that cost less than response surfaces.

    Slopes are central differences. `moving` are the parameters by which the simulator is
    differentiated. The steps stay in the parameters' ranges `box` (n, 2).
    """

    runner: Evaluator
    moving: Indices
    box: Array
    settings: PredictorSettings = PREDICTORS

    def values(self, block: Block, x: Array) -> Array:
        """Simulated values (m, J), with one evaluation for each unit and node."""
        nodes = x.shape[1]
        points = x[block.unit_owner].reshape(-1, x.shape[2])
        found = self.runner.straight(np.repeat(block.units, nodes), points)
        whole = found.reshape(block.units.size, nodes, found.shape[1])
        return whole[..., 0] if block.plain else np.asarray(whole[block.place, :, block.column])

    def with_slopes(self, block: Block, x: Array) -> tuple[Array, Array]:
        """Simulated values and slopes, with 2 n + 1 evaluations for each unit and node.

        A slope is zero where a value beside it is not finite.
        """
        points, gaps = self._points(x)
        found = self.values(block, points.reshape(len(x), -1, x.shape[2]))
        parts = found.reshape(len(found), points.shape[1], x.shape[1])
        slopes = np.zeros((x.shape[2], len(found), x.shape[1]))
        for k, i in enumerate(self.moving):
            with np.errstate(invalid="ignore"):
                rise = parts[:, 1 + 2 * k] - parts[:, 2 + 2 * k]
            fine = np.isfinite(rise)
            # An infinite value, such as an unlimited fatigue life, is kept; only its slope is zero.
            slopes[i] = (rise if np.all(fine) else np.where(fine, rise, 0.0)) / gaps[k][block.owner]
        return parts[:, 0], slopes

    def _points(self, x: Array) -> tuple[Array, list[Array]]:
        """The points x (B, J, n) with steps up and down from them, as (B, 2 n + 1, J, n).

        Also returns the distance from the lower to the upper step. Steps stay in the parameters'
        ranges. Where x lies outside its range, there is no step away from the range.
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
    """Simulated values from response surfaces on a region (n, 2) of parameters.

    A point outside the region has the value of the nearest point in it. `of` (M,) is the number of
    the surface of each observation. The surfaces are functions of the parameters whose region has a
    width. Cost O(M J T) for T terms.
    """

    surface: Surface
    region: Array
    of: Indices
    settings: PredictorSettings = PREDICTORS

    def values(self, block: Block, x: Array) -> Array:
        """The values (m, J) of the surfaces at the parameters x (B, J, n) of the experiments."""
        return self._evaluated(block, x, slopes=False)[0]

    def with_slopes(self, block: Block, x: Array) -> tuple[Array, Array]:
        """The values and gradients of the surfaces; zero by a coordinate outside the region."""
        return self._evaluated(block, x, slopes=True)

    def inward(self, x: Array) -> Array:
        """The surfaces' coordinates (..., n) of the points in the region that are nearest to x."""
        return self.surface.axes.inward(self._inside(x)[..., self._moving])

    def _inside(self, x: Array) -> Array:
        return np.clip(x, self.region[:, 0], self.region[:, 1])

    def _evaluated(self, block: Block, x: Array, slopes: bool) -> tuple[Array, Array]:
        inside, z = self._inside(x), self.inward(x)
        experiments, nodes, n = z.shape
        first, degrees, rest, coefficients = self._factors
        where, ends = self.of[block.rows], np.append(block.starts, len(block.owner))
        found = np.empty((1 + n if slopes else 1, len(where), nodes))
        apart = [part for part in range(len(found)) if part != 1 + first]
        evaluated = products_with_gradient if slopes else products
        # A few experiments at a time, whose basis functions stay in the cache of the processor.
        for some in blocks(experiments, len(degrees) * nodes, self.settings.basis):
            rows = slice(int(ends[some.start]), int(ends[some.stop]))
            own = block.owner[rows] - some.start
            if not own.size:  # Nothing was observed of these experiments.
                continue
            flat = z[some].reshape(-1, n)
            of_first, of_others = evaluated(degrees, flat[:, first : first + 1]), np.ones((1, 1, 1))
            if n > 1:
                of_others = evaluated(rest, np.delete(flat, first, axis=1))
            along, beside = (
                np.broadcast_to(basis, (*basis.shape[:-1], len(flat)))
                .reshape(len(basis), -1, len(z[some]), nodes)
                .transpose(2, 0, 1, 3)[own]
                for basis in (of_first, of_others)
            )
            line = along.reshape(len(own), len(degrees), -1)
            sums = (coefficients[where[rows]] @ line).reshape(len(own), len(rest), -1, nodes)
            for place, part in enumerate(apart):
                found[part, rows] = np.einsum("mrj,mrj->mj", sums[:, :, 0], beside[:, :, place])
            if slopes:
                found[1 + first, rows] = np.einsum("mrj,mrj->mj", sums[:, :, 1], beside[:, :, 0])
        logarithmic = self.surface.logarithmic[where]
        value = outcomes(found[0], logarithmic)
        if not slopes:
            return value, found[:0]
        chained(found[1:].swapaxes(0, 1), value, logarithmic)
        slope = np.zeros((x.shape[2], len(where), nodes))
        rates = self.surface.axes.rates(inside[..., self._moving])
        for k, i in enumerate(self._moving):
            known = (inside[..., i] == x[..., i])[block.owner]
            slope[i] = np.where(known, found[1 + k] * rates[..., k][block.owner], 0.0)
        return value, slope

    @cached_property
    def _moving(self) -> Indices:
        return moving_parameters(self.region)

    @cached_property
    def _factors(self) -> tuple[int, Indices, Indices, Array]:
        """The polynomials of all surfaces as sum_r phi_r(others) sum_k c_rk phi_k(first).

        The coordinate `first` is that of the highest degree. Its degrees are (d, 1), the r-th
        multi-index of the other coordinates is a row of (R, n - 1), and c is (U, R, d). Summing
        over k first is a product of matrices, and leaves R terms of P.
        """
        indices = self.surface.indices
        first = int(np.argmax(indices.max(axis=0)))
        degrees = np.arange(indices[:, first].max() + 1)[:, None]
        rest, row = np.unique(np.delete(indices, first, axis=1), axis=0, return_inverse=True)
        whole = np.zeros((len(self.surface.error), len(rest), len(degrees)))
        for group in self.surface.groups:
            at = row.ravel()[: group.size], indices[: group.size, first]
            whole[group.members[:, None], *at] = group.coefficients
        return first, degrees, rest, whole


@dataclass(frozen=True, eq=False)
class OnProcesses(OnSurfaces):
    """Simulated values from Gaussian processes, where polynomials do not follow these.

    The surfaces are polynomials fitted to the same processes. Cost O(M J R) for R runs.
    """

    means: ProcessMeans = field(kw_only=True)

    def _evaluated(self, block: Block, x: Array, slopes: bool) -> tuple[Array, Array]:
        inside = self._inside(x)
        points = inside[..., self._moving][block.owner]
        if not slopes:
            return self.means.values(self.of[block.rows], points), np.empty((0,))
        value, slope = self.means.with_slopes(self.of[block.rows], points)
        every = np.zeros((x.shape[2], *value.shape))
        known = (inside == x)[..., self._moving][block.owner]
        every[self._moving] = np.where(np.moveaxis(known, 2, 0), slope, 0.0)
        return value, every
