"""Simulated values by response surfaces, each experiment at parameters of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.blocks import blocks
from aleator.likelihood.individual.layout import Block
from aleator.surrogates import Surface
from aleator.surrogates.basis import products, products_with_gradient
from aleator.surrogates.responses import moving_parameters
from aleator.surrogates.scales import chained, outcomes
from aleator.types import Array, Indices

LARGEST = 4_000_000
"""Numbers of one block of basis functions that are held at once."""


@dataclass(frozen=True, eq=False)
class OnSurfaces:
    """The values of surfaces known on a region (n, 2); beyond it those of its nearest point.

    `of` (M,) is the surface of each observation; the surfaces are in the parameters whose region
    has a width. Cost O(M J T) for T terms.
    """

    surface: Surface
    region: Array
    of: Indices

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
        for rows in blocks(len(terms), len(basis) * nodes, LARGEST):
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
