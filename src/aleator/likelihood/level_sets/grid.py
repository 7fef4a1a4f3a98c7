"""Where a simulator without noise gives just what was measured: points of a grid's cells."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from aleator.surrogates.responses import Divisible
from aleator.types import Array, Indices

SHARE = 0.09
"""Share of a grid's cells that each part of a law must have for the grid to serve; see `serves`."""
NARROW = 1e-3
"""Share of the width of a law below which a part of it needs no cells: it ends there."""
MOST = 250_000
"""Simulated values of the grid that are looked at together."""
BELOW, ABOVE, NONE = np.array([1, 2, 4], dtype=np.uint8)
"""Where an outcome of the grid lies: not above what was measured, above it, or nowhere."""


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid on which level sets are looked for.

    `response` is that of the distinct conditions, the simulator or surfaces; `condition` (N,) are
    those of the experiments. `sides` are rising values (C + 1,) of each of the parameters
    `scattered`, one or two; the others stay at their values in `x` (n,).
    """

    response: Divisible
    condition: Indices
    scattered: tuple[int, ...]
    sides: tuple[Array, ...]
    x: Array

    def serves(self, marks: Array) -> bool:
        """Whether a law is resolved on this grid, of which `marks` (s, Q) are rising quantiles.

        It lies inside, and between two marks there are so many cells as its shape asks for.
        """
        for side, own in zip(self.sides, marks, strict=True):
            if own[0] < side[0] or side[-1] < own[-1]:
                return False
            wide = np.diff(own) > NARROW * (own[-1] - own[0])
            cells = np.diff(np.searchsorted(side, own))
            if np.any(cells[wide] < SHARE * (side.size - 1)):
                return False
        return True

    def traced(self, y: Array) -> tuple[Array, Array]:
        """Points (N, K, n) and log weights (N, K) of the sets {x: eta_l(x) = y_l}, y (N,).

        int p(x) delta(eta_l(x) - y_l) dx = sum_k w_lk p(x_lk). The outcome is linear between the
        corners of an interval or a triangle, where a set is then a point or a straight line: an
        error of second order in the size of the cells, and of first order in those that a kink or
        a jump crosses. Cost: the response of each condition at all points.
        """
        corners = np.meshgrid(*self.sides, indexing="ij")
        points = np.tile(self.x, (corners[0].size, 1))
        points[:, [*self.scattered]] = np.stack([part.ravel() for part in corners], axis=1)
        shape = corners[0].shape
        simplices = _simplices(*shape)
        volume = _volumes(points[:, [*self.scattered]], simplices)
        found = [
            _crossed(rows, y[rows], eta, points, simplices, volume, shape)
            for rows, eta in self._simulated(points)
        ]
        owner, x, weight = (np.concatenate(part) for part in zip(*found, strict=True))
        return _in_rows(y.size, owner, x, weight)

    def _simulated(self, points: Array) -> Iterator[tuple[Indices, Array]]:
        """Experiments (B,) with their outcomes (B, P) at the points, so many as fit together."""
        count = int(self.condition.max()) + 1
        block = max(1, MOST // len(points))
        for first in range(0, count, block):
            own = np.arange(first, min(first + block, count))
            eta = self.response.take(own).evaluate(points)
            rows = np.flatnonzero((first <= self.condition) & (self.condition < first + block))
            for part in np.array_split(rows, max(1, -(-rows.size // block))):
                yield part, eta[self.condition[part] - first]


@lru_cache
def _simplices(*points: int) -> Indices:
    """The corners (C, s + 1) of the intervals, or of the two triangles of each rectangle."""
    number = np.arange(math.prod(points)).reshape(points)
    if number.ndim == 1:
        return np.stack([number[:-1], number[1:]], axis=1)
    low, high = number[:-1, :-1].ravel(), number[1:, 1:].ravel()
    ends = [np.stack([low, other.ravel(), high], axis=1)
            for other in (number[1:, :-1], number[:-1, 1:])]  # fmt: skip
    return np.concatenate(ends)


def _volumes(points: Array, simplices: Indices) -> Array:
    """(C,) of simplices with corners in points (P, s): two of their sides are along the axes."""
    corners = points[simplices]
    width = np.ptp(corners, axis=1)
    return np.asarray(width.prod(axis=1) / math.factorial(points.shape[1]))


def _crossed(
    rows: Indices,
    y: Array,
    eta: Array,
    points: Array,
    simplices: Indices,
    volume: Array,
    shape: tuple[int, ...],
) -> tuple[Indices, Array, Array]:
    """Whose set (H,) goes through which simplex: its middle there x (H, n), and its weight (H,)."""
    below, above = (found.view(np.uint8) for found in (eta <= y[:, None], eta > y[:, None]))
    side = NONE - (NONE - BELOW) * below - (NONE - ABOVE) * above
    crossed = _sides(side.reshape(len(y), *shape)) == BELOW | ABOVE
    whose, where = np.divmod(np.flatnonzero(crossed), len(simplices))
    corners = simplices[where]
    v, x = eta[whose[:, None], corners], points[corners]
    order = np.argsort(v, axis=1)
    v, x = np.take_along_axis(v, order, axis=1), np.take_along_axis(x, order[:, :, None], axis=1)
    inside = _on_line if corners.shape[1] == 2 else _in_triangle
    middle, density = inside(y[whose, None], v, x)
    return rows[whose], middle, volume[where] * density


def _sides(corners: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Where the corners (B, ...) of each simplex (B, C) lie, all together; see `_simplices`."""
    if corners.ndim == 2:
        return corners[:, :-1] | corners[:, 1:]
    both = corners[:, :-1, :-1] | corners[:, 1:, 1:]
    found = [both | other for other in (corners[:, 1:, :-1], corners[:, :-1, 1:])]
    return np.stack(found, axis=1).reshape(len(corners), -1)


def _on_line(y: Array, v: Array, x: Array) -> tuple[Array, Array]:
    """Where the outcome is y (H, 1) between corners x (H, 2, n) with sorted outcomes v (H, 2).

    And the density of the outcome at a point that is anywhere with the same probability.
    """
    length = v[:, 1:] - v[:, :1]
    return x[:, 0] + (y - v[:, :1]) / length * (x[:, 1] - x[:, 0]), 1.0 / length[:, 0]


def _in_triangle(y: Array, v: Array, x: Array) -> tuple[Array, Array]:
    """The same in triangles, corners x (H, 3, n): the middle of the line."""
    first, second, third = v[:, :1], v[:, 1:2], v[:, 2:]
    below = y < second
    whole = third - first
    one = x[:, 0] + (y - first) / whole * (x[:, 2] - x[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        left, right = (y - first) / (second - first), (third - y) / (third - second)
    share = np.where(below, left, right)
    corner = np.where(below, x[:, 0], x[:, 2])
    other = corner + share * (x[:, 1] - corner)
    return 0.5 * (one + other), (2.0 * share / whole)[:, 0]


def _in_rows(count: int, owner: Indices, x: Array, weight: Array) -> tuple[Array, Array]:
    """Points (N, K, n) and log weights (N, K) of each experiment; weights of zero fill the rows."""
    order = np.argsort(owner, kind="stable")
    owner, x, weight = owner[order], x[order], weight[order]
    many = np.bincount(owner, minlength=count)
    place = np.arange(owner.size) - np.repeat(np.cumsum(many) - many, many)
    filled = np.broadcast_to(x[:1] if len(x) else 0.0, (count, max(many.max(), 1), x.shape[1]))
    points, log_weight = filled.copy(), np.full(filled.shape[:2], -np.inf)
    points[owner, place] = x
    with np.errstate(divide="ignore"):
        log_weight[owner, place] = np.log(weight)
    return points, log_weight
