"""Importance points: half of the law itself, half about the modes of an individual law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.likelihood.individual.modes import ARRIVED, Curved, Modes, Valued
from aleator.types import Array, Indices

WIDER = 1.3
"""By how much points about an individual law lie farther out than its curvature says."""
MOST = 5_000
"""Points of an experiment beyond which no more are taken."""
ROUGH = 300
"""Points that serve for statistics of many replicates."""
NEAREST = 1e-12
"""Probabilities of points stay so far from zero and one."""


@dataclass(frozen=True)
class ImportancePoints:
    """Quasi-random points of a mixture of normal laws (defensive importance sampling).

        int g phi dxi = 1/J sum_j g(xi_j) phi(xi_j)/q(xi_j),
        q = phi/2 + sum_m N(z_m, c^2 I_m^-1)/(2 M),

    with M modes z_m of g phi and the information I_m there (Hesterberg, 1995). What has several
    modes, or a density that is not smooth, is integrated as well as any other; the error falls
    about as 1/J. Each experiment has points of its own, so that their errors do not add up.

    >>> ImportancePoints(60).size(2)
    60
    """

    count: int = 300
    centers: int = 3

    @property
    def name(self) -> str:
        """Name for reports."""
        return "importance points"

    @property
    def arrived(self) -> float:
        """Points about a mode that is not exact are as good."""
        return ARRIVED

    @property
    def holds_parameters(self) -> bool:
        """Yes: they are where an outcome is not smooth."""
        return True

    @property
    def rough(self) -> ImportancePoints:
        """At most 300 points."""
        return ImportancePoints(min(self.count, ROUGH), self.centers)

    def size(self, dimensions: int) -> int:  # noqa: ARG002  the same for any
        """J, the number of points: as many about each mode."""
        return 2 * self.centers * _each(self.count, self.centers)

    def finer(self, dimensions: int) -> tuple[ImportancePoints, ...]:  # noqa: ARG002
        """One with twice as many points."""
        return (ImportancePoints(2 * self.count, self.centers),)

    def refined(
        self, gaps: Sequence[float], enough: float, dimensions: int
    ) -> ImportancePoints | None:
        """Twice as many points."""
        (more,) = self.finer(dimensions)
        return more if abs(gaps[0]) > enough and more.count <= MOST else None

    def told(self, gaps: Sequence[float], dimensions: int) -> float:  # noqa: ARG002
        """What twice as many points change."""
        return float(sum(gaps))

    def about(
        self,
        curved: Curved,  # noqa: ARG002
        valued: Valued,  # noqa: ARG002
        found: Modes,
        first: int,
    ) -> tuple[Array, Array]:
        """Points xi (B, C J, s) about the M modes of each class, and their log weights."""
        shift = np.arange(first, first + len(found.z))
        return proposed(found.z, found.information, self.count, shift)


def standard_points(count: int, dimensions: int) -> Array:
    """Points (count, s) of the standard normal law: Sobol's, in one dimension midpoints."""
    return _normal(_uniform(count, dimensions))


def proposed(
    modes: Array, information: Array, count: int, shift: Indices | None = None
) -> tuple[Array, Array]:
    """Points xi (B, C J, s) about modes (B, C, M, s), half of them of the standard normal law.

    log weights (B, C J) such that sum_j exp(log_weight_j) g(xi_j) is near int g(xi) phi(xi) dxi
    over the J points of each class (see `ImportancePoints`). `information` (B, C, M, s, s) is the
    curvature at the modes. With `shift` (B,) the points of an experiment are shifted by as many
    steps of a lattice in the unit cube (Cranley and Patterson, 1976).
    """
    experiments, classes, centers, s = modes.shape
    each = _each(count, centers)
    half = each * centers
    t, own = shifted_points(half, s, shift)[:, None], shifted_points(each, s, shift)[:, None]
    root = WIDER * np.linalg.cholesky(np.linalg.inv(information))
    near = modes[:, :, None] + np.einsum("ncmst,ncjt->ncjms", root, own)
    law = np.broadcast_to(t, (experiments, classes, half, s))
    xi = np.concatenate([law, near.reshape(experiments, classes, half, s)], axis=2)
    log_law = -0.5 * np.sum(xi**2, axis=3)
    log_det = np.log(np.einsum("ncmss->ncms", root)).sum(axis=3)
    log_near = np.full(log_law.shape, -np.inf)
    for m in range(centers):
        away = xi - modes[:, :, None, m]
        curved = np.einsum("ncjs,ncst,ncjt->ncj", away, information[:, :, m] / WIDER**2, away)
        log_near = np.logaddexp(log_near, -0.5 * curved - log_det[:, :, m, None])
    log_mixture = np.logaddexp(log_law, log_near - np.log(centers)) - np.log(2.0)
    log_weight = log_law - log_mixture - np.log(2.0 * half)
    whole = classes * 2 * half
    return xi.reshape(experiments, whole, s), log_weight.reshape(experiments, whole)


def _each(count: int, centers: int) -> int:
    """Points about each mode, which are half of so many."""
    return max(1, count // (2 * centers))


def _uniform(count: int, dimensions: int) -> Array:
    """Points (count, s) of the unit cube."""
    if dimensions <= 1:
        return ((np.arange(count) + 0.5) / count)[:, None][:, :dimensions]
    power = int(np.ceil(np.log2(count)))
    points = qmc.Sobol(dimensions, scramble=False).random_base2(power)[:count]
    return np.asarray(points + 0.5 / count)


def shifted_points(count: int, dimensions: int, shift: Indices | None) -> Array:
    """Standard normal points (B, count, s), or the same for all (1, count, s)."""
    if shift is None:
        return standard_points(count, dimensions)[None]
    # the lattice of the powers of 1/g, g the root of g^(s+1) = g + 1 (Roberts, 2018)
    g = 2.0
    for _ in range(40):
        g = (1.0 + g) ** (1.0 / (dimensions + 1.0))
    steps = np.outer(shift, g ** -np.arange(1.0, dimensions + 1.0))
    return _normal((_uniform(count, dimensions) + steps[:, None]) % 1.0)


def _normal(u: Array) -> Array:
    """Standard normal points of those of the unit cube."""
    return np.asarray(special.ndtri(np.clip(u, NEAREST, 1.0 - NEAREST)))
