"""Adaptive piecewise Gauss-Legendre rules for individual laws of one variate and of two.

A panel is an interval with a Gauss-Legendre rule on each half. Panels are halved where the density
has a kink, a front or a jump (Gander and Gautschi, 2000; module `lines`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import ClassVar

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.likelihood.individual.lines import (
    LINES,
    LineSettings,
    LogDensity,
    Pieces,
    integrated,
    joined,
)
from aleator.likelihood.individual.modes import (
    MODES,
    Curved,
    DenseRule,
    IndividualLaws,
    ModeSettings,
    PlacedNodes,
    Valued,
    inner,
)


@dataclass(frozen=True)
class PanelSettings:
    """Settings of the piecewise Gauss-Legendre rule for one variate; chosen by judgement.

    A panel is an interval with a Gauss-Legendre rule on each half. `finer_points`: the number of
    nodes per half panel of the finer rule that estimates the error. `rough_points` and
    `rough_enough`: the nodes per half panel and the relative tolerance for statistics of many
    replicates. `size`: the number of nodes of an experiment for which memory is reserved while
    panels are halved. `left`: the nodes of least weight are left out as long as they sum to less
    than this share of the integral. `lines`: the settings of lines.
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
    """Adaptive piecewise Gauss-Legendre rule for one variate.

    The intervals ("panels") have `points` nodes in each half. They are halved until halving changes
    the integral by less than the share `enough` (both values by judgement). The rule is for
    individual laws with several modes, a plateau, a front, a kink or a jump. Cost: some hundred
    nodes per experiment.
    """

    name: ClassVar[str] = "panels"
    points: int = 8
    enough: float = 1e-6
    settings: PanelSettings = field(default=PANELS, repr=False)

    @property
    def rough(self) -> Panels:
        """The rule with a third of the nodes and a relative error of a thousandth."""
        own = self.settings
        return Panels(own.rough_points, own.rough_enough, own)

    def size(self, _: int, /) -> int:
        """The approximate number of nodes of an experiment."""
        return self.settings.size

    def finer(self, _: int, /) -> tuple[Panels, ...]:
        """The rule with more nodes that estimates the error of this one; empty for that rule."""
        finer = Panels(self.settings.finer_points, settings=self.settings)
        return (finer,) if self.points < finer.points else ()

    def place(self, laws: IndividualLaws) -> PlacedNodes:
        """Nodes xi (B, C J, 1) of the accurate panels of each class, and their log weights."""
        rows, own = _ClassRows.of(laws), self.settings

        def log_density(row: Indices, at: Array) -> Array:
            owner = np.repeat(row, at.shape[1])
            return rows.values(owner, at.reshape(-1, 1)).reshape(at.shape)

        every = np.arange(rows.count)
        pieces, totals = integrated(log_density, every, self.points, self.enough, own.lines)
        row, xi, log_weight, value = pieces.flat
        kept = _needed(row, value + log_weight - totals[row], rows.count, own.left)
        return PlacedNodes(*rows.side_by_side(row[kept], xi[kept, None], log_weight[kept]))


@dataclass(frozen=True)
class PlaneSettings:
    """Settings of the piecewise Gauss-Legendre rule for two variates; chosen by judgement.

    A panel is an interval with a Gauss-Legendre rule on each half; a line is a straight line in the
    plane of the variates. `points`: the nodes per half panel. `enough`: the change of the integral,
    relative to it, that halving a panel may cause. `coarse_enough`: this tolerance for the coarse
    rule that is tried first. `missed`: the coarse rule is replaced if finer panels change the
    log-likelihood by more than this. `finer_points` and `finer_enough`: the nodes per half panel
    and the tolerance of the finer rule that estimates the error. `rough_enough`: the tolerance for
    statistics of many replicates. `along`: the tolerance along lines relative to that across them,
    so that errors along lines do not look like roughness across them. `spread`: values of each
    variate whose pairs cover the law. `size`: the number of nodes of an experiment for which memory
    is reserved. `left`: the nodes of least weight are left out as long as they sum to less than
    this share of the integral. `lines` and `modes`: the settings of lines and of modes.
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
    """Adaptive piecewise Gauss-Legendre rule for two variates, along lines and across the lines.

    int int g du dv = int (int g(u, v) dv) du (Fubini): the inner integral is taken along lines, the
    outer one across them. The lines run in the direction about which the observations say most,
    across the ridge of the density. The intervals ("panels") on a line are halved where the outcome
    has a front, a kink or a jump; the function that remains to be integrated across the lines is
    smoother. The direction is an eigenvector of the information at the mode, or of the mean
    information over the law if the mode lies on a plateau. It affects the number of nodes but not
    the result. The rule is also for individual laws with several modes. Cost: some hundred lines
    with some fifty nodes each, and ten times as many values of the log-density to find them.

    >>> PlanePanels().centers
    1
    """

    name: ClassVar[str] = "panels of two variates"
    points: int = PLANES.points
    enough: float = PLANES.enough
    settings: PlaneSettings = field(default=PLANES, repr=False)

    @property
    def rough(self) -> PlanePanels:
        """The rule for statistics of many replicates, with a relative error of a hundredth."""
        enough = max(self.enough, self.settings.rough_enough)
        return replace(self, points=self.settings.points, enough=enough)

    def size(self, _: int, /) -> int:
        """The number of nodes of an experiment for which memory is needed, approximately."""
        return self.settings.size

    @classmethod
    def coarse(cls, settings: PlaneSettings = PLANES) -> PlanePanels:
        """The coarse rule with half the nodes, which is accurate enough in most cases."""
        return cls(settings.points, settings.coarse_enough, settings)

    def finer(self, _: int, /) -> tuple[PlanePanels, ...]:
        """The finer rule that estimates the error of this one; empty for the finest rule."""
        own = self.settings
        if self.enough > own.enough:
            return (PlanePanels(own.points, own.enough, own),)
        finer = PlanePanels(own.finer_points, own.finer_enough, own)
        return (finer,) if self.points < finer.points else ()

    def refined(self, gaps: Sequence[float], enough: float, _: int, /) -> PlanePanels | None:
        """The standard rule if this is the coarse one and it is not accurate enough, else None."""
        own = self.settings
        needed = self.enough > own.enough and abs(sum(gaps)) > max(enough, own.missed)
        return PlanePanels(own.points, own.enough, own) if needed else None

    def place(self, laws: IndividualLaws) -> PlacedNodes:
        """Nodes xi (B, C J, 2) on the lines of each class, and their log weights (B, C J)."""
        own, rows = self.settings, _ClassRows.of(laws)
        information = laws.modes.information[:, :, 0]
        plane = _Plane(rows, _turned(laws.curved, information, own), self)
        every = np.arange(rows.count)
        across, totals = integrated(plane.marginal, every, self.points, self.enough, own.lines)
        row, u, log_u, value = across.flat
        lines = _needed(row, value + log_u - totals[row], rows.count, own.left)
        row, u, log_u = row[lines], u[lines], log_u[lines]
        line, v, log_v, value = plane.on_lines(row, u).flat
        share = value + log_v + log_u[line] - totals[row[line]]
        kept = _needed(row[line], share, rows.count, own.left)
        line, v, log_v = line[kept], v[kept], log_v[kept]
        xi = plane.turned(row[line], u[line], v)
        return PlacedNodes(*rows.side_by_side(row[line], xi, log_u[line] + log_v))


def panels_of(variates: int) -> DenseRule | None:
    """A piecewise Gauss-Legendre rule for the scores of virtual outcomes of so many variates.

    For two variates it is the rule for replicates, whose scores differ by less than 1 % from those
    of the standard rule (a contact gap that opens). None for more than two.
    """
    if variates == 1:
        return Panels()
    return PlanePanels().rough if variates == 2 else None


@dataclass(frozen=True, eq=False)
class _ClassRows:
    """The log-densities of all classes of all experiments.

    A row is one class of one experiment.
    """

    valued: Valued
    experiments: int
    classes: int

    @classmethod
    def of(cls, laws: IndividualLaws) -> _ClassRows:
        return cls(laws.valued, *laws.modes.z.shape[:2])

    @property
    def count(self) -> int:
        """The number R of rows, experiments times classes."""
        return self.experiments * self.classes

    def values(self, row: Indices, xi: Array) -> Array:
        """The log-density (T,) at variates xi (T, s) of rows (T,), each an experiment and class."""
        place, most = self._places(row)
        together = np.zeros((self.count, most, xi.shape[1]))
        together[row, place] = xi
        joint = together.reshape(self.experiments, self.classes * most, -1)
        return np.asarray(self.valued(joint).reshape(-1, most)[row, place])

    def side_by_side(self, row: Indices, xi: Array, log_weight: Array) -> tuple[Array, Array]:
        """Nodes (T, s) of rows (T,) arranged as (B, C J, s), with log weights (B, C J).

        The given log weights (T,) are for an integral over xi; the standard normal density is added
        here. Rows with fewer nodes are filled up with nodes of weight zero.
        """
        place, most = self._places(row)
        nodes = np.zeros((self.count, most, xi.shape[1]))
        log_weights = np.full((self.count, most), -np.inf)
        log_law = -0.5 * inner(xi, xi) - 0.5 * xi.shape[1] * np.log(2.0 * np.pi)
        nodes[row, place], log_weights[row, place] = xi, log_weight + log_law
        return (
            nodes.reshape(self.experiments, -1, xi.shape[1]),
            log_weights.reshape(self.experiments, -1),
        )

    def _places(self, row: Indices) -> tuple[Indices, int]:
        """The position (T,) of each node within its row (T,), and the largest row's size."""
        counts = np.bincount(row, minlength=self.count)
        order = np.argsort(row, kind="stable")
        place = np.empty(len(row), dtype=np.intp)
        place[order] = np.arange(len(row)) - (np.cumsum(counts) - counts)[row[order]]
        return place, int(counts.max(initial=1))


@dataclass(frozen=True, eq=False)
class _Plane:
    """The log-densities of rows (one class of one experiment) in rotated coordinates u, v.

    The first column of `basis` (R, 2, 2) is the direction of u, across the lines. The second column
    is the direction of v, along the lines. `kept` collects the lines that were integrated: their
    rows (L,), their u (L,) and the panels on them.
    """

    rows: _ClassRows
    basis: Array
    rule: PlanePanels
    kept: list[tuple[Indices, Array, Pieces]] = field(default_factory=list)

    def turned(self, row: Indices, u: Array, v: Array) -> Array:
        """The variates (..., 2) at rotated coordinates u (...) and v (...) of rows (...)."""
        basis = self.basis[row]
        return np.asarray(u[..., None] * basis[..., 0] + v[..., None] * basis[..., 1])

    def marginal(self, row: Indices, u: Array) -> Array:
        """The logarithm (T, q) of the integral over v at each u (T, q) of rows `row` (T,)."""
        group, at, settings = np.repeat(row, u.shape[1]), u.ravel(), self.rule.settings
        enough = settings.along * self.rule.enough
        pieces, totals = integrated(
            self._along_lines(group, at), group, self.rule.points, enough, settings.lines
        )
        self.kept.append((group, at, pieces))
        return totals.reshape(u.shape)

    def on_lines(self, row: Indices, u: Array) -> Pieces:
        """The panels on the lines at u (L,) of rows `row` (L,), all of which were integrated."""
        rows, places, every = zip(*self.kept, strict=True)
        firsts = np.cumsum([0, *map(len, rows[:-1])])
        pieces = joined(
            [replace(own, line=own.line + first) for own, first in zip(every, firsts, strict=True)]
        )
        keys = zip(np.concatenate(rows).tolist(), np.concatenate(places).tolist(), strict=True)
        known = {key: k for k, key in enumerate(keys)}
        wanted = [known[key] for key in zip(row.tolist(), u.tolist(), strict=True)]
        number = np.full(sum(map(len, rows)), -1)
        number[wanted] = np.arange(len(wanted))
        found = pieces.only(number[pieces.line] >= 0)
        return replace(found, line=number[found.line])

    def _along_lines(self, row: Indices, u: Array) -> LogDensity:
        """The log-density on the lines at u (L,) of rows `row` (L,)."""

        def log_density(line: Indices, v: Array) -> Array:
            owner = np.repeat(row[line], v.shape[1])
            xi = self.turned(owner, np.repeat(u[line], v.shape[1]), v.ravel())
            return self.rows.values(owner, xi).reshape(v.shape)

        return log_density


def _turned(curved: Curved, information: Array, settings: PlaneSettings) -> Array:
    """Eigenvectors (B C, 2, 2) of the information (B, C, 2, 2), with most information last.

    The eigenvectors are columns. Where the mode says no more than the law, the mean information
    over the law is used.
    """
    count, classes = information.shape[:2]
    over = np.array(list(product(settings.spread, repeat=2)))
    points = np.tile(over, (count, classes, 1))
    over_law = curved(points)[2].reshape(count, classes, len(over), 2, 2).mean(axis=2)
    flat = np.linalg.eigvalsh(information)[..., -1] < settings.modes.informed
    chosen = np.where(flat[..., None, None], over_law, information)
    return np.linalg.eigh(chosen)[1].reshape(-1, 2, 2)


def _needed(row: Indices, share: Array, rows: int, left: float) -> Flags:
    """Flags (T,) of the parts of each row's integral that are kept.

    `share` (T,) are the logarithms of the parts relative to the integral. The smallest parts, which
    sum to at most `left`, are not kept.
    """
    order = np.lexsort((share, row))
    part = np.exp(np.minimum(share[order], 0.0))
    sums = np.cumsum(part)
    before = np.concatenate([[0.0], np.cumsum(np.bincount(row, np.exp(share), minlength=rows))])
    needed = np.zeros(len(row), dtype=np.bool_)
    needed[order] = sums - before[row[order]] > left
    return needed
