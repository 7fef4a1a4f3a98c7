"""Integrals along many lines at once, by panels that are halved until they are enough."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np

from aleator.core.polynomials import gauss_legendre
from aleator.core.types import Array, Flags, Indices

LogDensity = Callable[[Indices, Array], Array]
"""log f (T, q) at places (T, q) of the lines (T,)."""


@dataclass(frozen=True)
class LineSettings:
    """How tops of lines are sought, and how their panels begin and end; chosen by judgement.

    `farthest`: variates beyond this have no mass, 1e-17 at either end. `reach` and `places`: a line
    is looked at, to seek its tops, at so many places that go so far. `beside` and `beside_places`:
    it is looked at again about each top, so far in the distance of these places and at so many.
    `parabolas`: parabolas through a top and its neighbors, each closer to it than the last.
    `apart`: least distance of the vertex of a parabola from the top, over that of the neighbors.
    `narrowest`: least width of a top, in variates. `edges`: inner edges of the first panels, in
    variates. `top_edges`: edges about each top, in its width. `deepest`: logarithm of a share of
    the integral that is none, of a top and of a node. `rounds`: times that panels are halved; at a
    jump, thirteen digits.
    """

    farthest: float = 8.5
    reach: float = 5.5
    places: int = 23
    beside: float = 2.0
    beside_places: int = 17
    parabolas: int = 4
    apart: float = 1e-3
    narrowest: float = 1e-9
    edges: tuple[float, ...] = (-5.0, -3.0, -1.0, 1.0, 3.0, 5.0)
    top_edges: tuple[float, ...] = (-12.0, -5.0, -2.0, 2.0, 5.0, 12.0)
    deepest: float = -30.0
    rounds: int = 45


LINES = LineSettings()
LOWEST = np.finfo(np.float64).min
"""A log-density that is none, as a number."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Panels [low, high] (T,) of lines (T,); `log_f` (T, 2 q) at the nodes of their halves.

    Logarithms: `whole` (T,) of each integral by the nodes of the panel itself, `halves` (T, 2) of
    those over its halves, `ends` (T, 2) of what the polynomials of these have at its two edges.
    """

    line: Indices
    low: Array
    high: Array
    log_f: Array
    whole: Array
    halves: Array
    ends: Array

    @classmethod
    def of(
        cls,
        log_density: LogDensity,
        line: Indices,
        low: Array,
        high: Array,
        whole: Array,
        points: int,
    ) -> Pieces:
        """Panels whose integrals by nodes of their own are known, `whole` (T,), with `points` nodes
        in each half."""
        log_f = _evaluated(log_density, line, in_halves(low, high, points))
        top = np.maximum(log_f.max(axis=1, initial=-np.inf), LOWEST)
        f = np.exp(log_f - top[:, None])
        weights, (end, _) = gauss_legendre(points)[1], _at_the_end(points)
        by_halves = np.stack([f[:, :points] @ weights, f[:, points:] @ weights], axis=1)
        at_ends = np.stack([f[:, :points] @ end[::-1], f[:, points:] @ end], axis=1)
        with np.errstate(divide="ignore"):
            halves = np.log(0.5 * (high - low)[:, None] * by_halves) + top[:, None]
            ends = np.log(np.maximum(at_ends, 0.0)) + top[:, None]
        return cls(line, low, high, log_f, whole, halves, ends)

    @property
    def flat(self) -> tuple[Indices, Array, Array, Array]:
        """Line, place, log weight and log f (J,) of all nodes."""
        points = self.log_f.shape[1] // 2
        weights = np.tile(gauss_legendre(points)[1], 2)
        log_weight = np.log(0.5 * (self.high - self.low))[:, None] + np.log(weights)
        line = np.repeat(self.line, 2 * points)
        places = in_halves(self.low, self.high, points)
        return line, places.ravel(), log_weight.ravel(), self.log_f.ravel()

    def totals(self, lines: int) -> Array:
        """The logarithm (L,) of the integral over each line."""
        return log_sum_by(np.repeat(self.line, 2), self.halves.ravel(), lines)

    def error(self, known: Array) -> Array:
        """What halving changes (T,), as a share of integrals whose logarithms (L,) are known.

        A jump between the last node of a panel and its edge is not seen by its nodes: what the
        polynomials of two neighbors differ by at their edge counts too, over the gap without nodes.
        """
        top = known[self.line]
        top = np.where(np.isfinite(top), top, np.inf)
        halves = np.exp(self.halves - top[:, None])
        with np.errstate(over="ignore"):
            found = np.abs(halves[:, 0] + halves[:, 1] - np.exp(self.whole - top))
        order = np.lexsort((self.low, self.line))
        left, right = order[:-1], order[1:]
        ends = np.exp(self.ends - top[:, None])
        apart = np.abs(ends[left, 1] - ends[right, 0]) * (self.line[left] == self.line[right])
        gap = _at_the_end(self.log_f.shape[1] // 2)[1] * (self.high - self.low)
        found[left] += apart * gap[left]
        found[right] += apart * gap[right]
        return np.asarray(found)

    def halved(self, which: Flags, log_density: LogDensity) -> Pieces:
        """With some panels (T,) halved."""
        low, high, line = self.low[which], self.high[which], np.tile(self.line[which], 2)
        middle = 0.5 * (low + high)
        new = Pieces.of(
            log_density, line, np.concatenate([low, middle]), np.concatenate([middle, high]),
            self.halves[which].T.ravel(), self.log_f.shape[1] // 2,
        )  # fmt: skip
        return joined([self.only(~which), new])

    def only(self, which: Flags) -> Pieces:
        """Some of the panels (T,)."""
        return Pieces(*(getattr(self, f.name)[which] for f in fields(self)))


def integrated(
    log_density: LogDensity,
    group: Indices,
    points: int,
    enough: float,
    settings: LineSettings = LINES,
) -> tuple[Pieces, Array]:
    """Panels of L lines, with `points` nodes in each half, and log integrals (L,).

    Adaptive quadrature (Gander and Gautschi, 2000): the panels are halved that halving changes by
    more than `enough`, as a share of the largest integral of the lines of the same `group` (L,).
    Narrow tops are found where the log-density rises toward them over the distance of the points
    that are looked at, which that of a measured outcome does.
    """
    line, low, high = _first(log_density, group, settings)
    t, w = gauss_legendre(points)
    whole = log_sum(_evaluated(log_density, line, placed(t, low, high)), w, high - low)
    pieces = Pieces.of(log_density, line, low, high, whole, points)
    groups, lines = int(group.max(initial=-1)) + 1, group.size
    calm, totals = list[Pieces](), pieces.totals(lines)
    for _ in range(settings.rounds):
        top = np.full(groups, -np.inf)
        np.maximum.at(top, group, totals)
        open_ = pieces.error(top[group]) > enough
        if np.any(open_):
            # lines that are done are looked at again when all are
            going = np.zeros(lines, dtype=np.bool_)
            going[pieces.line[open_]] = True
            on = going[pieces.line]
            calm.append(pieces.only(~on))
            pieces = pieces.only(on).halved(open_[on], log_density)
            totals[going] = pieces.totals(lines)[going]
        elif calm:
            pieces, calm = joined([*calm, pieces]), []
        else:
            break
    pieces = joined([*calm, pieces])
    return pieces, pieces.totals(lines)


def joined(parts: Sequence[Pieces]) -> Pieces:
    """All panels of these together."""
    every = ([getattr(part, f.name) for part in parts] for f in fields(Pieces))
    return Pieces(*(np.concatenate(own) for own in every))


def log_sum_by(owner: Indices, values: Array, count: int) -> Array:
    """log sum exp (count,) of the values (T,) of each owner (T,)."""
    top = np.full(count, -np.inf)
    np.maximum.at(top, owner, values)
    safe = np.where(np.isfinite(top), top, 0.0)
    total = np.bincount(owner, np.exp(values - safe[owner]), minlength=count)
    with np.errstate(divide="ignore"):
        return np.asarray(safe + np.log(total))


def _first(
    log_density: LogDensity, group: Indices, settings: LineSettings
) -> tuple[Indices, Array, Array]:
    """The first panels of all lines: over the law, and about each top in its own width."""
    lines = group.size
    line, at, width = _tops(log_density, group, settings)
    of_law = np.array([-settings.farthest, *settings.edges, settings.farthest])
    of_top = np.array(settings.top_edges)
    about = at[:, None] + width[:, None] * of_top
    inner = np.abs(of_law - at[:, None]) < of_top[-1] * width[:, None]
    covered = np.zeros((lines, of_law.size), dtype=np.bool_)
    np.logical_or.at(covered, line, inner)
    covered[:, [0, -1]] = False
    rows, columns = np.nonzero(~covered)
    own = np.concatenate([rows, np.repeat(line, of_top.size)])
    edge = np.concatenate([of_law[columns], about.ravel()])
    kept = np.abs(edge) <= settings.farthest
    own, edge = own[kept], edge[kept]
    order = np.lexsort((edge, own))
    own, edge = own[order], edge[order]
    panel = (own[1:] == own[:-1]) & (edge[1:] > edge[:-1])
    return own[:-1][panel], edge[:-1][panel], edge[1:][panel]


def _tops(
    log_density: LogDensity, group: Indices, settings: LineSettings
) -> tuple[Indices, Array, Array]:
    """The tops of lines: which line (T,), where on it, and how wide."""
    places = np.linspace(-settings.reach, settings.reach, settings.places)
    everywhere = np.broadcast_to(places, (group.size, places.size))
    value = _evaluated(log_density, np.arange(group.size), everywhere)
    beyond = np.full((group.size, 1), -np.inf)
    line, top = _peaks(np.concatenate([beyond, value, beyond], axis=1))
    # two that are near to each other look like one from afar
    beside = np.linspace(-settings.beside, settings.beside, settings.beside_places)
    places = places[top - 1][:, None] + (places[1] - places[0]) * beside
    value = _evaluated(log_density, line, places)
    row, top = _peaks(value)
    line = line[row]
    a, b, c = (places[row, top + i] for i in (-1, 0, 1))
    f_a, f_b, f_c = (value[row, top + i] for i in (-1, 0, 1))
    for _ in range(settings.parabolas):
        x = _vertex(a, b, c, f_a, f_b, f_c, settings.apart)
        f = _evaluated(log_density, line, x[:, None])[:, 0]
        better, right = f > f_b, x > b
        a, f_a = _chosen(a, f_a, [(better & right, b, f_b), (~better & ~right, x, f)])
        c, f_c = _chosen(c, f_c, [(better & ~right, b, f_b), (~better & right, x, f)])
        b, f_b = np.where(better, x, b), np.where(better, f, f_b)
    bend = _bend(a, b, c, f_a, f_b, f_c)
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.where(bend > 0.0, 1.0 / np.sqrt(bend), c - a)
    highest = np.full(int(group.max(initial=-1)) + 1, -np.inf)
    np.maximum.at(highest, group[line], f_b)
    high = f_b > highest[group[line]] + settings.deepest
    return line[high], b[high], np.clip(width[high], settings.narrowest, 1.0)


def _peaks(value: Array) -> tuple[Indices, Indices]:
    """Rows and columns of the values (R, P) that are higher than those beside them."""
    inner = value[:, 1:-1]
    row, column = np.nonzero((inner >= value[:, :-2]) & (inner > value[:, 2:]))
    return row, column + 1


def _chosen(x: Array, f: Array, cases: list[tuple[Flags, Array, Array]]) -> tuple[Array, Array]:
    for where, new_x, new_f in cases:
        x, f = np.where(where, new_x, x), np.where(where, new_f, f)
    return x, f


def _bend(a: Array, b: Array, c: Array, f_a: Array, f_b: Array, f_c: Array) -> Array:
    """Minus the second derivative of the parabola through three points; NaN where one is not."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return np.asarray(2.0 * ((f_b - f_a) / (b - a) - (f_c - f_b) / (c - b)) / (c - a))


def _vertex(
    a: Array, b: Array, c: Array, f_a: Array, f_b: Array, f_c: Array, apart: float
) -> Array:
    """The top of the parabola through three points, or the middle of the wider side."""
    middle = np.where(c - b > b - a, 0.5 * (b + c), 0.5 * (a + b))
    bend = _bend(a, b, c, f_a, f_b, f_c)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        slope = (f_b - f_a) / (b - a)
        x = 0.5 * (a + b) + slope / bend
    near = apart * (c - a)
    fine = (bend > 0.0) & (x > a) & (x < c) & (np.abs(x - b) > near)
    return np.where(fine, x, middle)


@lru_cache
def _at_the_end(points: int) -> tuple[Array, float]:
    """Weights (q,) of the values at the nodes of half a panel, for the polynomial at its upper end.

    And the distance of its last node from there, as a share of the panel.
    """
    t = gauss_legendre(points)[0]
    weights = np.array(
        [np.prod((1.0 - np.delete(t, i)) / (x - np.delete(t, i))) for i, x in enumerate(t)]
    )
    return weights, float((1.0 - t[-1]) / 4.0)


def in_halves(low: Array, high: Array, points: int) -> Array:
    """The nodes (..., 2 q) of the halves of panels (...)."""
    t, middle = gauss_legendre(points)[0], 0.5 * (low + high)
    return np.concatenate([placed(t, low, middle), placed(t, middle, high)], axis=-1)


def placed(t: Array, low: Array, high: Array) -> Array:
    """Nodes t (q,) of [-1, 1] in panels (...): (..., q)."""
    return np.asarray((0.5 * (low + high))[..., None] + (0.5 * (high - low))[..., None] * t)


def log_sum(log_f: Array, weights: Array, width: Array) -> Array:
    """log(width sum_j w_j f_j) (...,) of values (..., q)."""
    top = log_f.max(axis=-1, keepdims=True)
    safe = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(safe[..., 0] + np.log(width * (np.exp(log_f - safe) @ weights)))


def _evaluated(log_density: LogDensity, line: Indices, at: Array) -> Array:
    value = log_density(line, at)
    return np.asarray(np.where(np.isnan(value), -np.inf, value))
