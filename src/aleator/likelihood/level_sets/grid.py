"""Where a simulator without noise gives just what was measured: points of a grid's cells."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from aleator.surrogates.responses import Divisible
from aleator.types import Array, Indices

SHARE = 0.09
"""Share of a grid's cells that each part of a law must have for the grid to serve; see `serves`."""
NARROW = 1e-3
"""Share of the width of a law below which a part of it needs no cells: it ends there."""
LEAST = 1e-3
"""Share of its changes that an outcome is taken to have along each side, at least."""
ALIKE, STEEP = 0.05, 0.5
"""Difference of a cell's slope from the mean of those at its corners, and of these from each other,
over the slope, up to which an outcome is smooth there."""
GAUSS = 0.5 / np.sqrt(3.0)
"""Distance of two points from the middle of a line, over its length, that integrate cubics."""
MOST = 4_000_000
"""Simulated values of the grid that are looked at together."""


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
        points = self._points
        own = points[:, [*self.scattered]]
        simplices = _simplices(*(side.size for side in self.sides))
        found = [
            _crossed(rows, y[rows], eta, self._slopes(eta), own, simplices)
            for rows, eta in self._simulated(points)
        ]
        owner, on, weight = (np.concatenate(part) for part in zip(*found, strict=True))
        x = np.tile(self.x, (len(on), 1))
        x[:, [*self.scattered]] = on
        return _in_rows(y.size, owner, x, weight)

    def changes(self) -> Array:
        """How much an outcome changes along each side (s,), over what it changes along all.

        The geometric mean over the experiments of the sums of all steps. Cost: all points.
        """
        shape = tuple(side.size for side in self.sides)
        eta = np.concatenate([part for _, part in self._simulated(self._points)])
        by_side = [
            np.nansum(np.abs(np.diff(eta.reshape(-1, *shape), axis=1 + i)).reshape(len(eta), -1), 1)
            for i in range(len(shape))
        ]
        whole = np.maximum(np.sum(by_side, axis=0), np.finfo(np.float64).tiny)
        return np.asarray(np.exp(np.mean(np.log(np.maximum(by_side / whole, LEAST)), axis=1)))

    def _slopes(self, eta: Array) -> Array:
        """Derivatives (B, P, s) of outcomes (B, P) by differences of second order."""
        shape = tuple(side.size for side in self.sides)
        axes = range(1, 1 + len(shape))
        values = eta.reshape(-1, *shape)
        found = [
            np.gradient(values, side, axis=axis)
            for side, axis in zip(self.sides, axes, strict=True)
        ]
        return np.stack(found, axis=-1).reshape(*eta.shape, -1)

    @property
    def _points(self) -> Array:
        """All points of the grid, (P, n)."""
        corners = np.meshgrid(*self.sides, indexing="ij")
        points = np.tile(self.x, (corners[0].size, 1))
        points[:, [*self.scattered]] = np.stack([part.ravel() for part in corners], axis=1)
        return points

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


def _crossed(
    rows: Indices, y: Array, eta: Array, slope: Array, points: Array, simplices: Indices
) -> tuple[Indices, Array, Array]:
    """Whose sets (H,) go through simplices: points on them there x (H, s), and weights (H,)."""
    low, high = np.full((2, len(y), len(simplices)), eta[:, simplices[:, 0]])
    for corner in simplices.T[1:]:
        np.minimum(low, eta[:, corner], out=low)
        np.maximum(high, eta[:, corner], out=high)
    whose, where = np.nonzero((low <= y[:, None]) & (y[:, None] < high))
    corners = simplices[where]
    v, x = eta[whose[:, None], corners], points[corners]
    width = np.ptp(x, axis=1)
    slopes = _smooth(_chord(v, x) * width, slope[whose[:, None], corners] * width[:, None])
    volume = width.prod(axis=1) / math.factorial(x.shape[2])
    carried = np.concatenate([x, slopes[..., None]], axis=2)
    order = np.argsort(v, axis=1)
    v = np.take_along_axis(v, order, axis=1)
    carried = np.take_along_axis(carried, order[:, :, None], axis=1)
    inside = _on_line if x.shape[2] == 1 else _in_triangle
    found, density = inside(y[whose, None], v, carried)
    on, parts = found[..., :-1], found.shape[1]
    weight = (volume * density)[:, None] / found[..., -1]
    return np.repeat(rows[whose], parts), on.reshape(-1, x.shape[2]), weight.ravel() / parts


def _chord(v: Array, x: Array) -> Array:
    """The gradient (H, s) of what is linear between corners x (H, s + 1, s) of outcomes v."""
    rise, side = v[:, 1:] - v[:, :1], x[:, 1:] - x[:, :1]
    if x.shape[2] == 1:
        return np.asarray(rise / side[:, 0])
    (a, b), (c, d) = np.moveaxis(side, 0, -1)
    first, second = rise.T
    slope = np.stack([first * d - second * b, second * a - first * c], axis=1)
    return np.asarray(slope / (a * d - b * c)[:, None])


def _smooth(chord: Array, slope: Array) -> Array:
    """Slopes at the corners (H, C) over the chord's; 1 beside a kink or a jump.

    `chord` (H, s) is the gradient between the corners, `slope` (H, C, s) are those at the corners,
    all by the width of the cell. Where the outcome is smooth these have the chord as their mean, to
    second order.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.einsum("hcs,hs->hc", slope, chord) / np.sum(chord**2, axis=1)[:, None]
        mean = along.mean(axis=1, keepdims=True)
        off = np.abs(along - mean).max(axis=1, keepdims=True)
        smooth = (np.abs(mean - 1.0) < ALIKE) & (off < STEEP)
        return np.asarray(np.where(smooth, along, 1.0))


def _on_line(y: Array, v: Array, x: Array) -> tuple[Array, Array]:
    """Where (H, 1, C) the outcome is y (H, 1) between corners x (H, 2, C), of outcomes v (H, 2).

    The outcomes are sorted. And the density (H,) of the outcome at a point that is anywhere with
    the same probability.
    """
    length = v[:, 1:] - v[:, :1]
    on = x[:, 0] + (y - v[:, :1]) / length * (x[:, 1] - x[:, 0])
    return on[:, None], 1.0 / length[:, 0]


def _in_triangle(y: Array, v: Array, x: Array) -> tuple[Array, Array]:
    """The same in triangles, corners x (H, 3, C): two points of Gauss (H, 2, C) on the line."""
    first, second, third = v[:, :1], v[:, 1:2], v[:, 2:]
    below = y < second
    whole = third - first
    one = x[:, 0] + (y - first) / whole * (x[:, 2] - x[:, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        left, right = (y - first) / (second - first), (third - y) / (third - second)
    share = np.where(below, left, right)
    corner = np.where(below, x[:, 0], x[:, 2])
    other = corner + share * (x[:, 1] - corner)
    middle, off = 0.5 * (one + other), GAUSS * (one - other)
    return np.stack([middle - off, middle + off], axis=1), (2.0 * share / whole)[:, 0]


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
