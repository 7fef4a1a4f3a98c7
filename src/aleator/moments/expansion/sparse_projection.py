"""Coefficients by pseudo-spectral projection on a sparse grid (Smolyak)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.moments.expansion.basis import Basis
from aleator.moments.expansion.design import Design
from aleator.moments.expansion.expansion import Expansion, checked
from aleator.moments.expansion.indices import IndexSet
from aleator.moments.expansion.projection import tensor_design
from aleator.types import Array, Indices

DIGITS = 10
"""Decimals to which two nodes must agree to be one."""


@dataclass(frozen=True)
class SparseProjection:
    """Smolyak's combination of projections on small tensor grids.

    For every multi-index l of `terms` a tensor Gauss rule with l_i + 1 nodes of parameter i gives
    the polynomials k <= l; the expansion is sum_l s_l times the l-th of these, with the signs
    s_l = sum_z (-1)^|z| over z in {0, 1}^n with l + z in the set. Each grid projects only what it
    integrates exactly with its own polynomials, so that the expansion is exact for every
    polynomial in the set (Constantine, Eldred and Phipps, CMAME 229 (2012); Conrad and Marzouk,
    SIAM J. Sci. Comput. 35 (2013)). The plain weights of the same sparse grid are as good for
    `TotalDegree`, but alias for sets such as `Hyperbolic`, where the product of two terms is
    beyond their exactness. There is no leave-one-out error. The points grow fast with the degree:
    for ten symmetric laws 221 of degree 2 and 1,581 of degree 3.

    >>> from aleator.moments.expansion.indices import TotalDegree
    >>> basis = Basis.normal(2)
    >>> way = SparseProjection(TotalDegree(2))
    >>> design = way.design(basis)
    >>> y = way.fit(basis, design, (design.x[:, 0] * design.x[:, 1])[None])
    >>> y.coefficients.round(12).tolist()                      # nothing but psi_(1, 1)
    [[0.0, 0.0, 0.0, 0.0, 1.0, 0.0]]
    """

    terms: IndexSet

    def design(self, basis: Basis) -> Design:
        """The different nodes of all grids; the weights are those of Smolyak's quadrature."""
        return self._combined(basis)[0]

    def fit(self, basis: Basis, design: Design, outcomes: Array) -> Expansion:
        """The expansion from outcomes (N, J) at the nodes."""
        outcomes = checked(design, outcomes)
        indices, (_, operator) = self.terms.indices(basis.limits), self._combined(basis)
        return Expansion(basis, indices, outcomes @ operator, np.full(len(outcomes), np.nan))

    def _combined(self, basis: Basis) -> tuple[Design, Array]:
        """The grid of all nodes, and the matrix (J, P) from outcomes there to coefficients."""
        indices = self.terms.indices(basis.limits)
        signs = combination(indices)
        used = np.flatnonzero(signs)
        grids = [tensor_design(basis, (indices[row] + 1).tolist()) for row in used]
        t = np.concatenate([grid.t for grid in grids])
        _, first, place = np.unique(
            np.round(t, DIGITS) + 0.0, axis=0, return_index=True, return_inverse=True
        )
        operator = np.zeros((len(first), len(indices)))
        begin = 0
        for row, grid in zip(used, grids, strict=True):
            points = place.reshape(-1)[begin : begin + len(grid)]
            begin += len(grid)
            own = np.flatnonzero(np.all(indices <= indices[row], axis=1))
            psi = basis.evaluate(grid.t, indices[own])
            operator[np.ix_(points, own)] += signs[row] * grid.weights[:, None] * psi
        x = np.concatenate([grid.x for grid in grids])
        return Design(t[first], x[first], operator[:, 0].copy()), operator


def combination(indices: Indices) -> Indices:
    """Signs s (P,) of the combination technique for a downward closed set (P, n).

    The indicator of the set, differenced once along every parameter.

    >>> combination(np.array([[0, 0], [0, 1], [1, 0]])).tolist()
    [-1, 1, 1]
    """
    place = {tuple(row): k for k, row in enumerate(indices.tolist())}
    signs = np.ones(len(indices), dtype=np.intp)
    for i in range(indices.shape[1]):
        above = indices.copy()
        above[:, i] += 1
        next_up = np.array([place.get(tuple(row), -1) for row in above.tolist()])
        signs = signs - np.where(next_up >= 0, signs[next_up], 0)
    return signs
