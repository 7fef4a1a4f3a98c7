"""Nodes on panels that follow kinks, fronts and jumps: of one variate, and of two.

The panels are those of adaptive quadrature (Gander and Gautschi, 2000; module `lines`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import ClassVar

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.likelihood.individual.lines import LINES, LineSettings, Pieces, integrated
from aleator.likelihood.individual.modes import (
    MODES,
    Curved,
    DenseRule,
    IndividualLaws,
    ModeSettings,
    Valued,
)


@dataclass(frozen=True)
class PanelSettings:
    """How fine the panels of one variate are; chosen by judgement.

    `finer_points`: Gauss-Legendre nodes of half a panel of the finer rule that shows how exact this
    one is. `rough_points` and `rough_enough`: nodes of half a panel, and the share of the integral,
    for statistics of many replicates. `size`: nodes of an experiment for which there must be memory
    while they are sought. `left`: share of an integral that is left out with its smallest parts.
    `lines`: the settings of lines.
    """

    finer_points: int = 12
    rough_points: int = 4
    rough_enough: float = 1e-3
    size: int = 512
    left: float = 1e-12
    lines: LineSettings = LINES


PANELS = PanelSettings()


@dataclass(frozen=True)
class Panels(DenseRule):
    """Gauss-Legendre nodes in panels of one variate, halved until they are enough.

    `points` in each half of a panel, which is not halved again where that changes `enough` of the
    integral or less (both by judgement). For an individual law with several modes, a plateau, a
    front, a kink or a jump. Cost: some hundred nodes an experiment.
    """

    name: ClassVar[str] = "panels"
    points: int = 8
    enough: float = 1e-6
    settings: PanelSettings = field(default=PANELS, repr=False)

    @property
    def rough(self) -> Panels:
        """A third of the nodes, exact to a thousandth."""
        own = self.settings
        return Panels(own.rough_points, own.rough_enough, own)

    def size(self, _: int, /) -> int:
        """Nodes that an experiment takes, about."""
        return self.settings.size

    def finer(self, _: int, /) -> tuple[Panels, ...]:
        """The rule that shows how exact this one is; there is none for the finer one."""
        finer = Panels(self.settings.finer_points, settings=self.settings)
        return (finer,) if self.points < finer.points else ()

    def place(self, laws: IndividualLaws) -> tuple[Array, Array]:
        """Nodes xi (B, C J, 1), where the panels of each class are fine enough."""
        rows, own = _ClassRows.of(laws), self.settings

        def log_density(row: Indices, at: Array) -> Array:
            owner = np.repeat(row, at.shape[1])
            return rows.values(owner, at.reshape(-1, 1)).reshape(at.shape)

        every = np.arange(rows.count)
        pieces, totals = integrated(log_density, every, self.points, self.enough, own.lines)
        row, xi, log_weight, value = pieces.flat
        kept = _needed(row, value + log_weight - totals[row], rows.count, own.left)
        return rows.side_by_side(row[kept], xi[kept, None], log_weight[kept])


@dataclass(frozen=True)
class PlaneSettings:
    """How fine the panels of two variates are, and where their lines run; chosen by judgement.

    `points`: Gauss-Legendre nodes of half a panel. `enough`: share of the integral that halving a
    panel may change. `coarse_enough`: that share where panels begin. `missed`: change of the
    log-likelihood with more panels from where on coarse ones are not enough. `finer_points` and
    `finer_enough`: nodes and share of the finer rule that shows how exact this one is.
    `rough_enough`: the share for statistics of many replicates. `along`: the share of lines over
    that across them; errors of lines must not look like roughness across them. `spread`: variates
    along each axis whose pairs lie all over the law. `size`: nodes of an experiment for which there
    must be memory while they are sought. `left`: share of an integral that is left out with its
    smallest parts. `lines` and `modes`: the settings of lines and of modes.
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
    modes: ModeSettings = MODES


PLANES = PlaneSettings()


@dataclass(frozen=True)
class PlanePanels(DenseRule):
    """Panels of two variates: adaptive along each line, and the lines adaptive across.

    int int g du dv = int (int g(u, v) dv) du. The lines run where the observations inform most,
    across the ridge, so that a front, a kink or a jump of the outcome is met by panels that are
    halved there, and what is left to integrate along the ridge is smoother than the outcome
    (Fubini). That direction is an eigenvector of the information at the mode, or of its mean over
    the law where the mode is on a plateau; the result does not depend on it, the number of nodes
    does. For individual laws with several modes too. Cost: some hundred lines with some fifty nodes
    each, and ten times as many values of the log-density to find them.

    >>> PlanePanels().centers
    1
    """

    name: ClassVar[str] = "panels of two variates"
    points: int = PLANES.points
    enough: float = PLANES.enough
    settings: PlaneSettings = field(default=PLANES, repr=False)

    @property
    def rough(self) -> PlanePanels:
        """The same, exact to a hundredth."""
        enough = max(self.enough, self.settings.rough_enough)
        return replace(self, points=self.settings.points, enough=enough)

    def size(self, _: int, /) -> int:
        """Nodes that an experiment takes while they are sought, about."""
        return self.settings.size

    @classmethod
    def coarse(cls, settings: PlaneSettings = PLANES) -> PlanePanels:
        """Panels with half the nodes, which mostly suffice."""
        return cls(settings.points, settings.coarse_enough, settings)

    def finer(self, _: int, /) -> tuple[PlanePanels, ...]:
        """The rule that shows how exact this one is; there is none for the finest."""
        own = self.settings
        if self.enough > own.enough:
            return (PlanePanels(own.points, own.enough, own),)
        finer = PlanePanels(own.finer_points, own.finer_enough, own)
        return (finer,) if self.points < finer.points else ()

    def refined(self, gaps: Sequence[float], enough: float, _: int, /) -> PlanePanels | None:
        """Those that are not coarse, where they are needed."""
        own = self.settings
        needed = self.enough > own.enough and abs(sum(gaps)) > max(enough, own.missed)
        return PlanePanels(own.points, own.enough, own) if needed else None

    def place(self, laws: IndividualLaws) -> tuple[Array, Array]:
        """Nodes xi (B, C J, 2) on lines of each class."""
        own, rows = self.settings, _ClassRows.of(laws)
        information = laws.modes.information[:, :, 0]
        plane = _Plane(rows, _turned(laws.curved, information, own), self)
        every = np.arange(rows.count)
        across, totals = integrated(plane.marginal, every, self.points, self.enough, own.lines)
        row, u, log_u, value = across.flat
        lines = _needed(row, value + log_u - totals[row], rows.count, own.left)
        row, u, log_u = row[lines], u[lines], log_u[lines]
        line, v, log_v, value = plane.along(row, u)[0].flat
        share = value + log_v + log_u[line] - totals[row[line]]
        kept = _needed(row[line], share, rows.count, own.left)
        line, v, log_v = line[kept], v[kept], log_v[kept]
        return rows.side_by_side(
            row[line], plane.turned(row[line], u[line], v), log_u[line] + log_v
        )


@dataclass(frozen=True, eq=False)
class _ClassRows:
    """The log-densities of experiments with classes, each class of each a row of its own."""

    valued: Valued
    experiments: int
    classes: int

    @classmethod
    def of(cls, laws: IndividualLaws) -> _ClassRows:
        return cls(laws.valued, *laws.modes.z.shape[:2])

    @property
    def count(self) -> int:
        """R, the number of rows."""
        return self.experiments * self.classes

    def values(self, row: Indices, xi: Array) -> Array:
        """The log-density (T,) at variates xi (T, s) of rows (T,)."""
        place, most = self._places(row)
        together = np.zeros((self.count, most, xi.shape[1]))
        together[row, place] = xi
        joint = together.reshape(self.experiments, self.classes * most, -1)
        return np.asarray(self.valued(joint).reshape(-1, most)[row, place])

    def side_by_side(self, row: Indices, xi: Array, log_weight: Array) -> tuple[Array, Array]:
        """Nodes (T, s) of rows (T,) as (B, C J, s), and their log weights under the normal law.

        Weights (T,) are those of an integral without the law; a node that lacks has none.
        """
        place, most = self._places(row)
        nodes = np.zeros((self.count, most, xi.shape[1]))
        log_weights = np.full((self.count, most), -np.inf)
        log_law = -0.5 * np.sum(xi**2, axis=1) - 0.5 * xi.shape[1] * np.log(2.0 * np.pi)
        nodes[row, place], log_weights[row, place] = xi, log_weight + log_law
        return (
            nodes.reshape(self.experiments, -1, xi.shape[1]),
            log_weights.reshape(self.experiments, -1),
        )

    def _places(self, row: Indices) -> tuple[Indices, int]:
        """The position (T,) of each among those of its row (T,), and the most that a row has."""
        counts = np.bincount(row, minlength=self.count)
        order = np.argsort(row, kind="stable")
        place = np.empty(len(row), dtype=np.intp)
        place[order] = np.arange(len(row)) - (np.cumsum(counts) - counts)[row[order]]
        return place, int(counts.max(initial=1))


@dataclass(frozen=True, eq=False)
class _Plane:
    """The log-densities of rows in turned coordinates.

    `basis` (R, 2, 2): its first column is the direction of u, across the lines, its second of v.
    """

    rows: _ClassRows
    basis: Array
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
            return self.rows.values(owner, xi).reshape(v.shape)

        settings = self.rule.settings
        enough = settings.along * self.rule.enough
        return integrated(log_density, row, self.rule.points, enough, settings.lines)

    def marginal(self, row: Indices, u: Array) -> Array:
        """The logarithm (T, q) of the integral over v at u (T, q)."""
        return self.along(np.repeat(row, u.shape[1]), u.ravel())[1].reshape(u.shape)


def _turned(curved: Curved, information: Array, settings: PlaneSettings) -> Array:
    """Eigenvectors (B C, 2, 2), as columns, of information (B, C, 2, 2); that of most information
    is the last."""
    count, classes = information.shape[:2]
    over = np.array(list(product(settings.spread, repeat=2)))
    points = np.tile(over, (count, classes, 1))
    over_law = curved(points)[2].reshape(count, classes, len(over), 2, 2).mean(axis=2)
    flat = np.linalg.eigvalsh(information)[..., -1] < settings.modes.informed
    chosen = np.where(flat[..., None, None], over_law, information)
    return np.linalg.eigh(chosen)[1].reshape(-1, 2, 2)


def _needed(row: Indices, share: Array, rows: int, left: float) -> Flags:
    """Which parts of an integral are kept, by the logarithms (T,) of their shares; the smallest,
    with `left` of it, are not."""
    order = np.lexsort((share, row))
    part = np.exp(np.minimum(share[order], 0.0))
    sums = np.cumsum(part)
    before = np.concatenate([[0.0], np.cumsum(np.bincount(row, np.exp(share), minlength=rows))])
    needed = np.zeros(len(row), dtype=np.bool_)
    needed[order] = sums - before[row[order]] > left
    return needed
