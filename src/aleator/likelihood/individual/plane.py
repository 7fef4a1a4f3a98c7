"""Nodes of two variates: panels along lines, and the lines in panels of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.likelihood.individual.lines import Pieces, integrated
from aleator.likelihood.individual.modes import Curved, Modes, Valued
from aleator.likelihood.individual.rule import AsManyAsNeeded
from aleator.types import Array, Flags, Indices

POINTS, ENOUGH = 4, 3e-4
"""Gauss-Legendre nodes of half a panel, and the share that halving it may change."""
COARSE, MISSED = 3e-3, 0.01
"""That share where panels begin, and the change of the log-likelihood with more of them from where
on these are not enough."""
FINER, FINER_ENOUGH = 6, 3e-5
"""The same of those that tell how exact these are."""
ROUGH_ENOUGH = 1e-2
"""Where statistics of many replicates are wanted."""
ALONG = 0.1
"""... of lines: errors of these must not look like roughness across them."""
SPREAD = np.array([(a, b) for a in (-1.5, -0.5, 0.5, 1.5) for b in (-1.5, -0.5, 0.5, 1.5)])
"""Variates (16, 2) all over the law."""
TOLD = 2.0
"""Information of a variate, of which the law's part is one, that an outcome has told something."""
SIZE = 16_000
"""Nodes of an experiment for which there must be memory while they are sought."""
LEFT = 1e-9
"""Share of an integral that is left out with its smallest parts."""


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

    points: int = POINTS
    enough: float = ENOUGH

    @property
    def name(self) -> str:
        """Name for reports."""
        return "panels of two variates"

    @property
    def rough(self) -> PlanePanels:
        """The same, exact to a hundredth."""
        return PlanePanels(POINTS, max(self.enough, ROUGH_ENOUGH))

    def size(self, dimensions: int) -> int:  # noqa: ARG002  one interface for all rules
        """Nodes that an experiment takes while they are sought, about."""
        return SIZE

    @classmethod
    def coarse(cls) -> PlanePanels:
        """Half the nodes, which mostly do."""
        return cls(enough=COARSE)

    def finer(self, dimensions: int) -> tuple[PlanePanels, ...]:  # noqa: ARG002
        """The rule that tells how exact this one is; none tells it of the finest."""
        if self.enough > ENOUGH:
            return (PlanePanels(),)
        return (PlanePanels(FINER, FINER_ENOUGH),) if self.points < FINER else ()

    def refined(
        self,
        gaps: Sequence[float],
        enough: float,
        dimensions: int,  # noqa: ARG002
    ) -> PlanePanels | None:
        """Those that are not coarse, where they are needed."""
        needed = self.enough > ENOUGH and abs(sum(gaps)) > max(enough, MISSED)
        return PlanePanels() if needed else None

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
        basis = _turned(curved, found.information[:, :, 0]).reshape(-1, 2, 2)
        plane = _Plane(valued, basis, classes, self)
        across, totals = integrated(plane.marginal, np.arange(len(basis)), self.points, self.enough)
        row, u, log_u, value = across.flat
        lines = _needed(row, value + log_u - totals[row], len(basis))
        row, u, log_u, value = row[lines], u[lines], log_u[lines], value[lines]
        line, v, log_v, value_v = plane.along(row, u)[0].flat
        nodes = _needed(row[line], value_v + log_v + log_u[line] - totals[row[line]], len(basis))
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

        return integrated(log_density, row, self.rule.points, ALONG * self.rule.enough)

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


def _turned(curved: Curved, information: Array) -> Array:
    """Eigenvectors (B, C, 2, 2), as columns, of information (B, C, 2, 2): the most told last."""
    count, classes = information.shape[:2]
    points = np.tile(SPREAD, (count, classes, 1))
    over_law = curved(points)[2].reshape(count, classes, len(SPREAD), 2, 2).mean(axis=2)
    flat = np.linalg.eigvalsh(information)[..., -1] < TOLD
    chosen = np.where(flat[..., None, None], over_law, information)
    return np.linalg.eigh(chosen)[1]


def _needed(row: Indices, share: Array, rows: int) -> Flags:
    """Which parts are needed, by the logarithms (T,) of their shares: not the smallest ones."""
    order = np.lexsort((share, row))
    part = np.exp(np.minimum(share[order], 0.0))
    sums = np.cumsum(part)
    before = np.concatenate([[0.0], np.cumsum(np.bincount(row, np.exp(share), minlength=rows))])
    needed = np.zeros(len(row), dtype=np.bool_)
    needed[order] = sums - before[row[order]] > LEFT
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
