"""Galerkin products: the square of an expansion, and a power times the expansion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from aleator.moments.expansion.moments.linearization import Linearization, multiply
from aleator.types import Array, Indices


@dataclass(frozen=True, eq=False)
class Square:
    """Z^2 of Z = sum_i z_i psi_i, by the Q pairs i <= j of its P functions.

    Z^2 = sum over pairs of w_ij z_i z_j psi_i psi_j, w = 1 where i = j and 2 elsewhere; `matrix`
    (L, Q) holds w_ij T_l. `sums` (P, 2 Q) adds what pairs tell of their first functions, then of
    their second ones. `keys` (L,) name the functions of Z^2; `places` (P,) are those of Z in it.
    """

    keys: Indices
    places: Indices
    left: Indices
    right: Indices
    matrix: sparse.csr_array
    sums: sparse.csr_array

    @classmethod
    def of(
        cls, indices: Indices, strides: Indices, tables: tuple[Linearization, ...], order: int
    ) -> Square:
        """Of the functions `indices` (P, n); moments to order 3 ask only for these functions."""
        left, right = np.triu_indices(len(indices))
        found = [multiply(own, indices[i:], strides, tables) for i, own in enumerate(indices)]
        first = np.searchsorted(left, np.arange(len(indices)))
        pair = np.concatenate(
            [rows + start for (rows, _, _), start in zip(found, first, strict=True)]
        )
        key, value = (np.concatenate(parts) for parts in list(zip(*found, strict=True))[1:])
        own_keys = indices @ strides
        keys = np.unique(own_keys if order <= 3 else key)
        row, kept = _among(keys, key)
        weight = np.where(left == right, 1.0, 2.0)
        triplets = ((weight[pair] * value)[kept], (row[kept], pair[kept]))
        matrix = sparse.csr_array(triplets, shape=(keys.size, left.size))
        both = np.concatenate([left, right])
        of_function = (np.ones(both.size), (both, np.arange(both.size)))
        sums = sparse.csr_array(of_function, shape=(len(indices), both.size))
        return cls(keys, np.searchsorted(keys, own_keys), left, right, matrix, sums)

    def multiplied(self, z: Array) -> Array:
        """Z^2 (L, N) of the coefficients z (P, N)."""
        return np.asarray(self.matrix @ (z[self.left] * z[self.right]))

    def projected(self, z: Array, square: Array) -> Array:
        """E[Z^3 psi_i] = <Z^2, Z psi_i> (P, N): each pair tells both of its functions."""
        each = 0.5 * (self.matrix.T @ square)
        return np.asarray(self.sums @ np.concatenate([each * z[self.right], each * z[self.left]]))


@dataclass(frozen=True, eq=False)
class Product:
    """Multiplication of Z^k by every psi_i: coefficients (J,) to coefficients (L,).

    `keys` (L,) name the functions of the result; `places` (J,) are the functions of Z^k in it.
    Multiplication by psi_i reaches only the functions `rows[i]` (R_i,), by `matrices[i]` (R_i, J).
    """

    keys: Indices
    places: Indices
    rows: tuple[Indices, ...]
    matrices: tuple[sparse.csr_array, ...]

    @classmethod
    def of(
        cls,
        functions: Indices,
        keys: Indices,
        strides: Indices,
        tables: tuple[Linearization, ...],
        within: Indices | None,
    ) -> Product:
        """Of `functions` (P, n) and those of Z^k; of the result what lies `within`, if given."""
        indices = _decoded(keys, strides)
        entries = [multiply(factor, indices, strides, tables) for factor in functions]
        if within is None:
            within = np.unique(np.concatenate([np.unique(found) for _, found, _ in entries]))
        reached, matrices = [], []
        for columns, found, values in entries:
            places, kept = _among(within, found)
            rows, row = np.unique(places[kept], return_inverse=True)
            triplets = (values[kept], (row, columns[kept]))
            reached.append(rows)
            matrices.append(sparse.csr_array(triplets, shape=(rows.size, keys.size)))
        return cls(within, np.searchsorted(within, keys), tuple(reached), tuple(matrices))

    def multiplied(self, z: Array, power: Array) -> Array:
        """Z^(k+1) (L, N) of z (P, N) and Z^k (J, N)."""
        following = np.zeros((self.keys.size, z.shape[1]))
        for factor, rows, matrix in zip(z, self.rows, self.matrices, strict=True):
            if factor.any():
                following[rows] += (matrix @ power) * factor
        return following

    def projected(self, power: Array, following: Array) -> tuple[Array, Array]:
        """E[Z^(2k) psi_i] = <Z^k psi_i, Z^k> and E[Z^(2k+1) psi_i] = <Z^k psi_i, Z^(k+1)>."""
        embedded = np.zeros_like(following)
        embedded[self.places] = power
        even, odd = np.empty((2, len(self.rows), power.shape[1]))
        for i, (rows, matrix) in enumerate(zip(self.rows, self.matrices, strict=True)):
            # once more instead of kept: the images of all functions fill the memory
            image = matrix @ power
            even[i] = np.sum(image * embedded[rows], axis=0)
            odd[i] = np.sum(image * following[rows], axis=0)
        return even, odd


def _among(keys: Indices, found: Indices) -> tuple[Indices, np.ndarray]:
    """Where each of those found is among the sorted keys, and whether it is."""
    places = np.minimum(np.searchsorted(keys, found), keys.size - 1)
    return places, keys[places] == found


def _decoded(keys: Indices, strides: Indices) -> Indices:
    indices = np.empty((keys.size, strides.size), dtype=np.intp)
    rest = keys
    for k, stride in enumerate(strides):
        indices[:, k], rest = np.divmod(rest, stride)
    return indices
