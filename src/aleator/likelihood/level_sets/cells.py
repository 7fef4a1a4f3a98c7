"""The part of a set {x: eta(x) = y} that goes through an interval or a triangle of a grid."""

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
    """Where an outcome is smooth in a cell, and how small cells become; chosen by judgement.

    `steep`: difference of the slopes at a cell's corners from their mean, over the cell's, up to
    which an outcome is smooth there. `halvings`: times that a cell which is not smooth is halved.
    """

    steep: float = 0.1
    halvings: int = 8


CELLS = CellSettings()
GAUSS = 0.5 / np.sqrt(3.0)
"""Distance of two points from the middle of a line, over its length, that integrate cubics."""
BELOW, ABOVE, NONE = np.array([1, 2, 4], dtype=np.uint8)
"""Where an outcome of the grid lies: not above what was measured, above it, or nowhere."""

At = Callable[[Indices, Array], Array]
"""Outcomes (R,) of experiments (R,), each at a point of its own, (R, s)."""


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
    """Level sets in the cells of a grid: experiments (H,), points x (H, s) on their sets, weights
    (H,).

    Of experiments `rows` (B,) with outcomes y (B,), and `eta` (C, P) of conditions, theirs being
    `condition` (B,), at the points of a grid with these `sides`. A weight is the length of the set
    over the slope of the outcome. A cell whose slope differs by more than `alike` from the mean of
    those at its corners, or which may hide a set between its corners, is halved: near an extreme, a
    saddle, a fold or a kink. That takes outcomes `at` further points.
    """
    shape = tuple(side.size for side in sides)
    whose, cell, corners = _passed(y, eta[condition], shape)
    place = np.unravel_index(corners, shape)
    x = np.stack([side[i] for side, i in zip(sides, place, strict=True)], axis=-1)
    of = condition[whose]
    slope = _slopes(eta, of, corners, sides) * np.ptp(x, axis=1, keepdims=True)
    v = eta[of[:, None], corners]
    slopes, smooth = _smooth(v, _unit(x), slope, alike, settings.steep)
    count = math.prod(size - 1 for size in shape)
    through, bent = whose * count + cell, _hiding(y, condition, eta, sides)
    bent = np.union1d(through[~smooth], bent)
    kept = ~np.isin(through, bent)
    whole = (rows[whose[kept]], *_pieces(y[whose[kept]], v[kept], x[kept], slopes[kept]))
    index, where = np.divmod(bent, count)
    low = np.unravel_index(where, tuple(size - 1 for size in shape))
    ends = [np.stack([side[i], side[i + 1]]) for side, i in zip(sides, low, strict=True)]
    first = np.ravel_multi_index(low, shape)
    far = np.array([0, 1, shape[-1], shape[-1] + 1])[: 2 ** len(shape)]
    outcomes = eta[condition[index][:, None], first[:, None] + far].reshape(-1, *[2] * len(shape))
    parts = _halved(rows[index], y[index], np.stack(ends, axis=-1), outcomes, at, alike, settings)
    owner, on, weight = (
        np.concatenate(one) for one in zip(_flat(*whole), *(_flat(*p) for p in parts), strict=True)
    )
    return owner, on, weight


def _unit(x: Array) -> Array:
    """Corners (H, s + 1, s) of simplices by the width of their cells, from zero to one."""
    low = x.min(axis=1, keepdims=True)
    return np.asarray((x - low) / (x.max(axis=1, keepdims=True) - low))


def _pieces(y: Array, v: Array, x: Array, slopes: Array) -> tuple[Array, Array]:
    """Points (H, C, s) and weights (H, C) of sets in simplices, corners x (H, s + 1, s).

    Of outcomes v (H, s + 1) there, with `slopes` (H, s + 1, s) by the width of the cell. Exact
    where the outcome is quadratic, up to the third power of what the slopes differ by.
    """
    inside = _on_line if x.shape[2] == 1 else _in_triangle
    low, width = x.min(axis=1), np.ptp(x, axis=1)
    found, weight = inside(y, v, _unit(x), slopes)
    return low[:, None] + found * width[:, None], weight * width.prod(axis=1, keepdims=True)


def _flat(whose: Indices, on: Array, weight: Array) -> tuple[Indices, Array, Array]:
    """Points and weights in a row, each with its experiment."""
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
    """Experiments (H,) with points (H, C, s) and weights (H, C) of sets in cells (M,).

    `ends` (2, M, s) are those of the cells, and v (M, 2) or (M, 2, 2) the outcomes at their
    corners. A half in which the outcome is smooth is done, one that its set cannot reach is left
    out, and any other is halved again.
    """
    s = ends.shape[2]
    triangles = _simplices(*[2] * s)
    place = np.stack(np.unravel_index(triangles, (2,) * s), axis=-1)
    halves = list(product((0, 1), repeat=s))
    for left in reversed(range(settings.halvings)):
        if not rows.size:
            return
        sides = np.stack([ends[0], ends.mean(axis=0), ends[1]])
        full = _between(rows, sides, v, at)
        slope = _by_parabolas(full)
        bend = sum(np.abs(np.diff(full, 2, axis=1 + i)).reshape(len(full), 3 ** (s - 1)).max(1)
                   for i in range(s))  # fmt: skip
        part = [(np.s_[:], *[np.s_[i : i + 2] for i in half]) for half in halves]
        v = np.concatenate([full[one] for one in part])
        slope = np.concatenate([slope[one] for one in part]).reshape(len(v), 2**s, s)
        ends = np.stack([
            np.concatenate([
                np.stack([sides[i + more, :, k] for k, i in enumerate(half)], axis=1)
                for half in halves
            ]) for more in (0, 1)
        ])  # fmt: skip
        rows, y, bend = (np.tile(one, len(halves)) for one in (rows, y, bend))
        flat = v.reshape(len(v), 2**s)
        known = np.asarray(np.isfinite(flat).all(axis=1))
        corner = flat[:, triangles]
        on = known[:, None] & (corner.min(axis=2) <= y[:, None]) & (y[:, None] < corner.max(axis=2))
        cell, which = np.nonzero(on)
        low, width = ends[0, cell], ends[1, cell] - ends[0, cell]
        x = low[:, None] + place[which] * width[:, None]
        steps, smooth = _smooth(
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
            *_pieces(y[cell[done]], corner[on][done], x[done], steps[done]),
        )
        near = known & (np.abs(flat - y[:, None]).min(axis=1) < 0.5 * bend)
        again = np.where(on.any(axis=1), rough, near)
        rows, y, ends, v = rows[again], y[again], ends[:, again], v[again]


def _between(rows: Indices, sides: Array, v: Array, at: At) -> Array:
    """Outcomes (M, 3) or (M, 3, 3) at the corners and middles, `sides` (3, M, s), of cells."""
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
    """Derivatives (M, 3, s) or (M, 3, 3, s) by steps of v (M, 3) or (M, 3, 3)."""
    found = []
    for i in range(1, v.ndim):
        low, here, high = np.moveaxis(v, i, 0)
        ends = [4.0 * here - 3.0 * low - high, high - low, 3.0 * high + low - 4.0 * here]
        found.append(0.5 * np.stack(ends, axis=i))
    return np.stack(found, axis=-1)


def _passed(y: Array, eta: Array, shape: tuple[int, ...]) -> tuple[Indices, Indices, Indices]:
    """Simplices that sets go through: experiments (H,), cells (H,) and corners (H, s + 1)."""
    simplices = _simplices(*shape)
    below, above = (found.view(np.uint8) for found in (eta <= y[:, None], eta > y[:, None]))
    place = NONE - (NONE - BELOW) * below - (NONE - ABOVE) * above
    through = _together(place.reshape(len(y), *shape)) == BELOW | ABOVE
    whose, where = np.divmod(np.flatnonzero(through), len(simplices))
    return whose, where % math.prod(size - 1 for size in shape), simplices[where]


def _hiding(y: Array, condition: Indices, eta: Array, sides: tuple[Array, ...]) -> Indices:
    """Numbers of the cells that a set may go through although all corners are on one side of it.

    Such a cell has a corner where the outcome bends by more than it differs from what was measured.
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
    """Derivatives (H, C, s) of outcomes `whose` (H,) at corners (H, C), by parabolas."""
    shape = tuple(side.size for side in sides)
    found = []
    for i, (side, place) in enumerate(zip(sides, np.unravel_index(corners, shape), strict=True)):
        apart = math.prod(shape[i + 1 :])
        middle = np.clip(place, 1, side.size - 2)
        first = corners + (middle - 1 - place) * apart
        low, here, high = (eta[whose[:, None], first + k * apart] for k in range(3))
        before, after = side[middle] - side[middle - 1], side[middle + 1] - side[middle]
        # an outcome beside may be infinite: a cell with such slopes is not smooth
        with np.errstate(invalid="ignore"):
            rise, next_rise = (here - low) / before, (high - here) / after
            # the derivative of the parabola through three points, at the one that is the corner
            bend = (next_rise - rise) / (before + after)
            found.append(rise + bend * (2.0 * side[place] - side[middle - 1] - side[middle]))
    return np.stack(found, axis=-1)


def _chord(v: Array, x: Array) -> Array:
    """The gradient (H, s) of what is linear between corners x (H, s + 1, s) of outcomes v."""
    rise, side = v[:, 1:] - v[:, :1], x[:, 1:] - x[:, :1]
    if x.shape[2] == 1:
        return np.asarray(rise / side[:, 0])
    (a, b), (c, d) = np.moveaxis(side, 0, -1)
    first, second = rise.T
    slope = np.stack([first * d - second * b, second * a - first * c], axis=1)
    return np.asarray(slope / (a * d - b * c)[:, None], dtype=np.float64)


def _smooth(v: Array, x: Array, slope: Array, alike: float, steep: float) -> tuple[Array, Flags]:
    """Slopes at the corners (H, C, s), and where (H,) the outcome is smooth: no kink, no extreme.

    From corners x (H, C, s), outcomes v (H, C) and `slope` (H, C, s). Where it is smooth the
    outcome rises along each side by the mean of the slopes at its ends; elsewhere all slopes are
    the chord's.
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
    """Share (H,) of the way from a corner to another where a parabola is y.

    From the outcomes v and `other` at both, and the derivatives along the way.
    """
    bend = 0.5 * (rise_there - rise)
    slope, off = other - v - bend, y - v
    # it goes through y in the direction in which the other corner lies
    root = np.copysign(np.sqrt(np.maximum(slope**2 + 4.0 * bend * off, 0.0)), other - v)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.where(
            slope * root >= 0.0, 2.0 * off / (slope + root), 0.5 * (root - slope) / bend
        )
    return np.asarray(np.clip(np.nan_to_num(found, nan=0.0), 0.0, 1.0))


def _on_line(y: Array, v: Array, x: Array, slope: Array) -> tuple[Array, Array]:
    """Where (H, 1, 1) the outcome is y (H,) between corners x (H, 2, 1), and weights (H, 1).

    Of outcomes v (H, 2) with derivatives `slope` (H, 2, 1).
    """
    ends = slope[..., 0]
    share = _share(y, v[:, 0], v[:, 1], ends[:, 0], ends[:, 1])
    there = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
    on = x[:, :1] + share[:, None, None] * (x[:, 1:] - x[:, :1])
    return on, 1.0 / np.abs(there)[:, None]


def _in_triangle(y: Array, v: Array, x: Array, slope: Array) -> tuple[Array, Array]:
    """The same in triangles, corners x (H, 3, 2): two points of Gauss (H, 2, 2) of a curve.

    It goes from one side of the triangle to another. By the length t of its chord e, and n at right
    angles to that, its weight is int |e| dt/|d eta/dn|.
    """
    order = np.argsort(v, axis=1)
    lone = y < np.take_along_axis(v, order, axis=1)[:, 1]
    # the corner that is alone on its side comes first
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
    """What is linear between the corners of triangles, values (H, 3, C), at `shares` (2, H)."""
    first, second = shares[..., None]
    alone = 1.0 - first - second
    return np.asarray(alone * values[:, 0] + first * values[:, 1] + second * values[:, 2])
