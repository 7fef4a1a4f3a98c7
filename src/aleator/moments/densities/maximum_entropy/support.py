"""How far a density reaches where no physical range ends it: a smooth function of its moments.

The moments c_0..c_M of a law of u on [-r, r] obey, for every polynomial q (Krein and Nudelman,
the truncated moment problem),

    M = 2m:    E[(r^2 - u^2) q^2] > 0, degree below m:    r^2 > eigenvalues of X = A^-1 B,
    M = 2m+1:  E[(r +- u) q^2] > 0, degree not above m:   r > |eigenvalues| of X = A^-1 B,

with the Hankel matrices A = (c_(i+j)), and B = (c_(i+j+2)) for even M, (c_(i+j+1)) for odd M. The
sum of these squares, s = tr X or tr X^2, is above the largest and, unlike it, differentiable:

    r(c)^2 = sqrt(least^4 + (2 s)^2).

For the normal law s is m^2 at M = 2m, which leaves r at `least`; for the cube of a normal variable
it is 47 at M = 4 and 268 at M = 6, so that its moments lie within 11 and 23 standard deviations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.moments.densities.interface import Codes
from aleator.moments.densities.maximum_entropy.legendre import SMALLEST_PIVOT, cholesky, substitute
from aleator.types import Array, Flags

_WIDENING = 2.0
"""The least that some law needs has no density; with twice its square an edge may also be fixed."""


@dataclass(frozen=True)
class Reach:
    """Standard deviations r (N,) on either side of the mean, and dr/dc (N, M+1)."""

    width: Array
    slope: Array


@dataclass(frozen=True)
class Support:
    """Edges a, b (N,) in standard deviations from the mean.

    `lower_moves`, `upper_moves` (N,) tell the edges that the physical range has set; the others
    lie at the reach, whose derivatives by the standardized moments are `slope` (N, M+1).
    """

    a: Array
    b: Array
    lower_moves: Flags
    upper_moves: Flags
    slope: Array

    def replaced(self, rows: Codes, other: Support, kept: Flags) -> Support:
        """The support with the kept rows of another, of lower order, in these rows."""
        a, b, slope = self.a.copy(), self.b.copy(), self.slope.copy()
        lower_moves, upper_moves = self.lower_moves.copy(), self.upper_moves.copy()
        a[rows], b[rows] = other.a[kept], other.b[kept]
        lower_moves[rows], upper_moves[rows] = other.lower_moves[kept], other.upper_moves[kept]
        slope[rows] = 0.0
        slope[rows, : other.slope.shape[1]] = other.slope[kept]
        return Support(a, b, lower_moves, upper_moves, slope)


def support_of(lower: Array, upper: Array, standardized: Array, least: float) -> Support:
    """The physical range lower < 0 < upper (N,) in standard deviations, cut at the reach."""
    reach = reach_of(standardized, least)
    lower_moves, upper_moves = lower > -reach.width, upper < reach.width
    return Support(
        np.where(lower_moves, lower, -reach.width),
        np.where(upper_moves, upper, reach.width),
        lower_moves,
        upper_moves,
        reach.slope,
    )


def reach_of(standardized: Array, least: float) -> Reach:
    """Reach for the standardized moments (N, M+1), at least `least`; cost O(N M^3).

    ds = tr(A^-1 dB) - tr(X A^-1 dA) for even M, 2 tr(X A^-1 dB) - 2 tr(X^2 A^-1 dA) for odd M.
    Moments that no law on the real line has get `least` and slope zero.

    >>> r = reach_of(np.array([[1.0, 0.0, 1.0, 0.0, 3.0]]), 8.0)  # (8^4 + (2 * 4)^2)^(1/4)
    >>> float(r.width[0]), r.slope[0, 3:].round(6).tolist()
    (8.031068, [0.0, 0.015444])
    """
    odd = standardized.shape[1] % 2 == 0
    size, shift = (standardized.shape[1] - 1) // 2 + odd, 1 if odd else 2
    place = np.add.outer(np.arange(size), np.arange(size))
    factor, pivot = cholesky(standardized[:, place])
    x = _solve(factor, standardized[:, place + shift])
    inverse = _solve(factor, np.broadcast_to(np.eye(size), x.shape))
    by_b, by_a = (2.0 * x @ inverse, -2.0 * x @ x @ inverse) if odd else (inverse, -x @ inverse)
    total = np.trace(x @ x if odd else x, axis1=1, axis2=2)
    usable = (pivot > SMALLEST_PIVOT) & (total > 0.0)
    total = np.where(usable, total, 0.0)
    squared = np.hypot(least**2, _WIDENING * total)
    width = np.sqrt(squared)
    slope = np.zeros_like(standardized)
    for i in range(size):
        for j in range(size):
            slope[:, i + j + shift] += by_b[:, i, j]
            slope[:, i + j] += by_a[:, i, j]
    by_total = 0.5 * _WIDENING**2 * total / (width * squared)
    return Reach(width, np.where(usable[:, None], by_total[:, None] * slope, 0.0))


def _solve(factor: Array, right: Array) -> Array:
    """A^-1 R (N, m, m) for the factors of A, a column of R (N, m, m) at a time."""
    columns = [substitute(factor, right[:, :, j]) for j in range(right.shape[2])]
    return np.stack(columns, axis=2)
