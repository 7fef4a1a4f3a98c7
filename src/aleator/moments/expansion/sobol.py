"""Sobol' indices from the coefficients of an expansion: the parameters' shares of the variance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.errors import InputsError
from aleator.types import Array, Indices

NOTHING = 1e-12
"""Standard deviation over mean below which an outcome does not vary: rounding has no shares."""


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Shares of the variance of N outcomes, by n parameters.

    `first` (N, n): of one parameter alone; `total` (N, n): of one parameter with all its
    interactions; `second` (N, n, n): of two parameters together beyond their first-order shares,
    symmetric, zero on the diagonal; `variance` (N,) in the outcome's unit squared. Shares are NaN
    where an outcome does not vary.
    """

    first: Array
    total: Array
    second: Array
    variance: Array

    @property
    def closed(self) -> Array:
        """Shares (N, n, n) that two parameters explain by themselves: S_i + S_j + S_ij.

        On the diagonal S_i.
        """
        n = self.first.shape[1]
        pairs = self.first[:, :, None] + self.first[:, None, :] + self.second
        return np.where(np.eye(n, dtype=bool), self.first[:, :, None], pairs)


def sobol_indices(indices: Indices, coefficients: Array) -> SobolIndices:
    """First, second and total Sobol' indices of N expansions in orthonormal polynomials.

    Var Y = sum of c_k^2 over k != 0; a term belongs to the parameters with k_i > 0, so that each
    index is a partial sum of squares over that of all (Sudret, Reliab. Eng. Syst. Saf. 93 (2008)).
    `indices` (P, n), `coefficients` (N, P). As good as the expansion: what it misses has no share.
    Raises InputsError where the shapes do not fit. Cost O(N P + P n^2).

    >>> found = sobol_indices(np.array([[0, 0], [1, 0], [0, 2], [1, 1]]),
    ...                       np.array([[7.0, 2.0, 1.0, 2.0]]))    # variance 4 + 1 + 4
    >>> (9 * found.first).tolist(), (9 * found.total).tolist(), float(9 * found.second[0, 0, 1])
    ([[4.0, 1.0]], [[8.0, 5.0]], 4.0)
    """
    if indices.ndim != 2 or coefficients.ndim != 2 or coefficients.shape[1] != len(indices):
        raise InputsError(
            f"coefficients of shape {coefficients.shape} for multi-indices {indices.shape}",
            "give coefficients (N, P) for multi-indices (P, n)",
        )
    active = indices > 0
    order = active.sum(axis=1)
    squares = np.where(order > 0, coefficients**2, 0.0)
    variance = squares.sum(axis=1)
    constant = np.abs(coefficients[:, order == 0]).sum(axis=1)
    varies = np.sqrt(variance) > NOTHING * constant
    share = squares / np.where(varies, variance, np.nan)[:, None]
    n = indices.shape[1]
    pairs = (active[:, :, None] & active[:, None, :])[order == 2] & ~np.eye(n, dtype=bool)
    return SobolIndices(
        first=share[:, order == 1] @ active[order == 1],
        total=share @ active,
        second=np.einsum("np,pij->nij", share[:, order == 2], pairs.astype(float)),
        variance=variance,
    )
