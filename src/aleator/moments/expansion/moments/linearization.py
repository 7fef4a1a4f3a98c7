"""Products of orthonormal polynomials as sums of orthonormal polynomials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.moments.expansion.basis import Basis
from aleator.types import Array, Indices


@dataclass(frozen=True, eq=False)
class Linearization:
    """p_g p_j = sum_l C_(gjl) p_l of one parameter, as a list of what is not zero for each g, j.

    Row (g, j) are the entries starts[g, j] .. starts[g, j] + counts[g, j] of `shift` = l - j and of
    `value` = C_(gjl) = <p_g p_j p_l>.
    """

    starts: Indices
    counts: Indices
    shift: Indices
    value: Array


def linearization(basis: Basis, k: int, degree: int, most: int, highest: int) -> Linearization:
    """The coefficients of parameter k for g <= `degree`, j <= `most` and l <= `highest`.

    By a Gauss rule of q nodes that is exact to their sum. Zero, and exactly so, is what
    orthogonality makes zero: l outside |g - j| .. g + j, and an odd g + j + l for a symmetric
    weight. Cost O(degree most highest q).

    >>> products = linearization(Basis.normal(1), 0, 2, 2, 4)    # theta * theta = 1 + sqrt(2) p_2
    >>> row = slice(products.starts[1, 1], products.starts[1, 1] + products.counts[1, 1])
    >>> products.shift[row].tolist(), products.value[row].round(6).tolist()
    ([-1, 1], [1.0, 1.414214])
    """
    g, j, l = np.ogrid[: degree + 1, : most + 1, : highest + 1]
    t, weights, _ = basis.exact_rule(k, degree + most + highest)
    p = basis.table(k, t, max(degree, most, highest))
    dense = np.einsum(
        "q,qg,qj,ql->gjl", weights, p[:, g.ravel()], p[:, j.ravel()], p[:, l.ravel()], optimize=True
    )
    possible = (l >= np.abs(g - j)) & (l <= g + j)
    if basis.symmetric(k, t.size):
        possible &= (g + j + l) % 2 == 0
    counts = possible.sum(axis=2)
    starts = np.cumsum(counts).reshape(counts.shape) - counts
    shift = np.broadcast_to(l - j, possible.shape)[possible]
    return Linearization(starts, counts, shift, dense[possible])


def multiply(
    factor: Indices, indices: Indices, strides: Indices, tables: tuple[Linearization, ...]
) -> tuple[Indices, Indices, Array]:
    """psi_factor psi_j = sum_l T_l psi_l for every row j of `indices`: the entries (j, l, T_l).

    An entry names j by its row and l by its key, sum_k l_k strides_k. Parameter after parameter
    every entry is split into those of the univariate product; a parameter of degree zero in
    `factor` splits nothing, so that the cost is that of the result.
    """
    rows = np.arange(indices.shape[0])
    keys = indices @ strides
    values = np.ones(indices.shape[0])
    for k in np.flatnonzero(factor):
        table, degree = tables[k], indices[rows, k]
        counts = table.counts[factor[k], degree]
        parent = np.repeat(np.arange(rows.size), counts)
        first = np.cumsum(counts) - counts
        entry = table.starts[factor[k], degree][parent] + np.arange(parent.size) - first[parent]
        rows = rows[parent]
        keys = keys[parent] + table.shift[entry] * strides[k]
        values = values[parent] * table.value[entry]
    return rows, keys, values
