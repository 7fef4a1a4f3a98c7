"""The basis of an expansion: products of univariate orthonormal polynomials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.errors import InputsError
from aleator.expansion.moments.rules import polished_rule, symmetric
from aleator.types import Array

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Basis:
    """psi_i(theta) = prod_k p^(k)_(i_k)(theta_k), one function for each multi-index.

    `recurrences` holds, for each of the n parameters, the coefficients (a, b) of the three-term
    recurrence of its orthonormal family (`aleator.polynomials`); moments of order M need
    floor(M d_k/2) + 1 of each, where d_k is the parameter's largest degree. `indices` (P, n) are
    the multi-indices in the order of the coefficients, in any order and of any shape, the constant
    among them. Raises InputsError for indices that are negative, double or without the constant.

    >>> from aleator.polynomials.recurrence import hermite_recurrence
    >>> basis = Basis((hermite_recurrence(7),), np.array([[0], [1], [2]]))
    >>> basis.degrees, basis.constant
    ((2,), 0)
    """

    recurrences: tuple[tuple[Array, Array], ...]
    indices: Indices

    def __post_init__(self) -> None:
        """Copy, check and freeze the arrays."""
        given = np.asarray(self.indices)
        indices = np.array(given, dtype=np.int64, order="C", copy=True)
        if indices.ndim != 2 or indices.shape[1] != len(self.recurrences) or indices.size == 0:
            raise InputsError(
                f"multi-indices of shape {given.shape} for {len(self.recurrences)} recurrences",
                "give an array (P, n) and one pair (a, b) for each of the n parameters",
            )
        if np.any(indices != given) or indices.min() < 0:
            raise InputsError("a multi-index is negative or not whole", "give degrees 0, 1, 2, ...")
        if len(np.unique(indices, axis=0)) < len(indices):
            raise InputsError("a multi-index occurs twice", "give each once")
        if np.all(indices.any(axis=1)):
            raise InputsError(
                "the multi-indices lack the constant", "add the row of zeros: it carries the mean"
            )
        indices.setflags(write=False)
        object.__setattr__(self, "indices", indices)
        object.__setattr__(self, "recurrences", tuple(_frozen(a, b) for a, b in self.recurrences))

    @property
    def size(self) -> int:
        """P, the number of functions (the paper's p)."""
        return int(self.indices.shape[0])

    @property
    def degrees(self) -> tuple[int, ...]:
        """The largest degree of each parameter."""
        return tuple(int(degree) for degree in self.indices.max(axis=0))

    @property
    def constant(self) -> int:
        """The position of the constant function, whose coefficient is the mean."""
        return int(np.flatnonzero(~self.indices.any(axis=1))[0])

    def symmetric(self, k: int) -> bool:
        """Whether the weight of parameter k is symmetric, so that odd inner products vanish."""
        return symmetric(*self.recurrences[k])

    def rule(self, k: int, degree: int) -> tuple[Array, Array, Array]:
        """Gauss rule of parameter k exact to `degree`: nodes, weights, polynomials p_0..p_(q-1)."""
        return polished_rule(*self.recurrences[k], degree)

    def check(self, order: int) -> None:
        """Raise InputsError if the recurrences are too short for moments of this order."""
        if order < 2:
            raise InputsError(f"order {order} of the moments", "ask for order 2 or more")
        for k, (degree, (a, _)) in enumerate(zip(self.degrees, self.recurrences, strict=True)):
            needed = order * degree // 2 + 1
            if a.size < needed:
                raise InputsError(
                    f"parameter {k}: {a.size} recurrence coefficients, but moments of order "
                    f"{order} of degree {degree} need {needed}",
                    f"give the recurrence of the family with count={needed}",
                )


def _frozen(a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    pair = np.array(a, dtype=float), np.array(b, dtype=float)
    if pair[0].ndim != 1 or pair[0].shape != pair[1].shape or pair[0].size == 0:
        raise InputsError(
            f"recurrence coefficients of shapes {pair[0].shape} and {pair[1].shape}",
            "give two arrays (count,) of the same count",
        )
    if not np.all(np.isfinite(pair)) or np.any(pair[1] <= 0.0):
        raise InputsError(
            "a recurrence coefficient is not finite, or a b_k is not positive",
            "use the recurrence of a weight that integrates to one and has enough points",
        )
    for array in pair:
        array.setflags(write=False)
    return pair
