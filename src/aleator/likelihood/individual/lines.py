"""Adaptive quadrature along many lines at once.

A line is the path of one standard normal variate, the others being fixed. It is divided into
panels: intervals with a Gauss-Legendre rule on each half, which are halved until the integral is
accurate enough. A top is a local maximum of the log-density on a line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np

from aleator.core.polynomials import gauss_legendre
from aleator.core.types import Array, Flags, Indices

LogDensity = Callable[[Indices, Array], Array]
"""A function that gives the log-density log f (T, q) at places (T, q) on lines number (T,)."""


@dataclass(frozen=True)
class LineSettings:
    """Settings of the quadrature along lines: the search for tops, and the panels.

    The values are chosen by judgement. A top is a local maximum of the log-density on a line.
    `farthest`: the ends of a line; the probability beyond is 1e-17 on either side. `reach` and
    `places`: tops are sought at this number of places from -reach to reach. `beside` and
    `beside_places`: the surroundings of each top are searched again, `beside` times the distance of
    the first places to either side, at this number of places. `parabolas`: the number of parabolas
    that are fitted one after the other to locate a top. `apart`: the smallest distance of a
    parabola's vertex from the top, relative to the distance of the neighbors. `narrowest`: the
    smallest width of a top, in variates. `edges`: inner edges of the first panels, in variates.
    `top_edges`: edges of panels about each top, in widths of the top. `deepest`: a top whose height
    relative to the highest one has a logarithm below this is ignored. `rounds`: the largest number
    of halvings of panels; at a jump they give thirteen digits. `panels`: a line with this number of
    panels is not divided further, so that a simulator with rounding or solver noise takes bounded
    memory. The largest number in `pytest tests/likelihood/individual` is 52.
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
    panels: int = 256


LINES = LineSettings()
LOWEST = np.finfo(np.float64).min
"""The most negative floating-point number, which stands for a log-density of minus infinity."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """Panels [low, high] (T,) of the lines number `line` (T,), with their integrals.

    A panel is an interval of a line. `log_f` (T, 2 q) is the log-density at the q nodes of each of
    its halves. The other fields are logarithms: `whole` (T,) of the integral by q nodes on the
    panel, `halves` (T, 2) of the integrals over its halves, and `ends` (T, 2) of the density at its
    two edges, as the interpolating polynomials of the halves have it.
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
        """Panels (intervals of lines) with the log-density at `points` nodes in each half.

        `whole` (T,) are the logarithms of their integrals, known from coarser panels.
        """
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
        """The line number, place, log weight and log f (J,) of all nodes."""
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
        """The error estimate (T,) of each panel, relative to the integral over its line.

        `known` (L,) are the logarithms of the integrals over the lines. The estimate is the change
        of the integral by halving. It would miss a jump between the last node of a panel and its
        edge. The difference of the two neighboring polynomials at the edge, times the width without
        nodes, is therefore added.
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
        """The panels (intervals of lines) after halving those that are flagged by `which` (T,)."""
        low, high, line = self.low[which], self.high[which], np.tile(self.line[which], 2)
        middle = 0.5 * (low + high)
        new = Pieces.of(
            log_density, line, np.concatenate([low, middle]), np.concatenate([middle, high]),
            self.halves[which].T.ravel(), self.log_f.shape[1] // 2,
        )  # fmt: skip
        return joined([self.only(~which), new])

    def only(self, which: Flags) -> Pieces:
        """The panels (intervals of lines) that are flagged by `which` (T,)."""
        return Pieces(*(getattr(self, f.name)[which] for f in fields(self)))


def integrated(
    log_density: LogDensity,
    group: Indices,
    points: int,
    enough: float,
    settings: LineSettings = LINES,
) -> tuple[Pieces, Array]:
    """The panels (intervals) of an adaptive quadrature along L lines, and the log integrals (L,).

    Each panel has a Gauss-Legendre rule with `points` nodes on each half. It is halved if halving
    changes its integral by more than `enough`, relative to the largest integral among the lines of
    the same `group` (L,) (Gander and Gautschi, 2000). A narrow peak is found only if the
    log-density rises toward it at the places where it is evaluated. The log-density of a measured
    outcome does so.
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
        divisible = np.bincount(pieces.line, minlength=lines) < settings.panels
        open_ = (pieces.error(top[group]) > enough) & divisible[pieces.line]
        if np.any(open_):
            # Finished lines are checked again when all lines are finished.
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
    """One set of panels (intervals of lines), made of the panels of all parts."""
    every = ([getattr(part, f.name) for part in parts] for f in fields(Pieces))
    return Pieces(*(np.concatenate(own) for own in every))


def log_sum_by(owner: Indices, values: Array, count: int) -> Array:
    """The log-sum-exp (count,) of the values (T,) that belong to each owner (T,)."""
    top = np.full(count, -np.inf)
    np.maximum.at(top, owner, values)
    safe = np.where(np.isfinite(top), top, 0.0)
    total = np.bincount(owner, np.exp(values - safe[owner]), minlength=count)
    with np.errstate(divide="ignore"):
        return np.asarray(safe + np.log(total))


def _first(
    log_density: LogDensity, group: Indices, settings: LineSettings
) -> tuple[Indices, Array, Array]:
    """The first panels of all lines, which are finer about each local maximum of the density.

    Returns the line number (T,) and the two ends (T,) of each panel, an interval of its line.
    """
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
    """The tops (local maxima) of all lines: line number (T,), place on it (T,) and width (T,)."""
    places = np.linspace(-settings.reach, settings.reach, settings.places)
    everywhere = np.broadcast_to(places, (group.size, places.size))
    value = _evaluated(log_density, np.arange(group.size), everywhere)
    beyond = np.full((group.size, 1), -np.inf)
    line, top = _peaks(np.concatenate([beyond, value, beyond], axis=1))
    # Two tops that are close to each other may look like one at the first places.
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
    """The rows and columns of the values (R, P) that are local maxima of their row."""
    inner = value[:, 1:-1]
    row, column = np.nonzero((inner >= value[:, :-2]) & (inner > value[:, 2:]))
    return row, column + 1


def _chosen(x: Array, f: Array, cases: list[tuple[Flags, Array, Array]]) -> tuple[Array, Array]:
    for where, new_x, new_f in cases:
        x, f = np.where(where, new_x, x), np.where(where, new_f, f)
    return x, f


def _bend(a: Array, b: Array, c: Array, f_a: Array, f_b: Array, f_c: Array) -> Array:
    """Minus the second derivative of the parabola through three points; NaN if a value is NaN."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return np.asarray(2.0 * ((f_b - f_a) / (b - a) - (f_c - f_b) / (c - b)) / (c - a))


def _vertex(
    a: Array, b: Array, c: Array, f_a: Array, f_b: Array, f_c: Array, apart: float
) -> Array:
    """The vertex of the parabola through three points, or the middle of the wider interval."""
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
    """Weights (q,) that extrapolate the values at a half panel's nodes to its upper end.

    Also returns the distance of the last node from that end, relative to the width of the panel.
    """
    t = gauss_legendre(points)[0]
    weights = np.array(
        [np.prod((1.0 - np.delete(t, i)) / (x - np.delete(t, i))) for i, x in enumerate(t)]
    )
    return weights, float((1.0 - t[-1]) / 4.0)


def in_halves(low: Array, high: Array, points: int) -> Array:
    """The Gauss-Legendre nodes (..., 2 q) in the two halves of panels (...)."""
    t, middle = gauss_legendre(points)[0], 0.5 * (low + high)
    return np.concatenate([placed(t, low, middle), placed(t, middle, high)], axis=-1)


def placed(t: Array, low: Array, high: Array) -> Array:
    """The nodes t (q,) of [-1, 1] mapped to panels (...), which gives (..., q)."""
    return np.asarray((0.5 * (low + high))[..., None] + (0.5 * (high - low))[..., None] * t)


def log_sum(log_f: Array, weights: Array, width: Array) -> Array:
    """The log integral log(width sum_j w_j f_j) (...) of values log f (..., q)."""
    top = log_f.max(axis=-1, keepdims=True)
    safe = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(safe[..., 0] + np.log(width * (np.exp(log_f - safe) @ weights)))


def _evaluated(log_density: LogDensity, line: Indices, at: Array) -> Array:
    value = log_density(line, at)
    return np.asarray(np.where(np.isnan(value), -np.inf, value))
