"""Polynomials of many experiments over one list of indices, grouped by how much of it they need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.surrogates.basis import products
from aleator.types import Array, Indices


@dataclass(frozen=True)
class Group:
    """Experiments that share one index set: the first `size` rows of the common list."""

    members: Indices
    coefficients: Array  # (members, size)

    @property
    def size(self) -> int:
        """Number of polynomial terms."""
        return int(self.coefficients.shape[1])


def sums(groups: tuple[Group, ...], count: int, basis: Array) -> Array:
    """Return the polynomials (N, J) of N = `count` experiments, each in a group, for (P, J)."""
    out = np.empty((count, basis.shape[1]))
    for group in groups:
        out[group.members] = group.coefficients @ basis[: group.size]
    return out


def sums_with_gradient(groups: tuple[Group, ...], count: int, basis: Array) -> tuple[Array, Array]:
    """Return the polynomials (N, J) and their gradients (N, n, J), for the basis (P, 1 + n, J)."""
    columns = basis.reshape(len(basis), -1)
    value = np.empty((count, basis.shape[2]))
    slope = np.empty((count, basis.shape[1] - 1, basis.shape[2]))
    for group in groups:
        both = (group.coefficients @ columns[: group.size]).reshape(
            len(group.members), *basis.shape[1:]
        )
        value[group.members], slope[group.members] = both[:, 0], both[:, 1:]
    return value, slope


def sums_at(groups: tuple[Group, ...], indices: Indices, place: Indices, z: Array) -> Array:
    """Return the polynomial (R,) of experiment place[r] at the point z[r], z (R, n)."""
    out = np.empty(len(z))
    count = 1 + max(int(group.members.max()) for group in groups)
    where, which = np.empty((2, count), dtype=np.intp)
    for g, group in enumerate(groups):
        where[group.members], which[group.members] = np.arange(len(group.members)), g
    for g, group in enumerate(groups):
        rows = np.flatnonzero(which[place] == g)
        terms = group.coefficients[where[place[rows]]]
        out[rows] = np.einsum("rp,pr->r", terms, products(indices[: group.size], z[rows]))
    return out
