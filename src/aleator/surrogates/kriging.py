"""One Gaussian process over conditions and parameters: what experiments have in common.

An outcome is y = f(u) + g_l(z) with u = (c_l, z), the conditions of experiment l and the
parameters, each scaled to [-1, 1]. The covariance is

    k(|A'(u - u')|) + own^2 [l = l'] k(|s (z - z')|) + 30 + 10 u . u' + noise^2 [same run]

times one variance, with k Matern's of smoothness 5/2. The square matrix A turns and stretches the
inputs, so that a front that moves with the conditions is one front (Vivarelli and Williams 1999,
"Discovering hidden features with Gaussian process regression"). The second term is what an
experiment has for itself. A, s, own and noise have the greatest likelihood of the runs under a weak
normal prior on A (Rasmussen and Williams 2006, section 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from aleator.threads import single_threaded
from aleator.types import Array, Indices

# Variances of the constant and of the linear terms, over that of the rest: all but free.
CONSTANT, LINEAR = 30.0, 10.0
# Precision of the normal prior on the entries of A.
RIDGE = 0.01
# More directions than this are not told apart.
RANK = 8
OWN = (1e-4, 3.0)
SCALE = (0.05, 10.0)
NOISE = (3e-4, 0.3)
# The part of an experiment that is alone, and has nothing for itself: its square is zero.
NONE = 1e-200


@dataclass(frozen=True)
class Covariance:
    """A covariance: `mix` A (D, r), `own` and its `scale` s (n,), `noise`, all without unit."""

    mix: Array
    own: float
    scale: Array
    noise: float

    @classmethod
    def first(cls, inputs: int, parameters: int, own: float = 0.1) -> Covariance:
        """Nothing is known: every input counts alike."""
        mix = 0.5 * np.eye(inputs, min(inputs, RANK))
        mix[RANK:] = 0.5 / np.sqrt(RANK)
        return cls(mix, own, np.ones(parameters), 0.01)

    @property
    def vector(self) -> Array:
        """All numbers in one row, those that are positive as logarithms."""
        rest = np.log([max(self.own, NONE), *self.scale, self.noise])
        return np.concatenate([self.mix.ravel(), rest])

    def moved(self, vector: Array) -> Covariance:
        """The covariance with the numbers of another row."""
        size = self.mix.size
        own, *scale, noise = np.exp(vector[size:])
        return Covariance(vector[:size].reshape(self.mix.shape), own, np.array(scale), noise)

    def likeness(self, u: Array) -> Array:
        """Squared correlations (N, N) of what is common, between inputs u (N, D)."""
        mixed = u @ self.mix
        return _matern(_squared(mixed, mixed))[0] ** 2


def _matern(squared: Array) -> tuple[Array, Array]:
    """k of squared distances, and its derivative by them."""
    r = np.sqrt(5.0 * np.maximum(squared, 0.0))
    decay = np.exp(-r)
    slope = (-5.0 / 6.0) * (1.0 + r) * decay
    return (1.0 + r + r * r / 3.0) * decay, slope


def _squared(a: Array, b: Array) -> Array:
    """Squared distances (A, B) between the rows of two arrays."""
    return np.asarray((a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * (a @ b.T))


def _loss(covariance: Covariance, index: Indices, u: Array, y: Array) -> tuple[float, Array]:
    """The negative log posterior, without constants, and its gradient by `vector`."""
    mix, own, scale = covariance.mix, covariance.own, covariance.scale
    z = u[:, -len(scale) :]
    mixed, stretched = u @ mix, z * scale
    value, slope = _matern(_squared(mixed, mixed))
    alike = index[:, None] == index
    mine, mine_slope = (alike * part for part in _matern(_squared(stretched, stretched)))
    matrix = value + own**2 * mine + CONSTANT + LINEAR * (u @ u.T)
    matrix[np.diag_indices(len(y))] += covariance.noise**2
    try:
        factor = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return 1e10, np.zeros(covariance.vector.size)
    dual = cho_solve((factor, True), y, check_finite=False)
    variance = float(y @ dual) / len(y)
    loss = 0.5 * len(y) * np.log(variance) + np.log(np.diag(factor)).sum()
    gap = 0.5 * (_inverse(factor) - np.outer(dual, dual) / variance)
    by_mix = 4.0 * _moved(gap * slope, u, u) @ mix
    by_own = 2.0 * own**2 * float((gap * mine).sum())
    by_scale = 4.0 * own**2 * scale**2 * np.diag(_moved(gap * mine_slope, z, z))
    by_noise = 2.0 * covariance.noise**2 * np.trace(gap)
    gradient = np.concatenate([(by_mix + RIDGE * mix).ravel(), [by_own, *by_scale, by_noise]])
    return float(loss + 0.5 * RIDGE * (mix**2).sum()), gradient


def _moved(gap: Array, a: Array, b: Array) -> Array:
    """Sum over pairs of gap_ij (a_i - a_j)(b_i - b_j)' / 2, for a symmetric gap."""
    return np.asarray(a.T @ (gap.sum(axis=1)[:, None] * b) - a.T @ gap @ b)


def _inverse(factor: Array) -> Array:
    """The inverse (M, M) of a matrix from its lower Cholesky factor."""
    lower = np.tril(dpotri(factor, lower=1)[0])
    return np.asarray(lower + np.tril(lower, -1).T)


@single_threaded
def learned(start: Covariance, index: Indices, u: Array, y: Array, iterations: int) -> Covariance:
    """The covariance of greatest posterior for runs y (M,) of experiments `index` at u (M, D)."""
    n, level, unit = len(start.scale), y.mean(), y.std() or 1.0

    def loss(vector: Array) -> tuple[float, Array]:
        return _loss(start.moved(vector), index, u, (y - level) / unit)

    own, noise = (OWN, NOISE) if start.own > NONE else ((NONE, NONE), (NOISE[0], NOISE[0]))
    positive = [np.log(own), *[np.log(SCALE)] * n, np.log(noise)]
    bounds = [(-20.0, 20.0)] * start.mix.size + [(low, high) for low, high in positive]
    found = minimize(
        loss, start.vector, jac=True, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": iterations},
    )  # fmt: skip
    return start.moved(found.x)


@dataclass(frozen=True)
class Posterior:
    """The process given runs y (M,), on a scale of mean `level` and standard deviation `unit`."""

    covariance: Covariance
    index: Indices
    u: Array
    level: float
    unit: float
    factor: Array
    dual: Array
    variance: float
    surprise: Array  # (M,) leave-one-out residual over its expected standard deviation

    @classmethod
    @single_threaded
    def of(cls, covariance: Covariance, index: Indices, u: Array, y: Array) -> Posterior:
        """Condition on runs; M^3 operations."""
        level, unit = float(y.mean()), float(y.std()) or 1.0
        matrix = _between(covariance, index, u, index, u)
        matrix[np.diag_indices(len(y))] += covariance.noise**2
        factor = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
        dual = cho_solve((factor, True), (y - level) / unit)
        precision = np.diag(_inverse(factor))
        variance = float(np.mean(dual**2 / precision))
        surprise = dual / np.sqrt(precision * variance)
        return cls(covariance, index, u, level, unit, factor, dual, variance, surprise)

    @single_threaded
    def mean(self, index: Indices, u: Array) -> Array:
        """Expected outcomes (R,) of experiments `index` at u (R, D)."""
        return self.level + self.unit * (self._between(index, u) @ self.dual)

    @single_threaded
    def deviation(self, index: Indices, u: Array) -> Array:
        """Standard deviation (R,) of the outcomes that are still possible; M^2 R operations."""
        known = solve_triangular(
            self.factor, self._between(index, u).T, lower=True, check_finite=False
        )
        prior = 1.0 + self.covariance.own**2 + CONSTANT + LINEAR * (u**2).sum(axis=1)
        left = np.maximum(prior - (known**2).sum(axis=0), 0.0)
        return np.asarray(self.unit * np.sqrt(self.variance * left))

    @property
    def noise(self) -> float:
        """The variance of a run about the outcome."""
        return self.unit**2 * self.variance * self.covariance.noise**2

    @single_threaded
    def joint(self, index: Indices, u: Array) -> Array:
        """Covariances (R, R) of the outcomes that are still possible, for few points."""
        known = solve_triangular(
            self.factor, self._between(index, u).T, lower=True, check_finite=False
        )
        prior = _between(self.covariance, index, u, index, u)
        return np.asarray(self.unit**2 * self.variance * (prior - known.T @ known))

    def _between(self, index: Indices, u: Array) -> Array:
        return _between(self.covariance, index, u, self.index, self.u)


def _between(covariance: Covariance, index: Indices, u: Array, other: Indices, v: Array) -> Array:
    """Covariances (R, M) of runs of two lists, without noise."""
    n = len(covariance.scale)
    out = _matern(_squared(u @ covariance.mix, v @ covariance.mix))[0]
    out += CONSTANT + LINEAR * (u @ v.T)
    if covariance.own**2 == 0.0:
        return np.asarray(out)
    row, column = np.nonzero(index[:, None] == other)
    gap = (u[row, -n:] - v[column, -n:]) * covariance.scale
    out[row, column] += covariance.own**2 * _matern((gap**2).sum(axis=1))[0]
    return np.asarray(out)
