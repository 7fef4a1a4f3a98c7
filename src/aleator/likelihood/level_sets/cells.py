"""The part of a level set {x: eta(x) = y} that lies in an interval or a triangle of a grid."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array, Flags, Indices


@dataclass(frozen=True)
class CellSettings:
    """Settings of grid cells: the test for a smooth outcome, and the number of halvings.

    The values are chosen by judgement. `steep`: the outcome counts as smooth in a cell if the
    slopes at its corners differ from their mean by less than this, relative to the slope of the
    cell. `halvings`: the largest number of times that a cell which is not smooth is halved.
    """

    steep: float = 0.1
    halvings: int = 8


CELLS = CellSettings()
GAUSS = 0.5 / np.sqrt(3.0)
"""The distance of the two Gauss points from the middle of a line, relative to its length."""
BELOW, ABOVE, NONE = np.array([1, 2, 4], dtype=np.uint8)
"""Codes for an outcome on the grid: not above the measured one, above it, or not finite."""

At = Callable[[Indices, Array], Array]
"""A function that gives the outcomes (R,) of experiments (R,) at one point (R, s) for each."""


def crossed(
    rows: Indices,
    y: Array,
    condition: Indices,
    eta: Array,
    sides: tuple[Array, ...],
    at: At,
    alike: float,
    settings: CellSettings = CELLS,
) -> tuple[Indices, Array, Array]:
    """The level sets in the cells of a grid, as points: experiments (H,), points (H, s), weights.

    `rows` (B,) are the experiments and y (B,) their measured outcomes. `sides` are the coordinates
    of the grid. `eta` (C, P) are the simulated outcomes of C conditions at the P grid points, and
    `condition` (B,) is the number of each experiment's condition. A weight (H,) is the length of
    the set in the cell, divided by the slope of the outcome. A cell is halved where the slopes at
    its corners do not explain its outcomes to the relative tolerance `alike`, and where a set may
    be hidden between its corners: near an extreme, a saddle, a fold or a kink. The function `at`
    then gives the outcomes at further points.
    """
    shape = tuple(side.size for side in sides)
    whose, cell, corners = _passed(y, eta[condition], shape)
    place = np.unravel_index(corners, shape)
    x = np.stack([side[i] for side, i in zip(sides, place, strict=True)], axis=-1)
    of = condition[whose]
    slope = slopes_at(eta, of, corners, sides) * np.ptp(x, axis=1, keepdims=True)
    v = eta[of[:, None], corners]
    slopes, smooth = smoothed(v, unit(x), slope, alike, settings.steep)
    count = math.prod(size - 1 for size in shape)
    through, bent = whose * count + cell, hiding(y, condition, eta, sides)
    bent = np.union1d(through[~smooth], bent)
    kept = ~np.isin(through, bent)
    whole = (rows[whose[kept]], *pieces(y[whose[kept]], v[kept], x[kept], slopes[kept]))
    index, ends, outcomes = cells_of(bent, condition, eta, sides)
    parts = _halved(rows[index], y[index], ends, outcomes, at, alike, settings)
    every = [listed(*whole), *(listed(*part) for part in parts)]
    owner, on, weight = (np.concatenate(one) for one in zip(*every, strict=True))
    return owner, on, weight


def cells_of(
    number: Indices, condition: Indices, eta: Array, sides: tuple[Array, ...]
) -> tuple[Indices, Array, Array]:
    """The cells of these numbers (M,): experiments (M,), ends (2, M, s), outcomes (M, 2 [, 2]).

    The cells of each experiment are numbered after those of the one before. `ends` are the lower
    and upper coordinates, and the outcomes are those at the corners; see `crossed`.
    """
    shape = tuple(side.size for side in sides)
    few = tuple(size - 1 for size in shape)
    index, where = np.divmod(number, math.prod(few))
    low = np.unravel_index(where, few)
    ends = [np.stack([side[i], side[i + 1]]) for side, i in zip(sides, low, strict=True)]
    first = np.ravel_multi_index(low, shape)
    far = np.array([0, 1, shape[-1], shape[-1] + 1])[: 2 ** len(shape)]
    outcomes = eta[condition[index][:, None], first[:, None] + far]
    return index, np.stack(ends, axis=-1), outcomes.reshape(-1, *[2] * len(shape))


def unit(x: Array) -> Array:
    """The corners (H, s + 1, s) of simplices in coordinates that run from 0 to 1 in their cells."""
    low = x.min(axis=1, keepdims=True)
    return np.asarray((x - low) / (x.max(axis=1, keepdims=True) - low))


def pieces(y: Array, v: Array, x: Array, slopes: Array) -> tuple[Array, Array]:
    """Points (H, C, s) and weights (H, C) of the level sets in simplices.

    A simplex is an interval or a triangle with corners x (H, s + 1, s). It has the outcomes v
    (H, s + 1) and the `slopes` (H, s + 1, s), in widths of the cell, at its corners. For a
    quadratic outcome the error is of third order in the difference of the slopes.
    """
    within = _on_line if x.shape[2] == 1 else _in_triangle
    low, width = x.min(axis=1), np.ptp(x, axis=1)
    found, weight = within(y, v, unit(x), slopes)
    return low[:, None] + found * width[:, None], weight * width.prod(axis=1, keepdims=True)


def listed(whose: Indices, on: Array, weight: Array) -> tuple[Indices, Array, Array]:
    """The experiments (H C,), points (H C, s) and weights (H C,), as flat lists of all points."""
    return np.repeat(whose, on.shape[1]), on.reshape(-1, on.shape[2]), weight.ravel()


def _halved(
    rows: Indices,
    y: Array,
    ends: Array,
    v: Array,
    at: At,
    alike: float,
    settings: CellSettings,
) -> Iterator[tuple[Indices, Array, Array]]:
    """The level sets in M cells, which are halved until the outcome is smooth in them.

    Yields experiments (H,), points (H, C, s) and weights (H, C) after every halving. `rows` (M,)
    are the experiments of the cells, and y (M,) their measured outcomes. `ends` (2, M, s) are the
    lower and upper coordinates of the cells, and v (M, 2) or (M, 2, 2) the outcomes at their
    corners. A part in which the outcome is smooth is finished. A part that cannot contain the set
    is left out. Any other part is halved again.
    """
    s = ends.shape[2]
    triangles = simplices_of(*[2] * s)
    place = np.stack(np.unravel_index(triangles, (2,) * s), axis=-1)
    for left in reversed(range(settings.halvings)):
        if not rows.size:
            return
        ends, v, slope, bend = halves_of(rows, ends, v, at)
        rows, y = np.tile(rows, 2**s), np.tile(y, 2**s)
        flat = v.reshape(len(v), 2**s)
        known = np.asarray(np.isfinite(flat).all(axis=1))
        corner = flat[:, triangles]
        on = known[:, None] & (corner.min(axis=2) <= y[:, None]) & (y[:, None] < corner.max(axis=2))
        cell, which = np.nonzero(on)
        low, width = ends[0, cell], ends[1, cell] - ends[0, cell]
        x = low[:, None] + place[which] * width[:, None]
        steps, smooth = smoothed(
            corner[on],
            place[which].astype(float),
            slope[cell[:, None], triangles[which]],
            alike,
            settings.steep,
        )
        rough = np.bincount(cell[~smooth], minlength=len(v)) > 0 if left else np.zeros(len(v), bool)
        done = ~rough[cell]
        yield (
            rows[cell[done]],
            *pieces(y[cell[done]], corner[on][done], x[done], steps[done]),
        )
        near = known & (np.abs(flat - y[:, None]).min(axis=1) < 0.5 * bend)
        again = np.where(on.any(axis=1), rough, near)
        rows, y, ends, v = rows[again], y[again], ends[:, again], v[again]


@np.errstate(invalid="ignore")
def halves_of(rows: Indices, ends: Array, v: Array, at: At) -> tuple[Array, Array, Array, Array]:
    """The 2^s M halves of M cells: ends (2, 2^s M, s), outcomes, slopes, and bends (2^s M,).

    The outcomes (2^s M, 2) or (2^s M, 2, 2) are those at the corners of the halves, and the slopes
    (2^s M, 2^s, s) are in widths of a half. A bend is the change of the outcome in a cell by its
    curvature. The halves at one place of all cells are followed by those at the next place. The
    arguments are those of `_halved`.
    """
    s = ends.shape[2]
    sides = np.stack([ends[0], ends.mean(axis=0), ends[1]])
    full = _between(rows, sides, v, at)
    slope = _by_parabolas(full)
    bend = sum(np.abs(np.diff(full, 2, axis=1 + i)).reshape(len(full), 3 ** (s - 1)).max(1)
               for i in range(s))  # fmt: skip
    halves = list(product((0, 1), repeat=s))
    part = [(np.s_[:], *[np.s_[i : i + 2] for i in half]) for half in halves]
    v = np.concatenate([full[one] for one in part])
    slope = np.concatenate([slope[one] for one in part]).reshape(len(v), 2**s, s)
    ends = np.stack([
        np.concatenate([
            np.stack([sides[i + more, :, k] for k, i in enumerate(half)], axis=1)
            for half in halves
        ]) for more in (0, 1)
    ])  # fmt: skip
    return ends, v, slope, np.tile(bend, len(halves))


def _between(rows: Indices, sides: Array, v: Array, at: At) -> Array:
    """The outcomes at the corners and midpoints of M cells.

    They are (M, 3) for one parameter and (M, 3, 3) for two. `sides` (3, M, s) has the lower, middle
    and upper coordinate of each cell. v has the outcomes at the corners, which are known.
    """
    s = sides.shape[2]
    found = np.empty((len(v), *[3] * s))
    found[(np.s_[:], *[np.s_[::2]] * s)] = v
    new = [place for place in product((0, 1, 2), repeat=s) if 1 in place]
    points = [np.stack([sides[i, :, k] for k, i in enumerate(place)], axis=1) for place in new]
    outcomes = at(np.tile(rows, len(new)), np.concatenate(points)).reshape(len(new), len(v))
    for place, outcome in zip(new, outcomes, strict=True):
        at_place: tuple[slice | int, ...] = (slice(None), *place)
        found[at_place] = outcome
    return found


def _by_parabolas(v: Array) -> Array:
    """Slopes (M, 3, s) or (M, 3, 3, s) of outcomes v (M, 3) or (M, 3, 3), per grid step.

    They are the slopes of the parabola through three neighboring points.
    """
    found = []
    for i in range(1, v.ndim):
        low, here, high = np.moveaxis(v, i, 0)
        ends = [4.0 * here - 3.0 * low - high, high - low, 3.0 * high + low - 4.0 * here]
        found.append(0.5 * np.stack(ends, axis=i))
    return np.stack(found, axis=-1)


def _passed(y: Array, eta: Array, shape: tuple[int, ...]) -> tuple[Indices, Indices, Indices]:
    """The simplices through which level sets go: experiments (H,), cells (H,), corners (H, s + 1).

    A simplex is an interval or a triangle. A set goes through it if some corner has an outcome
    above the measured one and some corner has not.
    """
    simplices = simplices_of(*shape)
    below, above = (found.view(np.uint8) for found in (eta <= y[:, None], eta > y[:, None]))
    place = NONE - (NONE - BELOW) * below - (NONE - ABOVE) * above
    through = _together(place.reshape(len(y), *shape)) == BELOW | ABOVE
    whose, where = np.divmod(np.flatnonzero(through), len(simplices))
    return whose, where % math.prod(size - 1 for size in shape), simplices[where]


@np.errstate(invalid="ignore")
def hiding(y: Array, condition: Indices, eta: Array, sides: tuple[Array, ...]) -> Indices:
    """The numbers of the cells that may contain a level set although their corners do not show it.

    The outcomes at all corners of such a cell are on the same side of the measured one, but at one
    corner the difference is smaller than the change that the curvature can make within a cell.
    """
    v = eta.reshape(len(eta), *(side.size for side in sides))
    bend = np.zeros_like(v)
    for i, side in enumerate(sides, 1):
        width = np.diff(side).reshape(-1, *[1] * (len(sides) - i))
        inner = np.abs(np.diff(np.diff(v, axis=i) / width, axis=i))
        inner *= np.maximum(width[:-1], width[1:])
        ends = [(1, 1) if k == i else (0, 0) for k in range(v.ndim)]
        bend += np.pad(inner, ends, mode="edge")
    bend *= 0.5
    near = np.abs(v[condition] - y.reshape(-1, *[1] * len(sides))) < bend[condition]
    known = np.isfinite(v)
    for i in range(1, v.ndim):
        before, after = (*[np.s_[:]] * i, np.s_[:-1]), (*[np.s_[:]] * i, np.s_[1:])
        near, known = near[before] | near[after], known[before] & known[after]
    return np.flatnonzero(near & known[condition])


@lru_cache
def simplices_of(*points: int) -> Indices:
    """The corners (C, s + 1) of all simplices of a grid.

    These are the intervals of a grid in one parameter, and two triangles for each rectangle of a
    grid in two parameters.
    """
    number = np.arange(math.prod(points)).reshape(points)
    if number.ndim == 1:
        return np.stack([number[:-1], number[1:]], axis=1)
    low, high = number[:-1, :-1].ravel(), number[1:, 1:].ravel()
    ends = [np.stack([low, other.ravel(), high], axis=1)
            for other in (number[1:, :-1], number[:-1, 1:])]  # fmt: skip
    return np.concatenate(ends)


def _together(corners: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The codes of all corners of each simplex, joined by bitwise "or" (B, C)."""
    if corners.ndim == 2:
        return corners[:, :-1] | corners[:, 1:]
    both = corners[:, :-1, :-1] | corners[:, 1:, 1:]
    found = [both | other for other in (corners[:, 1:, :-1], corners[:, :-1, 1:])]
    return np.stack(found, axis=1).reshape(len(corners), -1)


def slopes_at(eta: Array, whose: Indices, corners: Indices, sides: tuple[Array, ...]) -> Array:
    """Slopes (H, C, s) at the corners (H, C) of simplices, by parabolas through three grid points.

    `whose` (H,) are the rows of `eta` with the outcomes.
    """
    shape = tuple(side.size for side in sides)
    found = []
    for i, (side, place) in enumerate(zip(sides, np.unravel_index(corners, shape), strict=True)):
        apart = math.prod(shape[i + 1 :])
        middle = np.clip(place, 1, side.size - 2)
        first = corners + (middle - 1 - place) * apart
        low, here, high = (eta[whose[:, None], first + k * apart] for k in range(3))
        before, after = side[middle] - side[middle - 1], side[middle + 1] - side[middle]
        # A neighboring outcome may be infinite. A cell with such slopes is not smooth.
        with np.errstate(invalid="ignore"):
            rise, next_rise = (here - low) / before, (high - here) / after
            # This is the slope, at the corner, of the parabola through three points.
            bend = (next_rise - rise) / (before + after)
            found.append(rise + bend * (2.0 * side[place] - side[middle - 1] - side[middle]))
    return np.stack(found, axis=-1)


def _chord(v: Array, x: Array) -> Array:
    """The gradient (H, s) of the linear function that has outcomes v at corners x (H, s + 1, s)."""
    rise, side = v[:, 1:] - v[:, :1], x[:, 1:] - x[:, :1]
    if x.shape[2] == 1:
        return np.asarray(rise / side[:, 0])
    (a, b), (c, d) = np.moveaxis(side, 0, -1)
    first, second = rise.T
    slope = np.stack([first * d - second * b, second * a - first * c], axis=1)
    return np.asarray(slope / (a * d - b * c)[:, None], dtype=np.float64)


@np.errstate(invalid="ignore")
def smoothed(v: Array, x: Array, slope: Array, alike: float, steep: float) -> tuple[Array, Flags]:
    """The slopes (H, C, s) to use at the corners, and flags (H,) of simplices with smooth outcomes.

    The arguments are the outcomes v (H, C), the corners x (H, C, s) and the slopes (H, C, s) there.
    The outcome is smooth, without kink or extreme, if along each side it rises by the mean of the
    slopes at the ends of the side, and if the slopes are alike. Otherwise the slope of the linear
    interpolation takes the place of all slopes.
    """
    chord = _chord(v, x)
    size = np.sqrt(np.sum(chord**2, axis=1))
    mean = slope.mean(axis=1, keepdims=True)
    differ = np.sqrt(np.sum((slope - mean) ** 2, axis=2)).max(axis=1)
    off = np.zeros(len(v))
    for i, j in combinations(range(v.shape[1]), 2):
        rise = np.sum((slope[:, i] + slope[:, j]) * (x[:, j] - x[:, i]), axis=1)
        off = np.maximum(off, np.abs(v[:, j] - v[:, i] - 0.5 * rise))
    smooth: Flags = (off < alike * size) & (differ < steep * size)
    return np.where(smooth[:, None, None], slope, chord[:, None]), smooth


def _share(y: Array, v: Array, other: Array, rise: Array, rise_there: Array) -> Array:
    """The share (H,) of the way from one corner to another at which a parabola has the value y.

    The parabola has the outcomes v and `other` at the two corners, and the derivatives `rise` and
    `rise_there` along the way.
    """
    bend = 0.5 * (rise_there - rise)
    slope, off = other - v - bend, y - v
    # The chosen root is the one at which the parabola changes towards the other corner's outcome.
    root = np.copysign(np.sqrt(np.maximum(slope**2 + 4.0 * bend * off, 0.0)), other - v)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.where(
            slope * root >= 0.0, 2.0 * off / (slope + root), 0.5 * (root - slope) / bend
        )
    return np.asarray(np.clip(np.nan_to_num(found, nan=0.0), 0.0, 1.0))


def _on_line(y: Array, v: Array, x: Array, slope: Array) -> tuple[Array, Array]:
    """The point (H, 1, 1) of each interval at which the outcome is y (H,), and its weight (H, 1).

    The intervals have the ends x (H, 2, 1), with the outcomes v (H, 2) and slopes (H, 2, 1) there.
    """
    ends = slope[..., 0]
    share = _share(y, v[:, 0], v[:, 1], ends[:, 0], ends[:, 1])
    there = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
    on = x[:, :1] + share[:, None, None] * (x[:, 1:] - x[:, :1])
    return on, 1.0 / np.abs(there)[:, None]


def _in_triangle(y: Array, v: Array, x: Array, slope: Array) -> tuple[Array, Array]:
    """Two Gauss points (H, 2, 2) on the level curve in each triangle, and weights (H, 2).

    The curve, on which the outcome is y (H,), goes from one side of the triangle to another. The
    triangles have the corners x (H, 3, 2), with the outcomes v (H, 3) and slopes (H, 3, 2) there.
    The weights are those of int |e| dt/|d eta/dn|, where e is the chord of the curve, t runs from 0
    to 1 along it, and n is the direction normal to it.
    """
    order = np.argsort(v, axis=1)
    lone = y < np.take_along_axis(v, order, axis=1)[:, 1]
    # The corner that lies alone on one side of the curve comes first.
    order = np.where(lone[:, None], order, order[:, ::-1])
    v = np.take_along_axis(v, order, axis=1)
    x, slope = (np.take_along_axis(one, order[..., None], axis=1) for one in (x, slope))
    side = x[:, 1:] - x[:, :1]
    along = np.einsum("hcs,hks->hck", slope, side)
    one = _share(y, v[:, 0], v[:, 1], along[:, 0, 0], along[:, 1, 0])
    other = _share(y, v[:, 0], v[:, 2], along[:, 0, 1], along[:, 2, 1])
    chord = other[:, None] * side[:, 1] - one[:, None] * side[:, 0]
    across = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    square = np.sum(chord**2, axis=1)
    (a, c), (b, d) = side[:, 0].T, side[:, 1].T
    aside = np.stack([d * across[:, 0] - b * across[:, 1], a * across[:, 1] - c * across[:, 0]])
    aside /= a * d - b * c
    points, weights = [], []
    for t in (0.5 - GAUSS, 0.5 + GAUSS):
        shares = np.stack([one * (1.0 - t), other * t])
        there = _between_corners(shares, slope)
        at = x[:, 0] + np.einsum("kh,hks->hs", shares, side)
        half = 0.5 * np.einsum("hcs,hcs->hc", slope, at[:, None] - x)
        value = _between_corners(shares, (v + half)[..., None])[:, 0]
        with np.errstate(invalid="ignore", divide="ignore"):
            off = np.nan_to_num((y - value) / np.sum(across * there, axis=1))
            there = _between_corners(shares + off * aside, slope)
            weight = 0.5 * square / np.abs(np.sum(across * there, axis=1))
        points.append(at + off[:, None] * across)
        weights.append(np.nan_to_num(weight, posinf=0.0))
    return np.stack(points, axis=1), np.stack(weights, axis=1)


def _between_corners(shares: Array, values: Array) -> Array:
    """Linear interpolation in triangles between the values (H, 3, C) at their corners.

    `shares` (2, H) are the barycentric weights of the second and the third corner.
    """
    first, second = shares[..., None]
    alone = 1.0 - first - second
    return np.asarray(alone * values[:, 0] + first * values[:, 1] + second * values[:, 2])
