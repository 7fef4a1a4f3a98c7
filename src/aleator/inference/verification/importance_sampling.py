"""Variates of the samples: of the law itself, or drawn where an outcome far out is explained.

A variate theta is standard normal and independent; x = T(theta | alpha). Those drawn from another
density q carry weights phi(theta)/q(theta): importance sampling, unbiased whatever q is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.stats import qmc

from aleator.inference.verification.choice import REPLICATES
from aleator.types import Array

Guess = Callable[[Array], Array]

LEVELS = 12
"""Most rounds of the search for the variates that explain an outcome."""
PILOT = 512
"""Variates an experiment in each of its rounds."""
SHARE = 0.1
"""Share of a round's variates that shall count, by effective number, in the next one."""
DEFENSE = 4
"""One variate in so many is drawn from the law itself, so that no weight exceeds this number."""
WIDER = 1.3
"""Standard deviations of q over those of the variates that explain the outcome."""


@dataclass(frozen=True)
class Normals:
    """Normal densities of variates, one an experiment: `mean` (m, d), `factor` (m, d, d) lower."""

    mean: Array
    factor: Array

    def place(self, standard: Array) -> Array:
        """Variates (m, R, d) of these densities from standard normal ones."""
        return np.asarray(self.mean[:, None] + standard @ self.factor.transpose(0, 2, 1))

    def log_ratio(self, variate: Array) -> Array:
        """log of q(theta)/phi(theta), (m, R)."""
        away = np.linalg.solve(self.factor, (variate - self.mean[:, None]).transpose(0, 2, 1))
        log_det = np.log(np.abs(np.diagonal(self.factor, axis1=1, axis2=2))).sum(axis=1)
        squares = np.sum(variate**2, axis=2) - np.sum(away**2, axis=1)
        return np.asarray(0.5 * squares - log_det[:, None])


def flat(array: Array) -> Array:
    """An array (..., d) as (R, d), d = 0 included.

    >>> flat(np.zeros((2, 3, 0))).shape
    (6, 0)
    """
    return array.reshape(math.prod(array.shape[:-1]), array.shape[-1])


def uniforms(count: int, d: int, points: int, rng: np.random.Generator) -> Array:
    """Uniform numbers (count, copies, points, d): one Sobol' set, shifted for every copy."""
    base = qmc.Sobol(max(d, 1), rng=rng).random(points)[:, :d]
    shifted = (base + rng.random((count, REPLICATES, 1, d))) % 1.0
    return np.asarray(np.clip(shifted, 1e-12, 1.0 - 1e-12))


def explaining(guess: Guess, y: Array, width: Array, d: int, rng: np.random.Generator) -> Normals:
    """Normal densities where outcomes y (m,) are explained to a width (m,), by cross entropy.

    Round by round variates are drawn, weighted by the law and by a normal kernel about y that is as
    narrow as leaves a tenth of them, and the next density has their mean and covariance, until the
    kernel has the width asked for (Rubinstein and Kroese, 2004). `guess` takes
    variates (m, R, d) and returns outcomes (m, R).
    """
    m = y.size
    found = Normals(np.zeros((m, d)), np.tile(np.eye(d), (m, 1, 1)))
    for _ in range(LEVELS):
        standard = special.ndtri(uniforms(m, d, PILOT // REPLICATES, rng)).reshape(m, -1, d)
        variate = found.place(standard)
        away = np.abs(guess(variate) - y[:, None])
        prior = -found.log_ratio(variate)
        kernel = _narrowest(prior, away, width)
        found = _weighted(variate, prior - 0.5 * (away / kernel[:, None]) ** 2)
        if np.all(kernel <= width):
            break
    return found


def defended(found: Normals, uniform: Array) -> tuple[Array, Array]:
    """Variates (m, C, P, d) of a mixture of q and the law, and their weights (m, C, P).

    Every DEFENSE-th point is of the law, and all are weighted by the density of the mixture
    (Owen and Zhou, 2000): unbiased, and the weights are bounded.
    """
    m, copies, points, d = uniform.shape
    variate = special.ndtri(uniform).reshape(m, -1, d)
    others = moved(copies * points)
    variate[:, others] = found.place(variate[:, others])
    share = 1.0 - 1.0 / DEFENSE
    weight = 1.0 / (1.0 - share + share * np.exp(np.minimum(found.log_ratio(variate), 600.0)))
    return variate.reshape(uniform.shape), weight.reshape(m, copies, points)


def moved(samples: int) -> NDArray[np.bool_]:
    """Which of the samples (S,) `defended` does not draw from the law itself."""
    return np.asarray(np.arange(samples) % DEFENSE > 0)


def _narrowest(prior: Array, away: Array, width: Array) -> Array:
    """The kernel width (m,), at least `width`, that leaves SHARE of the variates, by bisection."""
    low, high = np.log(width), np.log(np.maximum(2.0 * away.max(axis=1), width))
    wanted = SHARE * away.shape[1]
    for _ in range(30):
        middle = 0.5 * (low + high)
        weight = _normalized(prior - 0.5 * (away / np.exp(middle)[:, None]) ** 2)
        enough = 1.0 / np.sum(weight**2, axis=1) >= wanted
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    least = _normalized(prior - 0.5 * (away / width[:, None]) ** 2)
    there = 1.0 / np.sum(least**2, axis=1) >= wanted
    return np.asarray(np.where(there, width, np.exp(high)))


def _weighted(variate: Array, log_weight: Array) -> Normals:
    weight = _normalized(log_weight)
    mean = np.einsum("mr,mrd->md", weight, variate)
    away = variate - mean[:, None]
    covariance = WIDER**2 * np.einsum("mr,mrd,mre->mde", weight, away, away)
    return Normals(mean, np.linalg.cholesky(covariance + 1e-6 * np.eye(variate.shape[2])))


def _normalized(log_weight: Array) -> Array:
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))
