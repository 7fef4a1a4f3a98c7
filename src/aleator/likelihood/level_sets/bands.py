"""Bands {x: lower <= eta(x) <= upper} of a grid: the parameters that agree with a censored outcome.

A band is the part of the grid between two level sets. Cells that lie wholly inside it are joined to
blocks, in which points and weights are those of a Gauss rule. The part of a cell that a bound cuts
is made of the level sets of some outcomes between the bound and the corners.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aleator.core.polynomials import gauss_legendre, tensor
from aleator.core.types import Array, Flags, Indices
from aleator.likelihood.level_sets import cells
from aleator.likelihood.level_sets.cells import At

Points = tuple[Indices, Array, Array]
"""Points in bands: the numbers of the bands (H,), the points (H, s) and their weights (H,)."""


@dataclass(frozen=True)
class BandSettings:
    """Settings for the points of bands; measured by `tests/likelihood/test_bands.py`.

    The log probability of a normal parameter is exact to 5e-6 where the probability is 0.004, and
    that of a product of two lognormal parameters to 2e-5.

    `pieces`: the least number of blocks along a side of a grid, where cells are joined to blocks.
    `nodes`: the number of Gauss nodes along each side of a block. `fine`: the number of blocks that
    a side would have from which each has `fine_nodes` instead. `cut`: the number of outcomes whose
    level sets make up the part of a cell between a bound and a corner, or between two corners.
    """

    pieces: int = 12
    nodes: int = 4
    fine: int = 40
    fine_nodes: int = 2
    cut: int = 2


BANDS = BandSettings()
IN_TRIANGLE = np.array([[4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]]) / 6.0
"""Barycentric coordinates of three points of equal weight, exact for polynomials of degree 2."""


def enclosed(
    rows: Indices,
    ends: Array,
    condition: Indices,
    eta: Array,
    sides: tuple[Array, ...],
    at: At,
    alike: float,
    pieces: int,
    settings: BandSettings = BANDS,
    of_cells: cells.CellSettings = cells.CELLS,
) -> Points:
    """The points of bands in the cells of a grid: numbers (H,), points (H, s) and weights (H,).

    int_band p(x) dx = sum_h w_h p(x_h). `rows` (B,) are the numbers of the bands, and `ends` (2, B)
    their lower and upper bounds; one of them may be infinite. The other arguments are those of
    `crossed`. `pieces` is the least number of blocks along a side. Infinite outcomes may lie in a
    band. Those that are NaN, of runs that failed, do not.
    """
    shape = tuple(side.size for side in sides)
    whole, cut = _classified(ends, eta[condition], shape)
    doubtful = np.union1d(*(cells.hiding(bound, condition, eta, sides) for bound in ends))
    whole.reshape(-1)[doubtful] = False
    blocks = _blocks(rows, whole, sides, pieces, settings)
    number = np.setdiff1d(np.flatnonzero(cut), doubtful)
    count = math.prod(whole.shape[1:])
    simplices = cells.simplices_of(*shape)
    each = len(simplices) // count
    band, cell = np.divmod(np.tile(number, each), count)
    corners = simplices[cell + np.repeat(np.arange(each), number.size) * count]
    place = np.unravel_index(corners, shape)
    x = np.stack([side[i] for side, i in zip(sides, place, strict=True)], axis=-1)
    of = condition[band]
    slope = cells.slopes_at(eta, of, corners, sides) * np.ptp(x, axis=1, keepdims=True)
    v = eta[of[:, None], corners]
    slopes, smooth = cells.smoothed(v, cells.unit(x), slope, alike, of_cells.steep)
    bent = np.union1d(band[~smooth] * count + cell[~smooth], doubtful)
    kept = ~np.isin(band * count + cell, bent)
    band = band[kept]
    smooth_parts = _parts(rows[band], ends[:, band], v[kept], x[kept], slopes[kept], settings)
    index, far, outcomes = cells.cells_of(bent, condition, eta, sides)
    halved = _halved(
        rows[index], ends[:, index], far, outcomes, at, alike, settings, of_cells
    )  # fmt: skip
    every = [*blocks, *smooth_parts, *halved]
    owner, on, weight = (np.concatenate(one) for one in zip(*every, strict=True))
    return owner, on, weight


def inside(ends: Array, v: Array) -> Flags:
    """Whether outcomes v (B, ...) lie between the bounds `ends` (2, B), or on one of them."""
    lower, upper = ends.reshape(2, -1, *[1] * (v.ndim - 1))
    return np.asarray((v >= lower) & (v <= upper))


def _classified(ends: Array, v: Array, shape: tuple[int, ...]) -> tuple[Flags, Flags]:
    """Which cells (B, ...) of a grid lie wholly in the band, and which a bound cuts.

    v (B, P) are the outcomes at all points of the grid. A cell that lies wholly beyond one bound is
    neither. An outcome that is NaN lies outside.
    """
    v = v.reshape(len(v), *shape)
    lower, upper = ends.reshape(2, -1, *[1] * len(shape))
    failed = np.isnan(v)
    corners = [inside(ends, v), failed | (v < lower), failed | (v > upper)]
    for i in range(1, v.ndim):
        before, after = (*[np.s_[:]] * i, np.s_[:-1]), (*[np.s_[:]] * i, np.s_[1:])
        corners = [each[before] & each[after] for each in corners]
    within, below, above = corners
    return within, ~(within | below | above)


def _blocks(
    rows: Indices, whole: Flags, sides: tuple[Array, ...], pieces: int, settings: BandSettings
) -> Iterator[Points]:
    """Gauss points of the cells `whole` (B, ...), which are joined to blocks as large as possible.

    A block has 2^k cells along a side, with an own k for each side.
    """
    sizes, full = [1] * len(sides), whole
    while True:
        pairs = [2 if count >= 2 * pieces else 1 for count in full.shape[1:]]
        larger = _joined(full, pairs)
        own = full.copy()
        if max(pairs) > 1:
            covered = larger
            for i, by in enumerate(pairs, 1):
                covered = np.repeat(covered, by, axis=i)
            own[tuple(slice(0, size) for size in covered.shape)] &= ~covered
        band, *place = np.nonzero(own)
        ends = [_ends(side, size)[:, i] for side, size, i in zip(sides, sizes, place, strict=True)]
        nodes = [
            settings.nodes if count < settings.fine else settings.fine_nodes
            for count in full.shape[1:]
        ]
        yield _boxes(rows[band], np.stack(ends, axis=-1), tuple(nodes))
        if max(pairs) == 1:
            return
        sizes, full = [size * by for size, by in zip(sizes, pairs, strict=True)], larger


def _joined(full: Flags, pairs: list[int]) -> Flags:
    """Which pairs of neighbors are both full, along the sides on which `pairs` has a two.

    An odd one at an end is left out.
    """
    for i, by in enumerate(pairs, 1):
        if by == 2:
            before, even = [np.s_[:]] * i, full.shape[i] // 2 * 2
            full = full[(*before, np.s_[0:even:2])] & full[(*before, np.s_[1:even:2])]
    return full


def _ends(side: Array, size: int) -> Array:
    """The lower end, the middle and the upper end (3, C) of blocks of `size` cells of a side."""
    low, high = side[:-size:size], side[size::size]
    middle = side[size // 2 :: size][: high.size] if size > 1 else 0.5 * (low + high)
    return np.stack([low[: high.size], middle, high])


def _boxes(rows: Indices, ends: Array, nodes: tuple[int, ...]) -> Points:
    """Gauss points of boxes with these lower ends, middles and upper ends (3, M, s).

    `nodes` are the numbers of points along each side.

    Along each side the points are the images of those of a Gauss rule on [0, 1] under the map
    low + (high - low) k t/(1 - t + k t). It maps 1/2 to the middle, so that the points follow the
    width of the cells, which is that of the law.
    """
    low, middle, high = ends
    grid, rules = tensor(nodes), [gauss_legendre(count) for count in nodes]
    t = 0.5 + 0.5 * np.stack([t[i] for (t, _), i in zip(rules, grid.T, strict=True)], axis=1)
    share = np.prod([w[i] for (_, w), i in zip(rules, grid.T, strict=True)], axis=0)
    k = ((middle - low) / (high - middle))[:, None]
    below = 1.0 - t + k * t
    x = low[:, None] + (high - low)[:, None] * k * t / below
    weight = share * np.prod((high - low)[:, None] * k / below**2, axis=2)
    return cells.listed(rows, x, weight)


def _parts(
    rows: Indices, ends: Array, v: Array, x: Array, slopes: Array, settings: BandSettings
) -> Iterator[Points]:
    """The parts of simplices that lie in bands, as points.

    A simplex has the corners x (H, s + 1, s), the outcomes v (H, s + 1) there and the `slopes`
    (H, s + 1, s), in widths of the cell. Between the values at two corners, and within the bounds,
    the part is int dy int p(x)/|grad eta| over the level set of y, by a Gauss rule for y.
    """
    whole = inside(ends, v).all(axis=1)
    yield _simplex(rows[whole], x[whole])
    rows, ends, v, x, slopes = rows[~whole], ends[:, ~whole], v[~whole], x[~whole], slopes[~whole]
    rising = np.clip(np.sort(v, axis=1), *ends[..., None])
    t, share = gauss_legendre(settings.cut)
    for low, high in zip(rising.T[:-1], rising.T[1:], strict=True):
        some = high > low
        for place, of in zip(0.5 + 0.5 * t, share, strict=True):
            width = (high - low)[some]
            y = low[some] + place * width
            on, weight = cells.pieces(y, v[some], x[some], slopes[some])
            yield cells.listed(rows[some], on, weight * (of * width)[:, None])


def _simplex(rows: Indices, x: Array) -> Points:
    """Points of whole simplices with corners x (H, s + 1, s)."""
    if x.shape[2] == 1:
        low, high = x.min(axis=1), x.max(axis=1)
        return _boxes(rows, np.stack([low, 0.5 * (low + high), high]), (2,))
    (a, b), (c, d) = np.moveaxis(x[:, 1:] - x[:, :1], 0, -1)
    share = 0.5 * np.abs(a * d - b * c) / len(IN_TRIANGLE)
    on = np.einsum("kc,hcs->hks", IN_TRIANGLE, x)
    return cells.listed(rows, on, np.repeat(share[:, None], len(IN_TRIANGLE), axis=1))


def _halved(
    rows: Indices,
    ends: Array,
    far: Array,
    v: Array,
    at: At,
    alike: float,
    settings: BandSettings,
    of_cells: cells.CellSettings,
) -> Iterator[Points]:
    """The parts of M cells that lie in bands; cells are halved until the outcome is smooth in them.

    `far` (2, M, s) are the lower and upper coordinates of the cells, and v (M, 2) or (M, 2, 2) the
    outcomes at their corners. A half that is wholly inside or outside, with no bound near, is
    finished, and so is one in which the outcome is smooth. Of the last halves those with outcomes
    that are not finite count with the share of their corners that lies in the band.
    """
    s = far.shape[2]
    triangles = cells.simplices_of(*[2] * s)
    place = np.stack(np.unravel_index(triangles, (2,) * s), axis=-1)
    for left in reversed(range(of_cells.halvings)):
        if not rows.size:
            return
        far, v, slope, bend = cells.halves_of(rows, far, v, at)
        rows, ends = np.tile(rows, 2**s), np.tile(ends, (1, 2**s))
        flat = v.reshape(len(v), 2**s)
        whole, cut = _classified(ends, flat, (2,) * s)
        whole, cut = whole.reshape(-1), cut.reshape(-1)
        finite = np.isfinite(flat).all(axis=1)
        with np.errstate(invalid="ignore"):
            near = np.abs(flat - ends[..., None]).min(axis=(0, 2)) < 0.5 * bend
        again = ~cut & finite & near & (left > 0)
        done = whole & ~again
        yield _boxes(rows[done], np.stack([far[0], far.mean(axis=0), far[1]])[:, done], (2,) * s)
        cell = np.tile(np.flatnonzero(cut & finite), len(triangles))
        which = np.repeat(np.arange(len(triangles)), np.count_nonzero(cut & finite))
        corner = flat[cell[:, None], triangles[which]]
        steps, smooth = cells.smoothed(
            corner, place[which].astype(float), slope[cell[:, None], triangles[which]], alike,
            of_cells.steep,
        )  # fmt: skip
        rough = cut & ~finite
        rough[cell[~smooth]] = True
        if not left:
            center, volume = far.mean(axis=0)[:, None], np.ptp(far, axis=0).prod(axis=1)
            share = volume * inside(ends, flat).mean(axis=1)
            some = cut & ~finite
            yield cells.listed(rows[some], center[some], share[some, None])
            rough[:] = False
        kept = ~rough[cell]
        cell, which = cell[kept], which[kept]
        x = far[0, cell][:, None] + place[which] * np.ptp(far, axis=0)[cell][:, None]
        yield from _parts(rows[cell], ends[:, cell], corner[kept], x, steps[kept], settings)
        again |= rough
        rows, ends, far, v = rows[again], ends[:, again], far[:, again], v[again]
