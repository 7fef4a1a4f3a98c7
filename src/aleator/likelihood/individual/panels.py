"""Nodes on panels that follow kinks, fronts and jumps: of one variate, and of two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from aleator.core.polynomials import gauss_legendre
from aleator.core.types import Array, Flags, Indices
from aleator.likelihood.individual.lines import (
    LINES,
    LineSettings,
    Pieces,
    in_halves,
    integrated,
    log_sum,
    placed,
)
from aleator.likelihood.individual.modes import (
    MODES,
    AsManyAsNeeded,
    Curved,
    Modes,
    Valued,
    modes,
)


@dataclass(frozen=True)
class PanelSettings:
    """How panels of one variate begin, and the rules beside them; chosen by judgement.

    `finer_points`: Gauss-Legendre nodes of half a panel of those that tell how exact these are.
    `halves`: halves of panels that an experiment takes, about. `arrived`: what a step may gain in
    log-density where a mode is taken as found. `reach` and `places`: the log-density is looked at,
    to seek modes from its highest points, at so many variates that go so far. `modes`: modes that
    are sought, besides the one that is known; two within the width of the first are one. `edges`:
    number of edges of the first panels; further ones lie about the modes, in their widths.
    `rough_points` and `rough_enough`: nodes of half a panel, and the share of the integral, for
    statistics of many replicates. `split`: panels of an experiment that are halved at once.
    `rounds`: times that panels are halved; at a jump, twelve digits. `lines`: the settings of
    lines, of which panels have the ends and the edges about tops.
    """

    finer_points: int = 12
    halves: int = 64
    arrived: float = 1e-3
    reach: float = 5.0
    places: int = 41
    modes: int = 6
    edges: int = 13
    rough_points: int = 4
    rough_enough: float = 1e-3
    split: int = 4
    rounds: int = 40
    lines: LineSettings = LINES


PANELS = PanelSettings()


@dataclass(frozen=True)
class Panels(AsManyAsNeeded):
    """Gauss-Legendre nodes in panels of one variate, halved until they are enough.

    `points` in each half of a panel, which is not halved again where that changes `enough` of the
    integral or less (both by judgement). For an individual law with several modes, a plateau, a
    front, a kink or a jump. Adaptive quadrature (Gander and Gautschi, 2000): the panel is halved
    whose integral the halves change most. Cost: some hundred nodes an experiment.
    """

    points: int = 8
    enough: float = 1e-6
    settings: PanelSettings = field(default=PANELS, repr=False)

    @property
    def name(self) -> str:
        """Name for reports."""
        return "panels"

    @property
    def rough(self) -> Panels:
        """A third of the nodes, exact to a thousandth."""
        own = self.settings
        return Panels(own.rough_points, own.rough_enough, own)

    def size(self, dimensions: int) -> int:  # noqa: ARG002  one interface for all rules
        """Nodes that an experiment takes, about."""
        return self.settings.halves * self.points

    def finer(self, dimensions: int) -> tuple[Panels, ...]:  # noqa: ARG002
        """The rule that tells how exact this one is; none tells it of that."""
        finer = Panels(self.settings.finer_points, settings=self.settings)
        return (finer,) if self.points < finer.points else ()

    def about(
        self,
        curved: Curved,
        valued: Valued,
        found: Modes,
        first: int,  # noqa: ARG002
    ) -> tuple[Array, Array]:
        """Nodes xi (B, C J, 1) of B experiments with C classes, and their log weights.

        int g(xi) phi(xi) dxi = sum_j exp(log_weight_j) g(xi_j) in each class, where the log-density
        is that of g(xi) exp(-xi^2/2).
        """
        of_class = _OfClasses(curved, valued, found.z.shape[1])
        edges = _first_edges(of_class, found.z.reshape(-1, 1, 1), self.settings)
        tree = _Tree.of(of_class, edges[:, :-1], edges[:, 1:], self)
        for _ in range(self.settings.rounds):
            open_ = tree.open_
            if not np.any(open_):
                break
            split = min(self.settings.split, int(open_.sum(axis=1).max()))
            tree = tree.halved(of_class, split)
        xi, log_weight = tree.nodes()
        experiments = len(found.z)
        return xi.reshape(experiments, -1, 1), log_weight.reshape(experiments, -1)


@dataclass(frozen=True, eq=False)
class _OfClasses:
    """The log-densities with each class as an experiment of its own, the classes side by side."""

    together: Curved
    values: Valued
    classes: int

    def __call__(self, z: Array) -> Array:
        """Values (B C, P) at variates z (B C, P, 1)."""
        return self.values(self._joint(z)).reshape(len(z), -1)

    def curved(self, z: Array) -> tuple[Array, Array, Array]:
        """Values, gradients (B C, P, 1) and information (B C, P, 1, 1)."""
        value, gradient, information = self.together(self._joint(z))
        own = (len(z), -1)
        return (
            value.reshape(own),
            gradient.reshape(*own, 1),
            information.reshape(*own, 1, 1),
        )

    def _joint(self, z: Array) -> Array:
        return z.reshape(len(z) // self.classes, -1, 1)


@dataclass(frozen=True, eq=False)
class _Tree:
    """Panels [low, high] (B, P) of B experiments; `log_f` (B, P, 2 q) at the nodes of their halves.

    `whole` (B, P) is the logarithm of each integral by the nodes of the panel itself.
    """

    low: Array
    high: Array
    log_f: Array
    whole: Array
    rule: Panels

    @classmethod
    def of(cls, log_density: Valued, low: Array, high: Array, rule: Panels) -> _Tree:
        """Panels that nothing is known of."""
        t, w = gauss_legendre(rule.points)
        whole = log_sum(_evaluated(log_density, placed(t, low, high)), w, high - low)
        log_f = _evaluated(log_density, in_halves(low, high, rule.points))
        return cls(low, high, log_f, whole, rule)

    @property
    def points(self) -> int:
        """Nodes of half a panel."""
        return self.rule.points

    @property
    def by_halves(self) -> Array:
        """The logarithm (B, P, 2) of the integral over each half."""
        w = gauss_legendre(self.points)[1]
        parts = self.log_f.reshape(*self.low.shape, 2, self.points)
        return log_sum(parts, w, 0.5 * (self.high - self.low)[..., None])

    @property
    def error(self) -> Array:
        """What halving a panel changes (B, P), as a share of the integral of its experiment."""
        found = np.logaddexp(self.by_halves[..., 0], self.by_halves[..., 1])
        top = found.max(axis=1, keepdims=True)
        top = np.where(np.isfinite(top), top, 0.0)
        total = np.exp(found - top).sum(axis=1, keepdims=True)
        change = np.abs(np.exp(found - top) - np.exp(self.whole - top))
        return np.where(total > 0.0, change / np.where(total > 0.0, total, 1.0), 0.0)

    @property
    def open_(self) -> Flags:
        """Which panels (B, P) are to be halved."""
        return np.asarray(self.error > self.rule.enough)

    def halved(self, log_density: Valued, count: int) -> _Tree:
        """With the worst `count` panels of each experiment halved."""
        worst = np.argsort(-self.error, axis=1)[:, :count]
        low, high = (np.take_along_axis(end, worst, axis=1) for end in (self.low, self.high))
        middle = 0.5 * (low + high)
        split = np.take_along_axis(self.by_halves, worst[..., None], axis=1)
        new_low = np.concatenate([low, middle], axis=1)
        new_high = np.concatenate([middle, high], axis=1)
        log_f = _evaluated(log_density, in_halves(new_low, new_high, self.points))
        kept = np.ones(self.low.shape, dtype=np.bool_)
        np.put_along_axis(kept, worst, False, axis=1)
        rest = (len(kept), -1)
        return _Tree(
            np.concatenate([self.low[kept].reshape(rest), new_low], axis=1),
            np.concatenate([self.high[kept].reshape(rest), new_high], axis=1),
            np.concatenate([self.log_f[kept].reshape(*rest, 2 * self.points), log_f], axis=1),
            np.concatenate([self.whole[kept].reshape(rest), split[..., 0], split[..., 1]], axis=1),
            self.rule,
        )

    def nodes(self) -> tuple[Array, Array]:
        """Nodes xi (B, J, 1) and log weights (B, J); J is the most that any experiment needs."""
        experiments = len(self.low)
        xi = in_halves(self.low, self.high, self.points).reshape(experiments, -1)
        t_weight = np.tile(np.log(gauss_legendre(self.points)[1]), 2)
        with np.errstate(divide="ignore"):
            width = np.log(0.5 * (self.high - self.low))
        log_weight = (width[..., None] + t_weight).reshape(experiments, -1)
        share = self.log_f.reshape(experiments, -1) + log_weight
        top = share.max(axis=1, keepdims=True)
        deepest = self.rule.settings.lines.deepest
        needed = share > np.where(np.isfinite(top), top, 0.0) + deepest
        most = max(1, int(needed.sum(axis=1).max()))
        best = np.sort(np.argsort(-share, axis=1)[:, :most], axis=1)
        xi, log_weight = (np.take_along_axis(part, best, axis=1) for part in (xi, log_weight))
        log_law = -0.5 * xi**2 - 0.5 * np.log(2.0 * np.pi)
        return xi[..., None], log_weight + log_law


def _first_edges(of_class: _OfClasses, known: Array, settings: PanelSettings) -> Array:
    """Edges (B, E) of panels over the law, and about each mode in its own width.

    Modes are sought from the `known` one (B, 1, 1) and from where the log-density has its tops.
    """
    experiments, lines = len(known), settings.lines
    start = np.concatenate([known, _tops(of_class, experiments, settings)], axis=1)
    found = modes(of_class.curved, start, arrived=settings.arrived)
    at, width, own = _distinct(of_class, found, lines.deepest)
    of_top = np.array(lines.top_edges)
    about = np.where(own[..., None], at[..., None] + width[..., None] * of_top, lines.farthest)
    about = np.clip(about.reshape(experiments, -1), -lines.farthest, lines.farthest)
    edges = np.linspace(-lines.farthest, lines.farthest, settings.edges)
    everywhere = np.broadcast_to(edges, (experiments, edges.size))
    return np.sort(np.concatenate([everywhere, about], axis=1), axis=1)


def _tops(of_class: _OfClasses, experiments: int, settings: PanelSettings) -> Array:
    """The highest points (B, M, 1) among neighbors; the very highest where there are fewer."""
    places = np.linspace(-settings.reach, settings.reach, settings.places)
    points = np.broadcast_to(places[:, None], (experiments, places.size, 1))
    value = np.nan_to_num(of_class(points), nan=-np.inf)
    beside = np.pad(value, ((0, 0), (1, 1)), constant_values=-np.inf)
    top = (value >= beside[:, :-2]) & (value > beside[:, 2:])
    ranked = np.where(top, value, -np.inf)
    best = np.argsort(-ranked, axis=1)[:, : settings.modes]
    found = np.take_along_axis(ranked, best, axis=1)
    return places[np.where(np.isfinite(found), best, best[:, :1])][..., None]


def _distinct(of_class: _OfClasses, found: Modes, deepest: float) -> tuple[Array, Array, Flags]:
    """Modes (B, P), their widths, and which of them are: the highest first, each once."""
    at, width = found.z[..., 0], 1.0 / np.sqrt(found.information[..., 0, 0])
    value = np.nan_to_num(of_class(found.z), nan=-np.inf)
    order = np.argsort(-value, axis=1)
    at, width, value = (np.take_along_axis(part, order, axis=1) for part in (at, width, value))
    own = value > value[:, :1] + deepest
    own[:, 0] = True
    for k in range(1, at.shape[1]):
        near = np.abs(at[:, k : k + 1] - at[:, :k]) < width[:, :k]
        own[:, k] &= ~np.any(near & own[:, :k], axis=1)
    first = np.argsort(~own, axis=1, kind="stable")[:, : int(own.sum(axis=1).max())]
    at, width = (np.take_along_axis(part, first, axis=1) for part in (at, width))
    return at, width, np.take_along_axis(own, first, axis=1)


def _evaluated(log_density: Valued, at: Array) -> Array:
    """The log-density (B, P, q) at points (B, P, q)."""
    value = log_density(at.reshape(len(at), -1, 1))
    return np.asarray(np.nan_to_num(value, nan=-np.inf).reshape(at.shape))


@dataclass(frozen=True)
class PlaneSettings:
    """How fine the panels of two variates are, and where their lines run; chosen by judgement.

    `points`: Gauss-Legendre nodes of half a panel. `enough`: share of the integral that halving a
    panel may change. `coarse_enough`: that share where panels begin. `missed`: change of the
    log-likelihood with more panels from where on coarse ones are not enough. `finer_points` and
    `finer_enough`: nodes and share of those that tell how exact these are. `rough_enough`: the
    share for statistics of many replicates. `along`: the share of lines over that across them;
    errors of lines must not look like roughness across them. `spread`: variates along each axis
    whose pairs lie all over the law. `size`: nodes of an experiment for which there must be memory
    while they are sought. `left`: share of an integral that is left out with its smallest parts.
    `lines`: the settings of lines.
    """

    points: int = 4
    enough: float = 3e-4
    coarse_enough: float = 3e-3
    missed: float = 0.01
    finer_points: int = 6
    finer_enough: float = 3e-5
    rough_enough: float = 1e-2
    along: float = 0.1
    spread: tuple[float, ...] = (-1.5, -0.5, 0.5, 1.5)
    size: int = 16_000
    left: float = 1e-9
    lines: LineSettings = LINES


PLANES = PlaneSettings()


@dataclass(frozen=True)
class PlanePanels(AsManyAsNeeded):
    """Panels of two variates: adaptive along each line, and the lines adaptive across.

    int int g du dv = int (int g(u, v) dv) du. The lines run where the observations tell most,
    across the ridge, so that a front, a kink or a jump of the outcome is met by panels that are
    halved there, and what is left to integrate along the ridge is smoother than the outcome
    (Fubini). That direction is an eigenvector of the information at the mode, or of its mean over
    the law where the mode is on a plateau; the result does not depend on it, the number of nodes
    does. For individual laws with several modes too. Cost: some hundred lines with some fifty
    nodes each, and ten times as many values of the log-density to find them.

    >>> PlanePanels().centers
    1
    """

    points: int = PLANES.points
    enough: float = PLANES.enough
    settings: PlaneSettings = field(default=PLANES, repr=False)

    @property
    def name(self) -> str:
        """Name for reports."""
        return "panels of two variates"

    @property
    def rough(self) -> PlanePanels:
        """The same, exact to a hundredth."""
        enough = max(self.enough, self.settings.rough_enough)
        return replace(self, points=self.settings.points, enough=enough)

    def size(self, dimensions: int) -> int:  # noqa: ARG002  one interface for all rules
        """Nodes that an experiment takes while they are sought, about."""
        return self.settings.size

    @classmethod
    def coarse(cls, settings: PlaneSettings = PLANES) -> PlanePanels:
        """Half the nodes, which mostly do."""
        return cls(settings.points, settings.coarse_enough, settings)

    def finer(self, dimensions: int) -> tuple[PlanePanels, ...]:  # noqa: ARG002
        """The rule that tells how exact this one is; none tells it of the finest."""
        own = self.settings
        if self.enough > own.enough:
            return (PlanePanels(own.points, own.enough, own),)
        finer = PlanePanels(own.finer_points, own.finer_enough, own)
        return (finer,) if self.points < finer.points else ()

    def refined(
        self,
        gaps: Sequence[float],
        enough: float,
        dimensions: int,  # noqa: ARG002
    ) -> PlanePanels | None:
        """Those that are not coarse, where they are needed."""
        own = self.settings
        needed = self.enough > own.enough and abs(sum(gaps)) > max(enough, own.missed)
        return PlanePanels(own.points, own.enough, own) if needed else None

    def about(
        self,
        curved: Curved,
        valued: Valued,
        found: Modes,
        first: int,  # noqa: ARG002
    ) -> tuple[Array, Array]:
        """Nodes xi (B, C J, 2) of B experiments with C classes, and their log weights.

        int g(xi) phi(xi) dxi = sum_j exp(log_weight_j) g(xi_j) in each class, where the log-density
        is that of g(xi) exp(-xi^2/2).
        """
        count, classes = found.z.shape[:2]
        own = self.settings
        basis = _turned(curved, found.information[:, :, 0], own.spread).reshape(-1, 2, 2)
        plane = _Plane(valued, basis, classes, self)
        across, totals = integrated(
            plane.marginal, np.arange(len(basis)), self.points, self.enough, own.lines
        )
        row, u, log_u, value = across.flat
        lines = _needed(row, value + log_u - totals[row], len(basis), own.left)
        row, u, log_u, value = row[lines], u[lines], log_u[lines], value[lines]
        line, v, log_v, value_v = plane.along(row, u)[0].flat
        share = value_v + log_v + log_u[line] - totals[row[line]]
        nodes = _needed(row[line], share, len(basis), own.left)
        line, v, log_v = line[nodes], v[nodes], log_v[nodes]
        xi = plane.turned(row[line], u[line], v)
        log_weight = log_u[line] + log_v - 0.5 * np.sum(xi**2, axis=1) - np.log(2.0 * np.pi)
        return _side_by_side(row[line], xi, log_weight, (count, classes))


@dataclass(frozen=True, eq=False)
class _Plane:
    """The log-densities of R = B C rows, an experiment and a class each, in turned coordinates.

    `basis` (R, 2, 2): its first column is the direction of u, across the lines, its second of v.
    """

    valued: Valued
    basis: Array
    classes: int
    rule: PlanePanels

    def turned(self, row: Indices, u: Array, v: Array) -> Array:
        """The variates (..., 2) at u and v (...) of rows (...)."""
        basis = self.basis[row]
        return np.asarray(u[..., None] * basis[..., 0] + v[..., None] * basis[..., 1])

    def along(self, row: Indices, u: Array) -> tuple[Pieces, Array]:
        """The panels of lines (L,) of these rows, and the logarithms (L,) of their integrals."""

        def log_density(line: Indices, v: Array) -> Array:
            owner = np.repeat(row[line], v.shape[1])
            xi = self.turned(owner, np.repeat(u[line], v.shape[1]), v.ravel())
            return self._values(owner, xi).reshape(v.shape)

        settings = self.rule.settings
        enough = settings.along * self.rule.enough
        return integrated(log_density, row, self.rule.points, enough, settings.lines)

    def marginal(self, row: Indices, u: Array) -> Array:
        """The logarithm (T, q) of the integral over v at u (T, q)."""
        return self.along(np.repeat(row, u.shape[1]), u.ravel())[1].reshape(u.shape)

    def _values(self, row: Indices, xi: Array) -> Array:
        """The log-density (T,) at variates xi (T, 2) of rows (T,)."""
        place, most = _within(row, len(self.basis))
        together = np.zeros((len(self.basis), most, 2))
        together[row, place] = xi
        joint = together.reshape(-1, self.classes * most, 2)
        return np.asarray(self.valued(joint).reshape(-1, most)[row, place])


def _turned(curved: Curved, information: Array, spread: Sequence[float]) -> Array:
    """Eigenvectors (B, C, 2, 2), as columns, of information (B, C, 2, 2): the most told last."""
    count, classes = information.shape[:2]
    over = np.array(list(product(spread, repeat=2)))
    points = np.tile(over, (count, classes, 1))
    over_law = curved(points)[2].reshape(count, classes, len(over), 2, 2).mean(axis=2)
    flat = np.linalg.eigvalsh(information)[..., -1] < MODES.informed
    chosen = np.where(flat[..., None, None], over_law, information)
    return np.linalg.eigh(chosen)[1]


def _needed(row: Indices, share: Array, rows: int, left: float) -> Flags:
    """Which parts are needed, by the logarithms (T,) of their shares: not the smallest ones."""
    order = np.lexsort((share, row))
    part = np.exp(np.minimum(share[order], 0.0))
    sums = np.cumsum(part)
    before = np.concatenate([[0.0], np.cumsum(np.bincount(row, np.exp(share), minlength=rows))])
    needed = np.zeros(len(row), dtype=np.bool_)
    needed[order] = sums - before[row[order]] > left
    return needed


def _within(row: Indices, rows: int) -> tuple[Indices, int]:
    """The position (T,) of each among those of its row (T,), and the most that a row has."""
    counts = np.bincount(row, minlength=rows)
    order = np.argsort(row, kind="stable")
    place = np.empty(len(row), dtype=np.intp)
    place[order] = np.arange(len(row)) - (np.cumsum(counts) - counts)[row[order]]
    return place, int(counts.max(initial=1))


def _side_by_side(
    row: Indices, xi: Array, log_weight: Array, shape: tuple[int, int]
) -> tuple[Array, Array]:
    """Nodes (T, 2) of rows (T,) as (B, C J, 2), and their weights; what lacks has no weight."""
    rows = shape[0] * shape[1]
    place, most = _within(row, rows)
    nodes, log_weights = np.zeros((rows, most, 2)), np.full((rows, most), -np.inf)
    nodes[row, place], log_weights[row, place] = xi, log_weight
    return nodes.reshape(shape[0], -1, 2), log_weights.reshape(shape[0], -1)
