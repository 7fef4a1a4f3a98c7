"""Sets of multi-indices: which products of univariate polynomials an expansion holds.

A multi-index k (n,) stands for the product p_k1(theta_1) .. p_kn(theta_n). Every set here is
downward closed: with k it holds each k' <= k.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from aleator.errors import InputsError
from aleator.types import Array, Indices

MOST = 200_000
"""Multi-indices that a set may have: an expansion of more is a slip, and fills the memory."""
ROUNDING = 1e-9


class IndexSet(Protocol):
    """A choice of multi-indices that grows with `degree`."""

    @property
    def degree(self) -> int:
        """The largest degree of a polynomial of one parameter (before its limit)."""
        ...

    def lowered(self, degree: int) -> Self:
        """The same choice with another degree."""
        ...

    def indices(self, limits: Sequence[int | None]) -> Indices:
        """Multi-indices (P, n), entry i at most limits[i] (None: as far as the degree goes)."""
        ...


@dataclass(frozen=True)
class TotalDegree:
    """|k|_1 <= degree: P = (n + d)!/(n! d!) without limits, the set of the paper.

    Raises InputsError for a negative degree.

    >>> TotalDegree(2).indices((None, None)).tolist()
    [[0, 0], [0, 1], [1, 0], [0, 2], [1, 1], [2, 0]]
    >>> TotalDegree(2).indices((None,) * 10).shape           # 12!/(10! 2!) = 66
    (66, 10)
    """

    degree: int

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _check_degree(self.degree)

    def lowered(self, degree: int) -> TotalDegree:
        """The same choice with another degree."""
        return TotalDegree(degree)

    def indices(self, limits: Sequence[int | None]) -> Indices:
        """Multi-indices (P, n) in the order of their sum. Cost O(P n)."""
        tops = _within(limits, self.degree)
        return _below([np.arange(top + 1.0) for top in tops], self.degree)


@dataclass(frozen=True)
class Hyperbolic:
    """(sum_i k_i^q)^(1/q) <= degree with 0 < q <= 1: few products of many parameters.

    Blatman and Sudret, J. Comput. Phys. 230 (2011), sec. 3.2, with q = `norm`; q = 1 is
    `TotalDegree`, q towards 0 leaves only polynomials of single parameters. Raises InputsError for
    a negative degree or a norm that is not in (0, 1].

    >>> Hyperbolic(4).indices((None, None)).tolist()           # (1, 1): (1 + 1)^2 = 4
    [[0, 0], [0, 1], [1, 0], [0, 2], [1, 1], [2, 0], [0, 3], [3, 0], [0, 4], [4, 0]]
    """

    degree: int
    norm: float = 0.5

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _check_degree(self.degree)
        if not 0.0 < self.norm <= 1.0:
            raise InputsError(
                f"norm {self.norm} is not in (0, 1]", "use 1 for the total degree, 0.5 for few"
            )

    def lowered(self, degree: int) -> Hyperbolic:
        """The same choice with another degree."""
        return Hyperbolic(degree, self.norm)

    def indices(self, limits: Sequence[int | None]) -> Indices:
        """Multi-indices (P, n) in the order of their sum. Cost O(P n)."""
        costs: Array = np.arange(self.degree + 1.0) ** self.norm
        tops = _within(limits, self.degree)
        return _below([costs[: top + 1] for top in tops], self.degree**self.norm)


@dataclass(frozen=True)
class Anisotropic:
    """sum_i weights_i k_i <= degree: a parameter of weight 2 goes to half the degree.

    `weights` (n,) are at least 1, so that `degree` stays the largest degree of any parameter.
    Raises InputsError for a negative degree, a weight below 1, or weights of another number than
    the parameters.

    >>> Anisotropic(2, (1.0, 2.0)).indices((None, None)).tolist()
    [[0, 0], [0, 1], [1, 0], [2, 0]]
    """

    degree: int
    weights: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _check_degree(self.degree)
        if not all(1.0 <= weight < math.inf for weight in self.weights):
            raise InputsError(
                f"weights {self.weights} are not all at least 1",
                "divide them by the smallest: it belongs to the most important parameter",
            )

    def lowered(self, degree: int) -> Anisotropic:
        """The same choice with another degree."""
        return Anisotropic(degree, self.weights)

    def indices(self, limits: Sequence[int | None]) -> Indices:
        """Multi-indices (P, n) in the order of their sum. Cost O(P n)."""
        if len(self.weights) != len(limits):
            raise InputsError(
                f"{len(self.weights)} weights for {len(limits)} parameters",
                "give one weight a parameter",
            )
        tops = _within(limits, self.degree)
        steps: list[Array] = [np.arange(top + 1.0) for top in tops]
        costs: list[Array] = [w * k for w, k in zip(self.weights, steps, strict=True)]
        return _below(costs, self.degree)


def highest(indices: Indices) -> tuple[int, ...]:
    """The largest degree of each parameter among multi-indices (P, n).

    >>> highest(np.array([[0, 0], [3, 0], [1, 1]]))
    (3, 1)
    """
    return tuple(int(degree) for degree in indices.max(axis=0))


def constant(indices: Indices) -> int:
    """Where the constant polynomial stands among multi-indices (P, n).

    >>> constant(np.array([[1, 0], [0, 0]]))
    1
    """
    return int(np.flatnonzero(~indices.any(axis=1))[0])


def _below(costs: Sequence[Array], most: float) -> Indices:
    """Multi-indices whose costs, costs[i][k_i] for each parameter, sum to at most `most`.

    Parameter after parameter every partial index is extended by all degrees that it can afford.
    Degree zero is free, so that no partial index is ever lost: cost O(P n).
    """
    most = most * (1.0 + ROUNDING)
    found: Indices = np.zeros((1, 0), dtype=np.intp)
    spent = np.zeros(1)
    for cost in costs:
        counts = np.searchsorted(cost, most - spent, side="right")
        if counts.sum() > MOST:
            raise InputsError(
                f"the set holds more than {MOST} multi-indices",
                "lower the degree, or use Hyperbolic(degree) or fewer parameters",
            )
        parent = np.repeat(np.arange(len(found)), counts)
        degree = np.arange(len(parent)) - np.repeat(np.cumsum(counts) - counts, counts)
        found = np.column_stack([found[parent], degree])
        spent = spent[parent] + cost[degree]
    # by sum, then lexicographically: lexsort takes its last key first
    return found[np.lexsort((*found.T[::-1], found.sum(axis=1)))]


def _within(limits: Sequence[int | None], degree: int) -> tuple[int, ...]:
    return tuple(degree if limit is None else min(limit, degree) for limit in limits)


def _check_degree(degree: int) -> None:
    if degree < 0:
        raise InputsError(f"degree {degree} is negative", "use 0 or more")
