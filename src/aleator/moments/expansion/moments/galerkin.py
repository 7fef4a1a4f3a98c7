"""Exact moments by repeated Galerkin products: powers of an expansion are expansions."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, prod

import numpy as np

from aleator.blocks import blocks
from aleator.errors import InputsError
from aleator.moments.expansion.basis import Basis
from aleator.moments.expansion.indices import constant, highest
from aleator.moments.expansion.moments.linearization import linearization
from aleator.moments.expansion.moments.products import Product, Square
from aleator.types import Array, Indices

MOST_ENTRIES = 100_000_000
"""Entries of the product tensors that fill 1.2 GB."""

VALUES_AT_ONCE = 1_000_000
"""Coefficients of a power that are held at once: experiments are taken in parts."""


@dataclass(frozen=True)
class Galerkin:
    """Z^(k+1) = Z^k Z as an expansion again, E[Z^(2k)] = <Z^k, Z^k>, E[Z^(2k+1)] = <Z^k, Z^(k+1)>.

    The products are exact: Z^k is expanded in all functions that can occur in it, with the
    linearization coefficients <psi_i psi_j psi_l> = prod_k <p_(i_k) p_(j_k) p_(l_k)>, of which
    few are not zero. Powers to floor(M/2) are enough; the basis of Z^k has degree k d. Even moments
    are sums of squares: no cancellation at all. Cost: offline and, for each experiment, online
    O(number of entries), for degree d at most P |D_k| 2^d where |D_k| functions occur in Z^k,
    k = floor((M - 1)/2), half of that for k = 1, where the products are of pairs. Ten parameters:
    degree 2 to M = 8, degree 3 to M = 4. Raises InputsError where there may be more than 1e8
    entries.
    """

    def powers(self, basis: Basis, indices: Indices, order: int) -> GalerkinPowers:
        """The products psi_i psi_j of the basis with that of every power."""
        entries, degrees = entry_bound(basis, indices, order), highest(indices)
        levels = _levels(order)
        strides = _strides(degrees, order)
        if entries > MOST_ENTRIES or strides is None:
            raise InputsError(
                f"Galerkin products to order {order} of {len(indices)} functions of "
                f"{len(degrees)} parameters may need {entries:.3g} entries",
                "lower the degree or the order of the moments, or use fewer parameters",
            )
        tables = tuple(
            linearization(basis, k, degree, levels * degree, order // 2 * degree)
            for k, degree in enumerate(degrees)
        )
        square = Square.of(indices, strides, tables, order)
        keys, products = square.keys, []
        for level in range(2, levels + 1):
            # E[Z^(2k+1)] asks of Z^(k+1) only what Z^k holds
            within = keys if order == 2 * level + 1 else None
            products.append(Product.of(indices, keys, strides, tables, within))
            keys = products[-1].keys
        return GalerkinPowers(order, constant(indices), square, tuple(products))


def entry_bound(basis: Basis, indices: Indices, order: int) -> float:
    """An upper bound of the entries of the last product, from counts of functions alone.

    psi_i psi_j holds at most prod_k (i_k + 1) functions where all weights are symmetric, and
    prod_k (2 i_k + 1) otherwise; Z^k at most as many as its largest degrees and its largest total
    degree allow.
    """
    level = _levels(order)
    degrees = highest(indices)
    alike = [basis.symmetric(k, order * d // 2 + 1) for k, d in enumerate(degrees)]
    spread = np.where(alike, 1, 2)
    split = float(np.sum(np.prod(spread * indices + 1.0, axis=1)))
    total = int(indices.sum(axis=1).max())
    functions = min(
        float(prod(level * degree + 1 for degree in degrees)),
        float(comb(len(degrees) + level * total, level * total)),
    )
    return split * functions


def _levels(order: int) -> int:
    """The products by which moments to an order are known, the square among them."""
    return max((order - 1) // 2, 1)


def _strides(degrees: tuple[int, ...], order: int) -> Indices | None:
    """Strides by which a multi-index of any power becomes one whole number, None if too large."""
    sizes = [order * degree + 1 for degree in degrees]
    if prod(sizes) >= 2**62:
        return None
    return np.array([prod(sizes[k + 1 :]) for k in range(len(sizes))], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class GalerkinPowers:
    """The products that give Z^2, and from it Z^3, Z^4, .."""

    order: int
    constant: int
    square: Square
    products: tuple[Product, ...]

    def means(self, z: Array) -> Array:
        """E[Z^m] for m = 0..M, as (N, M+1)."""
        means = np.zeros((z.shape[0], self.order + 1))
        means[:, 0] = 1.0
        means[:, 2] = np.sum(z**2, axis=1)
        for part in self._parts(z.shape[0]):
            factor = z[part].T
            power = self.square.multiplied(factor)
            if self.order > 2:
                means[part, 3] = np.sum(power[self.square.places] * factor, axis=0)
            if self.order > 3:
                means[part, 4] = np.sum(power**2, axis=0)
            for level, product in enumerate(self.products, 2):
                following = product.multiplied(factor, power)
                means[part, 2 * level + 1] = np.sum(following[product.places] * power, axis=0)
                if 2 * level + 2 <= self.order:
                    means[part, 2 * level + 2] = np.sum(following**2, axis=0)
                power = following
        return means

    def projections(self, z: Array) -> Array:
        """E[Z^m psi_i] for m = 0..M-1, as (N, M, P)."""
        found = np.zeros((z.shape[0], self.order, z.shape[1]))
        found[:, 0, self.constant] = 1.0
        found[:, 1] = z
        for part in self._parts(z.shape[0]):
            factor = z[part].T
            power = self.square.multiplied(factor)
            if self.order > 2:
                found[part, 2] = power[self.square.places].T
            if self.order > 3:
                found[part, 3] = self.square.projected(factor, power).T
            for level, product in enumerate(self.products, 2):
                following = product.multiplied(factor, power)
                even, odd = product.projected(power, following)
                found[part, 2 * level] = even.T
                if 2 * level + 1 < self.order:
                    found[part, 2 * level + 1] = odd.T
                power = following
        return found

    def _parts(self, count: int) -> list[slice]:
        largest = max(len(self.square.left), *(product.keys.size for product in self.products), 1)
        return blocks(count, largest, VALUES_AT_ONCE)
