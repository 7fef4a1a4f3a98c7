"""Univariate inner products <p_(d_1) .. p_(d_m)> of every multiset of m degrees, in one table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.expansion.moments.basis import Basis
from aleator.expansion.moments.multi_indices import count, positions, stacks
from aleator.types import Array


@dataclass(frozen=True, eq=False)
class InnerProducts:
    """`values` (S,) of all S = C(m + d, m) multisets of degrees 0..d, reached one degree at a time.

    A state is a multiset of m degrees; state 0 holds only zeros, and `step` (S, d + 1) is the
    state after one of the zeros was replaced. So the inner product of any m degrees is found by m
    look-ups, in whatever order they come.
    """

    values: Array
    step: NDArray[np.intp]

    def of(self, degrees: NDArray[np.intp]) -> Array:
        """Inner products (T,) of degrees (T, m)."""
        state = np.zeros(degrees.shape[0], dtype=np.intp)
        width = self.step.shape[1]
        for column in degrees.T:
            state = self.step.reshape(-1)[state * width + column]
        return self.values[state]


def inner_products(basis: Basis, k: int, m: int) -> InnerProducts:
    """The table of parameter k, by a Gauss rule exact to degree m d (paper, eq. (moments2.0)).

    Zero, and exactly so, is what orthogonality makes zero: a degree above the sum of the others
    (the product of the others holds no such polynomial), and an odd sum for a symmetric weight.
    For the Hermite, Legendre and Laguerre families nothing else is zero. Cost O(C(m + d, m) m d).

    >>> from aleator.polynomials.recurrence import hermite_recurrence
    >>> basis = Basis((hermite_recurrence(5),), np.array([[0], [1], [2]]))
    >>> inner_products(basis, 0, 4).of(np.array([[1, 1, 1, 1], [2, 1, 1, 0]])).round(6).tolist()
    [3.0, 1.414214]
    """
    degree = basis.degrees[k]
    # in push and fork's order, the distance from the last location is the degree
    multisets = stacks(0, count(m, degree + 1), m, degree + 1)
    # order 1 is exact with fewer nodes than there are polynomials to evaluate
    _, weights, polynomials = basis.rule(k, max(m, 2) * degree)
    product = np.ones((multisets.shape[0], weights.size))
    for column in multisets.T:
        product *= polynomials.T[column]
    values = product @ weights
    total = multisets.sum(axis=1)
    vanishes = 2 * multisets[:, 0] > total
    if basis.symmetric(k):
        vanishes |= total % 2 == 1
    values[vanishes] = 0.0
    return InnerProducts(values, _steps(multisets, degree))


def _steps(multisets: NDArray[np.int64], degree: int) -> NDArray[np.intp]:
    step = np.zeros((multisets.shape[0], degree + 1), dtype=np.intp)
    step[:, 0] = np.arange(multisets.shape[0])
    open_states = np.flatnonzero(multisets[:, -1] == 0)
    for added in range(1, degree + 1):
        reached = multisets[open_states]
        reached[:, -1] = added
        reached = -np.sort(-reached, axis=1)
        step[open_states, added] = positions(reached, degree + 1)
    return step
