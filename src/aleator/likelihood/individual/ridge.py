"""Importance points along the ridge that an experiment's observations leave of its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.likelihood.individual.gauss_hermite import TIE
from aleator.likelihood.individual.importance import shifted_points
from aleator.likelihood.individual.modes import ARRIVED, NEAR, Curved, Modes, Valued, modes
from aleator.types import Array

FEWEST, MOST = 64, 4096
"""Points of an experiment that are tried first, and beyond which no more are taken."""
INFORMED = 2.0
"""Information about a variate from which on the observations tell more of it than its law does."""


@dataclass(frozen=True)
class RidgePoints:
    """Quasi-random points of a normal law that follows the ridge of an individual law.

    A few observations inform k directions b of the s variates, and of the others a they tell next
    to nothing. The points are those of a by the curvature at the mode, and of b by the mode and the
    curvature given a:

        int g phi dxi = 1/J sum_j g(xi_j) phi(xi_j) / (N(a_j; a*, A) N(b_j; b*(a_j), C(a_j))).

    Where the log-density is quadratic every term is the integral itself; where the ridge bends
    slowly the terms differ little, however many variates there are and however small the noise.
    The error falls about as 1/J. What has several modes it takes for one.

    >>> RidgePoints(60).size(7)
    60
    """

    count: int = FEWEST

    @property
    def name(self) -> str:
        """Name for reports."""
        return "importance points along a ridge"

    @property
    def centers(self) -> int:
        """The modes of an experiment that the points lie about."""
        return 1

    @property
    def arrived(self) -> float:
        """They move with the mode."""
        return ARRIVED

    @property
    def holds_parameters(self) -> bool:
        """No: they lie where an outcome is smooth."""
        return False

    @property
    def rough(self) -> RidgePoints:
        """The fewest."""
        return RidgePoints(min(self.count, FEWEST))

    def size(self, dimensions: int) -> int:  # noqa: ARG002  the same for any
        """J, the number of points."""
        return self.count

    def finer(self, dimensions: int) -> tuple[RidgePoints, ...]:  # noqa: ARG002
        """One with twice as many points."""
        return (RidgePoints(2 * self.count),)

    def refined(self, gaps: Sequence[float], enough: float, dimensions: int) -> RidgePoints | None:
        """Twice as many points."""
        (more,) = self.finer(dimensions)
        return more if abs(gaps[0]) > enough and more.count <= MOST else None

    def told(self, gaps: Sequence[float], dimensions: int) -> float:  # noqa: ARG002
        """What twice as many points change."""
        return float(sum(gaps))

    def about(
        self,
        curved: Curved,
        valued: Valued,  # noqa: ARG002
        found: Modes,
        first: int,
    ) -> tuple[Array, Array]:
        """Points xi (B, C J, s) about the highest mode of each class, and their log weights.

        Directions are the eigenvectors of the information at the mode. Points come in pairs that
        lie on either side of the ridge, so that a score across it is no matter of chance.
        """
        mode, information = found.z[:, :, 0], found.information[:, :, 0]
        experiments, classes, s = mode.shape
        half = self.count // 2
        values, basis = np.linalg.eigh(information + TIE * np.diag(np.arange(s)))
        along = s - max(1, int((values > INFORMED).sum(axis=2).max(initial=1)))
        t = shifted_points(half, s, np.arange(first, first + experiments))[:, None]
        a = t[..., :along] / np.sqrt(values[:, :, None, :along])
        start = mode[:, :, None] + np.einsum("ncst,ncjt->ncjs", basis[..., :along], a)
        across = np.repeat(basis[..., along:], half, axis=1)
        ridge = modes(curved, start.reshape(experiments, -1, s), across, NEAR, classes)
        within = np.swapaxes(across, -1, -2) @ ridge.information @ across
        root = np.linalg.cholesky(np.linalg.inv(within))
        b = np.broadcast_to(t[..., along:], (experiments, classes, half, s - along))
        b = b.reshape(experiments, -1, s - along)
        step = (across @ root @ b[..., None])[..., 0]
        log_det = np.log(np.einsum("njss->njs", root)).sum(axis=2)
        log_det -= np.repeat(0.5 * np.log(values[..., :along]).sum(axis=2), half, axis=1)
        square = np.broadcast_to(np.sum(t**2, axis=3), (experiments, classes, half))
        of_rule = log_det + 0.5 * square.reshape(log_det.shape) - np.log(2.0 * half)
        shape = (experiments, classes, half, s)
        sides = [(ridge.z + side * step).reshape(shape) for side in (1.0, -1.0)]
        xi = np.concatenate(sides, axis=2).reshape(experiments, -1, s)
        log_rule = np.tile(of_rule.reshape(shape[:3]), (1, 1, 2)).reshape(experiments, -1)
        return xi, log_rule - 0.5 * np.sum(xi**2, axis=2)
