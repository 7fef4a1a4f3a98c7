"""The part of a set {x: eta(x) = y} that goes through an interval or a triangle of a grid."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from aleator.types import Array, Indices

ALIKE, STEEP = 0.05, 0.5
"""Difference of a cell's slope from the mean of those at its corners, and of these from each other,
over the slope, up to which an outcome is smooth there."""
GAUSS = 0.5 / np.sqrt(3.0)
"""Distance of two points from the middle of a line, over its length, that integrate cubics."""
BELOW, ABOVE, NONE = np.array([1, 2, 4], dtype=np.uint8)
"""Where an outcome of the grid lies: not above what was measured, above it, or nowhere."""


def crossed(
    rows: Indices, y: Array, eta: Array, sides: tuple[Array, ...]
) -> tuple[Indices, Array, Array]:
    """Whose sets (H,) go through cells: points on them there x (H, s), and weights (H,).

    Of experiments `rows` (B,) with outcomes y (B,), and `eta` (B, P) at the points of a grid with
    these `sides`. A weight is the length of the set over the slope of the outcome.
    """
    shape = tuple(side.size for side in sides)
    whose, corners = _passed(y, eta, shape)
    v = eta[whose[:, None], corners]
    place = np.unravel_index(corners, shape)
    x = np.stack([side[i] for side, i in zip(sides, place, strict=True)], axis=-1)
    width = np.ptp(x, axis=1)
    slope = _slopes(eta, whose, corners, sides) * width[:, None]
    slopes = _smooth(_chord(v, x) * width, slope)
    volume = width.prod(axis=1) / math.factorial(len(sides))
    carried = np.concatenate([x, slopes[..., None]], axis=2)
    order = np.argsort(v, axis=1)
    v = np.take_along_axis(v, order, axis=1)
    carried = np.take_along_axis(carried, order[:, :, None], axis=1)
    inside = _on_line if len(sides) == 1 else _in_triangle
    found, density = inside(y[whose, None], v, carried)
    on, parts = found[..., :-1], found.shape[1]
    weight = (volume * density)[:, None] / found[..., -1]
    return np.repeat(rows[whose], parts), on.reshape(-1, len(sides)), weight.ravel() / parts


def _passed(y: Array, eta: Array, shape: tuple[int, ...]) -> tuple[Indices, Indices]:
    """Whose sets (H,) go through simplices, and the corners (H, s + 1) of these."""
    simplices = _simplices(*shape)
    below, above = (found.view(np.uint8) for found in (eta <= y[:, None], eta > y[:, None]))
    place = NONE - (NONE - BELOW) * below - (NONE - ABOVE) * above
    through = _together(place.reshape(len(y), *shape)) == BELOW | ABOVE
    whose, where = np.divmod(np.flatnonzero(through), len(simplices))
    return whose, simplices[where]


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


def _together(corners: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Where the corners (B, ...) of each simplex (B, C) lie, all together; see `_simplices`."""
    if corners.ndim == 2:
        return corners[:, :-1] | corners[:, 1:]
    both = corners[:, :-1, :-1] | corners[:, 1:, 1:]
    found = [both | other for other in (corners[:, 1:, :-1], corners[:, :-1, 1:])]
    return np.stack(found, axis=1).reshape(len(corners), -1)


def _slopes(eta: Array, whose: Indices, corners: Indices, sides: tuple[Array, ...]) -> Array:
    """Derivatives (H, C, s) of outcomes `whose` (H,) at corners (H, C), by differences."""
    shape = tuple(side.size for side in sides)
    found = []
    for i, (side, place) in enumerate(zip(sides, np.unravel_index(corners, shape), strict=True)):
        apart = math.prod(shape[i + 1 :])
        low, high = np.maximum(place - 1, 0), np.minimum(place + 1, side.size - 1)
        rise = (
            eta[whose[:, None], corners + (high - place) * apart]
            - eta[whose[:, None], corners + (low - place) * apart]
        )
        found.append(rise / (side[high] - side[low]))
    return np.stack(found, axis=-1)


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
