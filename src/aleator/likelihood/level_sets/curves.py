"""Level sets of several outcomes: points or curves in the space of the standard normal variates.

m outcomes of s scattering parameters are m equations for s unknowns. As many outcomes as parameters
have points as solutions, and one outcome less a curve. Solutions are sought by Newton's method from
the cells of a grid in which the linear function through the corners has one. From these points a
curve is followed to both sides, by short steps along it and Newton's method back to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.types import Array, Flags, Indices
from aleator.laws.inputs import Inputs, parameters_at
from aleator.likelihood.individual.parameters import scattered_density
from aleator.simulators.response_functions import Divisible


@dataclass(frozen=True)
class CurveSettings:
    """Settings for the points and curves on which several outcomes are as measured.

    The values were measured by `tests/likelihood/test_level_curves.py`. `most`: the largest number
    of scattering parameters. `reach`: the ends of the grid, in standard deviations. `margin`: a
    cell is searched if the linear function has its solution within this number of widths from the
    middle; so far is a point of a cell from the middle of the next one. `iterations`: the largest
    number of Newton steps; `longest`: the longest of them, in standard deviations. `arrived`: the
    length of the last step, after which the error is of the order of its square. `apart`: points
    nearer than this are one. `difference`: the step for slopes; `width`: that for the curvature
    across a fold. `side`: the smallest number of grid
    cells along a side.

    `steps`: the largest number of steps along a curve. `turn`: the largest angle, in radians, by
    which a curve turns in a step; `straight`: the angle below which the next step is longer.
    `aside`: the largest distance of a step's end from where it was expected, relative to the step.
    `shortest`: the shortest step, relative to the longest. `beside`: points within this distance
    from a curve, relative to its steps, lie on it. `curves`: the largest number of curves of an
    outcome. `block`: the number of simulated values that are processed together.
    """

    most: int = 3
    reach: float = 7.0
    margin: float = 1.5
    iterations: int = 30
    longest: float = 1.0
    arrived: float = 1e-6
    apart: float = 1e-6
    difference: float = 3e-4
    width: float = 0.01
    side: int = 10
    steps: int = 1000
    turn: float = 0.5
    straight: float = 0.2
    aside: float = 0.3
    shortest: float = 1e-4
    beside: float = 0.01
    curves: int = 16
    block: int = 2_000_000

    def cells(self, parameters: int, cells: int) -> int:
        """The number of grid cells along each side, for two or three parameters."""
        return max(self.side, cells if parameters <= 2 else cells // 3)

    def points(self, parameters: int, cells: int) -> int:
        """The number of points of the grid."""
        return int((self.cells(parameters, cells) + 1) ** parameters)


CURVES = CurveSettings()
SECOND = ((-1.0, -0.5), (1.0, 0.5))
FOURTH = ((-2.0, 1.0 / 12.0), (-1.0, -2.0 / 3.0), (1.0, 2.0 / 3.0), (2.0, -1.0 / 12.0))
"""Central differences of second and of fourth order: the steps and the weights of the values."""
GAUSS = np.polynomial.legendre.leggauss(4)
"""The nodes on [-1, 1] and the weights of the Gauss rule for each step along a curve."""

SetPoints = tuple[Indices, Array, Array]
"""Experiments (H,), points (H, s) and logarithms (H,) of their parts of the densities."""


def traced(
    inputs: Inputs,
    alpha: Array,
    response: Divisible,
    condition: Indices,
    y: Array,
    cells: int,
    settings: CurveSettings = CURVES,
) -> SetPoints:
    """Points on the level sets of outcomes y (N, m), for a law alpha (K,) and laws near it.

    `condition` (N, m) are the numbers of the outcomes in the response. Returns experiments (H,),
    parameters x (H, n) and log weights (H,). By the coarea formula (Federer, 1969, 3.2.12) the
    density of the outcomes is the integral of p/sqrt(det J J') over the set, with the slopes J
    (m, s); it is sum_h w_h p(x_h | alpha). Each step along a curve has four Gauss nodes. `cells`
    is the number of grid cells along each of two sides, and the smallest number of steps in which
    a curve goes from end to end; a grid with three sides has a third of it along each. Cost: the
    outcomes of each condition at the points of the grid, and some ten for each node.
    """
    order, found = np.lexsort(condition.T[::-1]), list[SetPoints]()
    side = settings.cells(inputs.scattering, cells)
    points = y.shape[1] * settings.points(inputs.scattering, cells)
    for part in blocks(len(y), points, settings.block):
        rows = order[part]
        system = _System(inputs, alpha, response, condition[rows], y[rows], settings)
        owner, xi, log_value = system.solved(side, cells)
        x = system.x(xi)
        found.append((rows[owner], x, log_value - scattered_density(inputs, alpha, x)))
    owner, x, log_weight = (np.concatenate(part) for part in zip(*found, strict=True))
    return owner, x, log_weight


@dataclass(frozen=True, eq=False)
class _System:
    """The equations eta(x(xi)) = y of B experiments, each for its own outcomes (m,)."""

    inputs: Inputs
    alpha: Array
    response: Divisible
    condition: Indices
    y: Array
    settings: CurveSettings

    @property
    def unknowns(self) -> int:
        """The number s of variates."""
        return self.inputs.scattering

    def x(self, xi: Array) -> Array:
        """The parameters (R, n) at variates (R, s)."""
        found = parameters_at(self.inputs, self.alpha, xi[None], slice(0, 1), often=True)
        return np.asarray(found[0][0])

    def off(self, of: Indices, xi: Array) -> Array:
        """How far the outcomes (R, m) of experiments (R,) at variates (R, s) are from y."""
        m = self.y.shape[1]
        value = self.response.at(self.condition[of].ravel(), np.repeat(self.x(xi), m, axis=0))
        return np.asarray(value.reshape(-1, m) - self.y[of])

    def linear(
        self, of: Indices, xi: Array, stencil: tuple[tuple[float, float], ...] = SECOND
    ) -> tuple[Array, Array]:
        """How far the outcomes (R, m) are from y, and their slopes (R, m, s) by the variates."""
        count, s, by = len(of), self.unknowns, self.settings.difference
        moves = np.concatenate(
            [np.zeros((1, s)), *(place * by * np.eye(s) for place, _ in stencil)]
        )
        moved = (xi + moves[:, None]).reshape(-1, s)
        value = self.off(np.tile(of, len(moves)), moved).reshape(len(moves), count, self.y.shape[1])
        weights = np.array([weight for _, weight in stencil]) / by
        sides = value[1:].reshape(len(stencil), s, count, value.shape[2])
        return value[0], np.einsum("k,ksrm->rms", weights, sides)

    def solved(self, cells: int, steps: int) -> SetPoints:
        """The solutions as points with their parts of the density of the outcomes."""
        of, xi, slopes = self._arrived(*self._begun(cells))
        width = 2.0 * self.settings.reach / cells
        parts = (of, xi), self._arrived(*self._across(of, xi, slopes, width))[:2]
        of, xi = (np.concatenate(part) for part in zip(*parts, strict=True))
        kept = _distinct(np.column_stack([of, xi]), self.settings.apart)
        of, xi = of[kept], xi[kept]
        if self.y.shape[1] == self.unknowns:
            return self._weighed(of, xi, np.empty((len(of), 0, self.unknowns)), np.zeros(len(of)))
        return self._on_steps(_followed(self, of, xi, 2.0 * self.settings.reach / steps))

    def _arrived(self, of: Indices, xi: Array, along: Array) -> tuple[Indices, Array, Array]:
        """The experiments and the solutions to which Newton's method leads, with their slopes."""
        xi, there, slopes = self.corrected(of, xi, along)
        there &= np.abs(xi).max(axis=1, initial=0.0) <= self.settings.reach
        return of[there], xi[there], slopes[there]

    def _across(
        self, of: Indices, xi: Array, slopes: Array, width: float
    ) -> tuple[Indices, Array, Array]:
        """Where the partner of each solution may lie, if a fold is nearer than a cell's width.

        In the direction in which the outcomes change least they are taken as quadratic. Returns
        experiments and points, and the directions in which these do not move.
        """
        m, by = self.y.shape[1], self.settings.width
        u, size, v = np.linalg.svd(slopes)
        least = v[:, m - 1]
        value = self.off(np.tile(of, 2), np.concatenate([xi + by * least, xi - by * least]))
        bend = np.einsum("rm,krm->r", u[:, :, -1], value.reshape(2, *slopes.shape[:2])) / by**2
        with np.errstate(divide="ignore", invalid="ignore"):
            far = -2.0 * size[:, -1] / bend
        near = np.abs(far) < width
        return of[near], xi[near] + far[near, None] * least[near], v[near, m:]

    def corrected(self, of: Indices, xi: Array, along: Array) -> tuple[Array, Flags, Array]:
        """The solutions (R, s) to which Newton's method leads from xi (R, s), normal to `along`.

        `along` (R, s - m, s) are directions in which the points do not move. Also returns flags
        (R,) of the points that arrived, and the slopes (R, m, s) there. The last step must be
        short: a jump over the measured outcomes is no solution.
        """
        settings, m = self.settings, self.y.shape[1]
        xi, arrived, left = xi.copy(), np.zeros(len(of), dtype=np.bool_), np.arange(len(of))
        last = np.full((len(of), m, self.unknowns), np.nan)
        for _ in range(settings.iterations):
            if not left.size:
                break
            missed, slopes = self.linear(of[left], xi[left])
            matrix = np.concatenate([slopes, along[left]], axis=1)
            regular = _regular(matrix) & np.isfinite(missed).all(axis=1)
            left, matrix = left[regular], matrix[regular]
            last[left] = slopes[regular]
            wanted = np.zeros((left.size, self.unknowns))
            wanted[:, :m] = -missed[regular]
            step = np.linalg.solve(matrix, wanted[..., None])[..., 0]
            length = np.sqrt(np.sum(step**2, axis=1))
            xi[left] += (
                step * np.minimum(1.0, settings.longest / np.maximum(length, 1e-300))[:, None]
            )
            arrived[left] = length < settings.arrived
            inside = np.abs(xi[left]).max(axis=1, initial=0.0) < settings.reach + settings.longest
            left = left[(length >= settings.arrived) & inside]
        return xi, arrived, last

    def _begun(self, cells: int) -> tuple[Indices, Array, Array]:
        """Experiments (R,), points (R, s) to search from, and fixed directions (R, s - m, s).

        In each cell of a grid the outcomes are replaced by a linear function, of which the slopes
        are the mean differences between the corners. Its solution nearest to the middle is where a
        search begins, if it is not far outside the cell. Of solutions in the same cell the nearest
        and the farthest are enough, unless the signs of the slopes differ, as they do on either
        side of a fold.
        """
        settings, s, m = self.settings, self.unknowns, self.y.shape[1]
        t = np.linspace(-settings.reach, settings.reach, cells + 1)
        grid = np.stack(np.meshgrid(*[t] * s, indexing="ij"), axis=-1).reshape(-1, s)
        own, where = np.unique(self.condition, return_inverse=True)
        where = where.reshape(self.condition.shape)
        v = self.response.take(own).evaluate(self.x(grid)).reshape(-1, *[cells + 1] * s)
        middle, rise = _linear(v)
        bound = settings.margin * np.abs(rise).sum(axis=2)
        near: Flags = np.ones((len(self.y), middle.shape[1]), dtype=np.bool_)
        for k in range(m):
            near &= np.abs(middle[where[:, k]] - self.y[:, k, None]) <= bound[where[:, k]]
        of, cell = np.nonzero(near)
        slopes = rise[where[of], cell[:, None]]
        missing = self.y[of] - middle[where[of], cell[:, None]]
        square = slopes @ slopes.transpose(0, 2, 1)
        regular = _regular(square)
        of, cell, slopes = of[regular], cell[regular], slopes[regular]
        part = np.linalg.solve(square[regular], missing[regular][..., None])
        step = (slopes.transpose(0, 2, 1) @ part)[..., 0]
        far = np.abs(step).max(axis=1, initial=0.0)
        nearest = np.argsort(far, kind="stable")
        nearest = nearest[: np.searchsorted(far[nearest], settings.margin, side="right")]
        of, slopes, step = of[nearest], slopes[nearest], step[nearest]
        place = 0.5 + step + np.stack(np.unravel_index(cell[nearest], (cells,) * s), axis=1)
        signs = (slopes > 0.0).reshape(len(of), m * s) @ 2 ** np.arange(m * s)
        key = np.column_stack([of, np.floor(place).astype(np.intp), signs])
        ends = [np.unique(one, axis=0, return_index=True)[1] for one in (key, key[::-1])]
        few = np.union1d(ends[0], len(key) - 1 - ends[1])
        xi = -settings.reach + 2.0 * settings.reach / cells * place[few]
        return of[few], xi, np.linalg.svd(slopes[few])[2][:, m:]

    def _on_steps(self, steps: tuple[Indices, Array, Array, Array]) -> SetPoints:
        """The Gauss nodes of steps along curves, moved onto the curves normal to the steps."""
        of = np.repeat(steps[0], GAUSS[0].size)
        begin, end, bend = (np.repeat(part, GAUSS[0].size, axis=0) for part in steps[1:])
        node, weight = (np.tile(part, len(steps[0])) for part in GAUSS)
        chord, t = end - begin, 0.5 * (1.0 + node[:, None])
        size = np.sqrt(np.sum(chord**2, axis=1))
        along = (chord / size[:, None])[:, None]
        xi = begin + t * chord + t * (1.0 - t) * bend
        xi, there, _ = self.corrected(of, xi, along)
        log_size = np.log(0.5 * weight * size)
        return self._weighed(of[there], xi[there], along[there], log_size[there])

    def _weighed(self, of: Indices, xi: Array, along: Array, log_size: Array) -> SetPoints:
        """The points with the logarithms of phi(xi)/|det (J, along)| times their sizes."""
        matrix = np.concatenate([self.linear(of, xi, FOURTH)[1], along], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            log_det = np.linalg.slogdet(matrix)[1]
        log_density = -0.5 * np.sum(xi**2, axis=1) - 0.5 * self.unknowns * np.log(2.0 * np.pi)
        log_value = log_density - log_det + log_size
        fine = np.isfinite(log_value)
        return of[fine], xi[fine], log_value[fine]


def _linear(v: Array) -> tuple[Array, Array]:
    """The outcomes (U, C) in the middles of cells, and their rises (U, C, s) across the cells.

    They are means over the corners of the values v (U, T, ..., T) at the points of a grid.
    """
    s, count = v.ndim - 1, v.shape[1] - 1
    middle, rises = np.zeros((len(v), count**s)), np.zeros((len(v), count**s, s))
    with np.errstate(invalid="ignore", over="ignore"):
        for place in product((0, 1), repeat=s):
            corner = v[:, *[slice(i, count + i) for i in place]].reshape(len(v), -1)
            middle += corner / 2**s
            for i, high in enumerate(place):
                rises[..., i] += (2 * high - 1) * corner / 2 ** (s - 1)
    return middle, rises


def _followed(
    system: _System, of: Indices, xi: Array, longest: float
) -> tuple[Indices, Array, Array, Array]:
    """The steps along all curves through the points xi (R, s) of experiments (R,).

    Each curve is followed once, from its point nearest to the middle of the law; steps along a
    curve that was followed before are left out. Returns
    experiments (H,), both ends (H, s) of each step, and its bend (H, s): the place at a share t of
    a step is begin + t chord + t (1 - t) bend.
    """
    settings, done = system.settings, list[tuple[Indices, Array, Array, Array]]()
    nearest = np.argsort(np.sum(xi**2, axis=1), kind="stable")
    of, xi = of[nearest], xi[nearest]
    for _ in range(settings.curves):
        if not of.size:
            break
        first = np.unique(of, return_index=True)[1]
        curves = _both_sides(system, of[first], xi[first], longest)
        for known in done:
            again = np.ones(len(curves[0]), dtype=np.bool_)
            for end in curves[1:3]:
                again[again] = _on_curves(curves[0][again], end[again], known, settings.beside)
            curves = (curves[0][~again], curves[1][~again], curves[2][~again], curves[3][~again])
        done.append(curves)
        left = np.ones(of.size, dtype=np.bool_)
        left[first] = False
        left[left] = ~_on_curves(of[left], xi[left], curves, settings.beside)
        of, xi = of[left], xi[left]
    if not done:
        return of, xi, xi, xi
    whose, begin, end, bend = (np.concatenate(part) for part in zip(*done, strict=True))
    return whose, begin, end, bend


def _both_sides(
    system: _System, of: Indices, xi: Array, longest: float
) -> tuple[Indices, Array, Array, Array]:
    """The steps along the curves through one point (R, s) of each experiment (R,).

    All curves are followed to both sides at once. Of a curve that is closed one side is enough.
    """
    settings, count = system.settings, len(of)
    direction = _tangents(system.linear(of, xi)[1])
    whose, first = np.tile(of, 2), np.tile(xi, (2, 1))
    here, begun = first.copy(), np.concatenate([direction, -direction])
    heading, size = begun.copy(), np.full(2 * count, longest)
    closed, made = np.zeros(2 * count, dtype=np.bool_), np.zeros(2 * count, dtype=np.intp)
    steps = [(np.empty(0, dtype=np.intp), *[np.empty((0, system.unknowns))] * 3)]
    going = np.flatnonzero(np.isfinite(begun).all(axis=1))
    for _ in range(settings.steps):
        if not going.size:
            break
        ahead, length = heading[going], size[going]
        expected = here[going] + length[:, None] * ahead
        there, arrived, slopes = system.corrected(whose[going], expected, ahead[:, None])
        after = _tangents(slopes)
        cosine = np.sum(after * ahead, axis=1)
        after *= np.where(cosine < 0.0, -1.0, 1.0)[:, None]
        angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
        missed = np.sqrt(np.sum((there - expected) ** 2, axis=1))
        good = arrived & (angle < settings.turn) & (missed < settings.aside * length)
        size[going] = np.where(good, length, 0.5 * length)
        moved, begin, end = going[good], here[going[good]], there[good]
        before, after = ahead[good], after[good]
        back = (made[moved] > 1) & _passed(first[moved], begun[moved], begin, end, before, settings)
        end[back], after[back] = first[moved[back]], begun[moved[back]]
        steps.append((moved, begin, end, _bend(begin, end, before, after)))
        here[moved], heading[moved] = end, after
        made[moved] += 1
        closed[moved[back]] = True
        easy = angle[good] < settings.straight
        size[moved] = np.minimum(np.where(easy, 1.5, 1.0) * size[moved], longest)
        over = closed[going] | (np.abs(here[going]).max(axis=1) > settings.reach)
        going = going[~over & (size[going] > settings.shortest * longest)]
    of_step, begin, end, bend = (np.concatenate(part) for part in zip(*steps, strict=True))
    once = (of_step < count) | ~closed[of_step % count]
    return whose[of_step[once]], begin[once], end[once], bend[once]


def _tangents(slopes: Array) -> Array:
    """The directions (R, s) of curves with these slopes (R, s - 1, s); NaN where these are."""
    known = np.isfinite(slopes).all(axis=(1, 2))
    found = np.full((len(slopes), slopes.shape[2]), np.nan)
    found[known] = np.linalg.svd(slopes[known])[2][:, -1]
    return found


def _passed(
    first: Array, begun: Array, begin: Array, end: Array, before: Array, settings: CurveSettings
) -> Flags:
    """Flags (R,) of steps (R, s) that pass the first points of their curves, which are closed."""
    chord, home = end - begin, first - begin
    square = np.sum(chord**2, axis=1)
    share = np.sum(home * chord, axis=1) / square
    off = np.sqrt(np.sum((home - share[:, None] * chord) ** 2, axis=1))
    found: Flags = (share > 0.0) & (share <= 1.0) & (off < 0.5 * settings.turn * np.sqrt(square))
    found &= np.sum(before * begun, axis=1) > 0.0
    return found


def _bend(begin: Array, end: Array, before: Array, after: Array) -> Array:
    """The bends (R, s) of steps whose directions at the two ends are known.

    t (1 - t) bend is the parabola, normal to the chord, with the mean of the two slopes.
    """
    chord = end - begin
    size = np.sum(chord**2, axis=1, keepdims=True)
    slopes = [one * size / np.sum(one * chord, axis=1, keepdims=True) - chord
              for one in (before, after)]  # fmt: skip
    return np.asarray(0.5 * (slopes[0] - slopes[1]))


def _on_curves(
    of: Indices, xi: Array, curves: tuple[Indices, Array, Array, Array], beside: float
) -> Flags:
    """Flags (R,) of the points xi (R, s) of experiments (R,) that lie on steps of their curves."""
    whose, begin, end, bend = curves
    order = np.argsort(whose, kind="stable")
    whose, begin, chord, bend = whose[order], begin[order], (end - begin)[order], bend[order]
    low, high = (np.searchsorted(whose, of, side=side) for side in ("left", "right"))
    found = np.zeros(of.size, dtype=np.bool_)
    square = np.sum(chord**2, axis=1)
    for place in range(int((high - low).max(initial=0))):
        rows = np.flatnonzero(~found & (low + place < high))
        step = low[rows] + place
        share = np.sum((xi[rows] - begin[step]) * chord[step], axis=1) / square[step]
        t = np.clip(share, 0.0, 1.0)[:, None]
        at = begin[step] + t * chord[step] + t * (1.0 - t) * bend[step]
        off = np.sum((xi[rows] - at) ** 2, axis=1)
        found[rows] = off < beside**2 * square[step]
    return found


def _regular(matrix: Array) -> Flags:
    """Flags (R,) of finite matrices (R, s, s) that have an inverse."""
    with np.errstate(all="ignore"):
        found: Flags = np.isfinite(matrix).all(axis=(1, 2)) & (np.abs(np.linalg.det(matrix)) > 0.0)
    return found


def _distinct(points: Array, apart: float) -> Indices:
    """The indices of points (R, d), whose first coordinate is an owner, without repetitions.

    They are sorted along a direction in which points that differ are not equally far by symmetry.
    """
    along = points[:, 1:] @ np.sqrt(np.arange(2.0, points.shape[1] + 1.0))
    order = np.lexsort((along, points[:, 0]))
    near = np.abs(np.diff(points[order], axis=0)).max(axis=1, initial=0.0) < apart
    return np.asarray(order[np.concatenate([[True], ~near])[: len(order)]])
