"""Kinks, roots and jumps: what is added to polynomial surfaces on one side of a border."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from aleator.surrogates.basis import products, products_with_gradient
from aleator.surrogates.group import Group, sums, sums_at, sums_with_gradient
from aleator.types import Array, Flags, Indices

# A root's slope is without limit at its border: what lies nearer than this counts as lying here.
NEAREST = 1e-6


def border_indices(n: int) -> Indices:
    """Return the indices (T, n) of a border: the constant, the straight, then degree two.

    >>> border_indices(2).tolist()
    [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]
    """
    unit = np.eye(n, dtype=np.intp)
    bent = [unit[i] + unit[j] for i, j in combinations_with_replacement(range(n), 2)]
    return np.array([np.zeros(n, dtype=np.intp), *unit, *bent])


@dataclass(frozen=True)
class Borders:
    """Borders g = 0 of A experiments: g = sum_t border[:, t] phi_t(z) over `border_indices`.

    `border` (A, T) may hold the first coefficients only, those of straight borders. `power` (A,)
    is p of h = g^p where g > 0, and zero elsewhere: 1 for a kink, 1/2 for a root, 0 for a jump.
    """

    border: Array
    power: Array

    def __getitem__(self, rows: Indices | Flags) -> Borders:
        """Borders of some experiments."""
        return Borders(self.border[rows], self.power[rows])

    def level(self, basis: Array) -> Array:
        """g (A, M) at points with border functions (T, M)."""
        return np.asarray(self.border @ basis[: self.border.shape[1]])

    def factor(self, basis: Array) -> Array:
        """h (A, M) at points with border functions (T, M)."""
        return _hinge(self.level(basis), self.power[:, None])

    def at(self, place: Indices, basis: Array) -> Array:
        """h (R,) of experiment place[r] at the point r with border functions (T, R)."""
        level = np.einsum("rt,tr->r", self.border[place], basis[: self.border.shape[1]])
        return _hinge(level, self.power[place])

    def slope(self, basis: Array) -> Array:
        """dh/dg (A, M) at points with border functions (T, M)."""
        g, power = self.level(basis), self.power[:, None]
        return np.where(g > 0.0, power * np.maximum(g, NEAREST) ** (power - 1.0), 0.0)


def _hinge(g: Array, power: Array) -> Array:
    return np.asarray(np.where(g > 0.0, np.maximum(g, 0.0) ** power, 0.0))


@dataclass(frozen=True)
class Crease:
    """h_l(x) q_l(x), added to the surfaces of some experiments.

    q is a polynomial as the surfaces themselves: `indices` (P, n) and `groups` over its prefixes,
    whose members count along `members` (A,), the experiments. `borders` are theirs.

    >>> borders = Borders(np.array([[0.0, 1.0]]), np.ones(1))  # g = sqrt(3) z
    >>> one = Group(np.array([0]), np.array([[2.0]]))
    >>> crease = Crease(np.array([0]), borders, np.array([[0]]), (one,))
    >>> crease.value(np.array([[-1.0], [0.5]])) / np.sqrt(3.0)
    array([[0., 1.]])
    """

    members: Indices
    borders: Borders
    indices: Indices
    groups: tuple[Group, ...]

    def value(self, z: Array) -> Array:
        """What is added (A, J) at points z (J, n) of [-1, 1]^n."""
        h = self.borders.factor(products(self._border_indices, z))
        return h * sums(self.groups, len(self.members), products(self.indices, z))

    def value_and_slope(self, z: Array) -> tuple[Array, Array]:
        """What is added (A, J), and its derivatives (A, n, J) by z (J, n)."""
        basis = products_with_gradient(self._border_indices, z)
        h, by_g = self.borders.factor(basis[:, 0]), self.borders.slope(basis[:, 0])
        slope = np.einsum("at,tnj->anj", self.borders.border, basis[:, 1:])
        q, dq = sums_with_gradient(
            self.groups, len(self.members), products_with_gradient(self.indices, z)
        )
        return h * q, h[:, None] * dq + (by_g * q)[:, None] * slope

    def at(self, place: Indices, z: Array) -> Array:
        """What is added (R,) to the member place[r] at the point z[r], z (R, n)."""
        return self.borders.at(place, products(self._border_indices, z)) * sums_at(
            self.groups, self.indices, place, z
        )

    @cached_property
    def _border_indices(self) -> Indices:
        return border_indices(self.indices.shape[1])[: self.borders.border.shape[1]]
