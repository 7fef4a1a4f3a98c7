"""Exact moments by tensor Gauss quadrature of the powers of the polynomial itself."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

import numpy as np

from aleator.blocks import blocks
from aleator.errors import InputsError
from aleator.moments.expansion.basis import Basis
from aleator.moments.expansion.indices import highest
from aleator.types import Array, Indices

MOST_NODES = 50_000_000
"""Nodes of a rule whose values fill 400 MB."""

VALUES_AT_ONCE = 100_000
"""Values of the polynomial that are held at once, so that they stay in the cache."""


@dataclass(frozen=True)
class ExactQuadrature:
    """floor(M d_k/2) + 1 Gauss nodes for parameter k, exact for polynomials of degree M d_k.

    The polynomial is evaluated on the tensor grid one parameter at a time (sum factorization), so
    that a node costs about d_k + 1 multiplications instead of P. Cost: no offline step to speak of;
    online O(N J (d + M)) with J = prod_k (floor(M d_k/2) + 1) nodes: 4,096 for (n, d, M) =
    (4, 3, 5), hopeless beyond six parameters, where `Galerkin` is the way. Raises InputsError for
    more than 5e7 nodes.
    """

    def powers(self, basis: Basis, indices: Indices, order: int) -> QuadraturePowers:
        """Weights, and the polynomials of each parameter at its nodes."""
        nodes, degrees = node_count(indices, order), highest(indices)
        if nodes > MOST_NODES:
            raise InputsError(
                f"tensor Gauss quadrature needs {nodes:.3g} nodes for {len(degrees)} "
                f"parameters of degree {max(degrees)} and order {order}",
                "use Galerkin()",
            )
        tables, weights = [], np.ones(())
        for k, degree in enumerate(degrees):
            _, w, p = basis.exact_rule(k, order * degree)
            # with order 2 or more there are more nodes than degrees
            tables.append(np.ascontiguousarray(p[:, : degree + 1]))
            weights = np.multiply.outer(weights, w)
        shape = tuple(degree + 1 for degree in degrees)
        places = np.ravel_multi_index(tuple(indices.T), shape)
        return QuadraturePowers(order, shape, places, tuple(tables), weights.reshape(-1))


def node_count(indices: Indices, order: int) -> int:
    """J, the number of nodes of the tensor rule that is exact for moments to `order`."""
    return prod(order * degree // 2 + 1 for degree in highest(indices))


@dataclass(frozen=True, eq=False)
class QuadraturePowers:
    """Weights (J,), and `tables` (q_k, d_k + 1) of the polynomials at each parameter's nodes."""

    order: int
    shape: tuple[int, ...]
    places: Indices
    tables: tuple[Array, ...]
    weights: Array

    def means(self, z: Array) -> Array:
        """E[Z^m] for m = 0..M, as (N, M+1)."""
        means = np.ones((z.shape[0], self.order + 1))
        for part in blocks(z.shape[0], self.weights.size, VALUES_AT_ONCE):
            values = self._values(z[part])
            power = np.ones_like(values)
            for m in range(1, self.order + 1):
                power *= values
                means[part, m] = power @ self.weights
        return means

    def projections(self, z: Array) -> Array:
        """E[Z^m psi_i] for m = 0..M-1, as (N, M, P)."""
        found = np.zeros((z.shape[0], self.order, z.shape[1]))
        for part in blocks(z.shape[0], self.weights.size, VALUES_AT_ONCE):
            values = self._values(z[part])
            weighted = np.broadcast_to(self.weights, values.shape)
            for m in range(self.order):
                found[part, m] = self._project(weighted)
                weighted = weighted * values
        return found

    def _values(self, z: Array) -> Array:
        """The polynomials at all nodes, (N, J)."""
        grid = np.zeros((z.shape[0], int(np.prod(self.shape))))
        grid[:, self.places] = z
        grid = grid.reshape(-1, *self.shape)
        for table in self.tables:
            # each turn replaces the first axis of degrees and appends its nodes as the last axis
            grid = np.tensordot(grid, table, axes=(1, 1))
        return grid.reshape(z.shape[0], -1)

    def _project(self, weighted: Array) -> Array:
        """Sums over the nodes of weighted values (N, J) times every psi_i, (N, P)."""
        grid = weighted.reshape(-1, *(table.shape[0] for table in self.tables))
        for table in self.tables:
            grid = np.tensordot(grid, table, axes=(1, 0))
        return grid.reshape(weighted.shape[0], -1)[:, self.places]
