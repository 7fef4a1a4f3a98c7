"""The posterior density of alpha on the real line, where a sampler may go anywhere.

p(alpha | y) ~ L(alpha) p(alpha) between the limits. A hyperparameter v between its limits a and b
is v = a + (b - a) / (1 + exp(-u)), and the density of u has the factor dv/du (the Jacobian).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from aleator.inference.information import DIFFERENCES
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search.value import LogLikelihood
from aleator.types import Array, Indices

FARTHEST = 1e-3
"""Share of the limits' width that a search for the mode begins away from them."""
LEAST = 0.05
"""Least curvature: that of a density as flat as between limits that nothing else tells of."""
TRIED, SHRUNK, SMALLER = 16, 12, 0.6
"""Points that tell whether a scale is too wide, and how often it is made how much smaller."""
MODE = 50
"""Steps to the mode, at most."""


@dataclass(frozen=True)
class Asked:
    """log p(u | y) at one u (G,), its slope (G,), and the log-likelihood that it is made of."""

    value: float
    slope: Array
    likelihood: LogLikelihood


@dataclass(frozen=True, eq=False)
class RealLine:
    """The posterior of the hyperparameters `moving` (G,) as a density of u on the real line.

    `objective` is the honest log-likelihood with the log prior, minus infinity where the data are
    impossible; the others are as in `alpha` (K,). Constant factors are left out.
    """

    objective: Callable[[Array], LogLikelihood]
    hyperparameters: Sequence[Hyperparameter]
    alpha: Array
    moving: Indices

    def __call__(self, u: Array) -> Asked:
        """Value and slope at u (G,); a slope of zero where the value is no number."""
        with np.errstate(all="ignore"):
            found = self.objective(self.alpha_of(u))
            slope = found.score[self.moving] * self._rate(u) + (1.0 - 2.0 * special.expit(u))
            value = found.total + float(np.sum(special.log_expit(u) + special.log_expit(-u)))
        if np.isfinite(value) and np.all(np.isfinite(slope)):
            return Asked(value, slope, found)
        return Asked(-np.inf, np.zeros(u.size), found)

    def alpha_of(self, u: Array) -> Array:
        """The alpha (K,) of u (G,)."""
        alpha = self.alpha.copy()
        low, high = self._limits
        alpha[self.moving] = low + (high - low) * special.expit(u)
        return alpha

    def u_of(self, alpha: Array) -> Array:
        """The u (G,) of alpha (K,); one on a limit is moved a thousandth of the width inside."""
        low, high = self._limits
        share = (alpha[self.moving] - low) / (high - low)
        return np.asarray(special.logit(np.clip(share, FARTHEST, 1.0 - FARTHEST)))

    def _rate(self, u: Array) -> Array:
        low, high = self._limits
        return np.asarray((high - low) * special.expit(u) * special.expit(-u))

    @property
    def _limits(self) -> tuple[Array, Array]:
        return limits_of(self.hyperparameters, self.moving)


@dataclass(frozen=True)
class Scale:
    """Where the posterior of u is, and how wide: u = center + factor z with z about N(0, I)."""

    center: Array
    factor: Array


def scaled(density: Callable[[Array], Asked], start: Array) -> Scale:
    """The mode of the density of u next to `start` (G,), and a factor of its covariance there.

    The curvature is that by differences of the slope: some 2 G evaluations after some tens to the
    mode, and 16 that see whether the density reaches as far.
    """

    def loss(u: Array) -> tuple[float, Array]:
        found = density(u)
        return (-found.value, -found.slope) if np.isfinite(found.value) else (1e300, found.slope)

    climbed = optimize.minimize(loss, start, jac=True, method="BFGS", options={"maxiter": MODE})
    mode, anywhere = climbed.x, np.full(start.size, np.inf)
    curvature = DIFFERENCES.bends(
        lambda u: density(u).slope[None], mode, -anywhere, anywhere, 1.0 / np.diag(climbed.hess_inv)
    )[:, 0]
    values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    return _within(density, Scale(mode, vectors / np.sqrt(np.maximum(values, LEAST))))


def _within(density: Callable[[Array], Asked], scale: Scale) -> Scale:
    """A scale at half of whose points there is a density: a likelihood may end abruptly."""
    z = np.random.default_rng(0).standard_normal((TRIED, scale.center.size))
    for _ in range(SHRUNK):
        inside = [np.isfinite(density(scale.center + scale.factor @ one).value) for one in z]
        if np.mean(inside) >= 0.5:
            break
        scale = Scale(scale.center, SMALLER * scale.factor)
    return scale
