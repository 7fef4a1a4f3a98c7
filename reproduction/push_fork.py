"""The paper's way to the exact moments of an expansion: the multinomial sum over push and fork.

I_(m,p) holds the ways to lay m items on p locations (paper, "Estimation of high-order moments").
A multi-index is here its exponents (p,), or its `stack` (m,): how far each item lies from the last
location, s_1 >= s_2 >= ... . Push and fork visit the stacks in lexicographic order. The package
itself computes the same moments by `ExactQuadrature` or `Galerkin`, in a fraction of the time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array
from aleator.moments.expansion import Basis, highest
from aleator.moments.moments import Moments

Integers = NDArray[np.int64]


def push_and_fork(m: int, p: int) -> Iterator[tuple[int, ...]]:
    """The multi-indices of I_(m,p) one by one, each from the one before it (paper, Fig. sets).

    All items start in the last location. Where the last location holds an item, one is pushed to
    the location before it; otherwise the trailing nonempty location is forked: one of its items
    moves to the location before it, the others return to the last.

    >>> list(push_and_fork(2, 3))
    [(0, 0, 2), (0, 1, 1), (0, 2, 0), (1, 0, 1), (1, 1, 0), (2, 0, 0)]
    """
    row = [0] * p
    row[-1] = m
    yield tuple(row)
    while row[0] < m:
        if row[-1] > 0:
            row[-1] -= 1
            row[-2] += 1
        else:
            trailing = max(k for k in range(p) if row[k])
            items, row[trailing] = row[trailing], 0
            row[trailing - 1] += 1
            row[-1] = items - 1
        yield tuple(row)


def count(m: int, p: int) -> int:
    """|I_(m,p)| = C(m + p - 1, m).

    >>> count(5, 10), count(5, 35)
    (2002, 575757)
    """
    return comb(m + p - 1, m)


def stacks(m: int, p: int) -> Integers:
    """The stacks (count(m, p), m) of I_(m,p) in the order of push and fork.

    Under a first item at distance s lie the stacks of m - 1 items on the last s + 1 locations,
    which are the first of those on all locations. Cost O(m count(m, p)).

    >>> exponents(stacks(2, 3), 3).tolist()
    [[0, 0, 2], [0, 1, 1], [0, 2, 0], [1, 0, 1], [1, 1, 0], [2, 0, 0]]
    """
    if m == 0:
        return np.zeros((1, 0), dtype=np.int64)
    under = [count(m - 1, s + 1) for s in range(p)]
    below = np.concatenate([np.arange(size) for size in under])
    return np.column_stack([np.repeat(np.arange(p), under), stacks(m - 1, p)[below]])


def exponents(found: Integers, p: int) -> NDArray[np.int8]:
    """Exponents (T, p) of stacks (T, m)."""
    rows = np.zeros((found.shape[0], p), dtype=np.int8)
    for column in found.T:
        rows[np.arange(found.shape[0]), p - 1 - column] += 1
    return rows


def multinomials(found: Integers) -> Array:
    """Multinomial coefficients m!/(i_1! .. i_p!) of stacks (T, m), exact to m = 18.

    >>> multinomials(stacks(2, 3)).tolist()
    [1.0, 2.0, 1.0, 2.0, 2.0, 1.0]
    """
    coefficient = np.ones(found.shape[0])
    run = np.ones(found.shape[0])
    for j in range(1, found.shape[1]):
        # m! over the product of how often each item's location has occurred so far
        run = np.where(found[:, j] == found[:, j - 1], run + 1.0, 1.0)
        coefficient = coefficient * (j + 1) / run
    return coefficient


def inner_products(basis: Basis, k: int, degree: int, m: int) -> Array:
    """<p_(i_1) .. p_(i_m)> of all degrees 0..d of parameter k, (d + 1, .., d + 1) with m axes.

    A Gauss rule gives them, exact to degree m d (paper, eq. (moments2.0)). Zero, and exactly so, is
    what orthogonality makes zero: a degree above the sum of the others, and an odd sum for a
    symmetric weight. For Hermite, Legendre and Laguerre polynomials nothing else is zero.

    >>> table = inner_products(Basis.normal(1), 0, degree=2, m=4)
    >>> table[[1, 2], [1, 1], [1, 1], [1, 0]].round(6).tolist()
    [3.0, 1.414214]
    """
    # order 1 is exact with fewer nodes than there are polynomials to evaluate
    _, weights, polynomials = basis.exact_rule(k, max(m, 2) * degree)
    product = weights
    for _ in range(m):
        product = product[..., None, :] * polynomials.T[: degree + 1]
    table = product.sum(axis=-1)
    degrees = np.indices(table.shape)
    total = degrees.sum(axis=0)
    vanishes = 2 * degrees.max(axis=0) > total
    if basis.symmetric(k, weights.size):
        vanishes |= total % 2 == 1
    return np.where(vanishes, 0.0, table)


@dataclass(frozen=True, eq=False)
class NonzeroSet:
    """The terms of mu_m = sum_(i in I*) a_i prod_k c_k^(i_k) (paper, eq. (moments3.0)).

    `factors` (T, m) holds for each term the positions of its m coefficients in the basis of `size`
    functions, in increasing order; `coefficients` (T,) the a_i: multinomial coefficient times inner
    product. The terms come in the order of push and fork.
    """

    size: int
    factors: Integers
    coefficients: Array

    @property
    def exponents(self) -> NDArray[np.int8]:
        """The multi-indices i themselves, (T, p)."""
        return exponents(self.size - 1 - self.factors, self.size)


def nonzero_set(basis: Basis, indices: Integers, m: int) -> NonzeroSet:
    """I*_(m,p): every multi-index of I_(m,p) whose inner product is not zero (the offline step).

    Cost O(m C(m + p - 1, m)) in time and memory.

    >>> indices = np.array([[0], [1], [2]])
    >>> terms = nonzero_set(Basis.normal(1), indices, 3)   # c0^3 + 3 c0 c1^2 + 3 c0 c2^2 + ...
    >>> terms.exponents.tolist()
    [[0, 0, 3], [0, 2, 1], [1, 0, 2], [1, 2, 0], [3, 0, 0]]
    >>> terms.coefficients.round(4).tolist()
    [2.8284, 4.2426, 3.0, 3.0, 1.0]
    """
    size, largest = len(indices), highest(indices)
    found = stacks(m, size)
    product = np.ones(found.shape[0])
    for k, degrees in enumerate(indices[::-1].T):
        value = inner_products(basis, k, largest[k], m)[tuple(degrees[found].T)]
        kept = value != 0.0
        found, product = found[kept], product[kept] * value[kept]
    return NonzeroSet(size, size - 1 - found, product * multinomials(found))


def raw_moment(terms: NonzeroSet, coefficients: Array) -> Array:
    """E[Y^m] (N,) of the expansions c (N, P) (paper, eq. (moments3.0)).

    Loses all digits of the scatter where the mean is large against it.

    >>> terms = nonzero_set(Basis.normal(1), np.array([[0], [1]]), 4)
    >>> raw_moment(terms, np.array([[1.0, 1.0]])).round(9).tolist()
    [10.0]
    """
    columns = np.ascontiguousarray(coefficients.T)
    product = np.repeat(terms.coefficients[:, None], columns.shape[1], axis=1)
    for position in terms.factors.T:
        product *= columns[position]
    return np.asarray(product.sum(axis=0))


def raw_moments(moments: Moments) -> Array:
    """E[Y^m] = sum_j C(m, j) mean^(m-j) E[(Y - mean)^j] for m = 0..M (paper, eq. (momentdef)).

    >>> from aleator.moments.moments import weighted_moments
    >>> raw_moments(weighted_moments(np.array([[1.0, 5.0]]), np.array([0.5, 0.5]), 3)).tolist()
    [[1.0, 3.0, 13.0, 63.0]]
    """
    central = moments.standardized * moments.sd[:, None] ** np.arange(moments.order + 1)
    raw = np.zeros_like(central)
    for m in range(moments.order + 1):
        for j in range(m + 1):
            raw[:, m] += comb(m, j) * moments.mean ** (m - j) * central[:, j]
    return raw
