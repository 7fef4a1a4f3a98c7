"""Uniform cubic B-splines on [0, 1]: tables, and expectations of an outcome with normal noise.

K intervals carry K + 3 splines that sum to one. An outcome outside [0, 1] counts at the end.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import BSpline
from scipy.special import ndtr

from aleator.types import Array

_PIECE = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
"""Powers of the place within an interval (rows) of the four splines there (columns)."""

_SMALLEST_NOISE = 1e-12
"""Of the support: a noise under this is none."""

_FAR = 12.0

_ALL_NODES = 160


@dataclass(frozen=True)
class SplineRule:
    """Gauss-Legendre nodes t (Q,) within the intervals, their weights, the splines (Q, K+3) there,
    and the products of each spline with itself and the next three (Q, 4 (K+3))."""

    nodes: Array
    weights: Array
    basis: Array
    products: Array


def splines(t: Array, intervals: int, derivative: int = 0) -> Array:
    """Values (..., K+3) at t (...) in [0, 1].

    >>> splines(np.array([0.0]), 3).round(6).tolist()
    [[0.166667, 0.666667, 0.166667, 0.0, 0.0, 0.0]]
    """
    knots = np.arange(-3, intervals + 4) / intervals
    return np.asarray(BSpline(knots, np.eye(intervals + 3), 3)(t, derivative))


@lru_cache(maxsize=16)
def spline_rule(intervals: int, extra: int = 0) -> SplineRule:
    """At least eight nodes an interval, and 160 in all; `extra` more for a check."""
    per_interval = max(8, _ALL_NODES // intervals) + extra
    x, w = np.polynomial.legendre.leggauss(per_interval)
    t = ((np.arange(intervals)[:, None] + 0.5 * (x + 1.0)) / intervals).ravel()
    basis = splines(t, intervals)
    products = np.zeros((t.size, 4, basis.shape[1]))
    for k in range(4):
        products[:, k, : basis.shape[1] - k] = basis[:, : basis.shape[1] - k] * basis[:, k:]
    return SplineRule(
        t, np.tile(0.5 * w / intervals, intervals), basis, products.reshape(t.size, -1)
    )


def uniform(intervals: int) -> Array:
    """Expectations (K+3,) of the splines under the uniform law on [0, 1]."""
    rule = spline_rule(intervals)
    return np.asarray(rule.weights @ rule.basis)


def from_band(band: Array) -> Array:
    """Symmetric matrices (N, L, L) from expectations (N, 4 L) of the products of a rule."""
    size = band.shape[1] // 4
    parts = band.reshape(-1, 4, size)
    matrix = np.zeros((band.shape[0], size, size))
    rows = np.arange(size)
    for k in range(4):
        matrix[:, rows[: size - k], rows[k:]] = parts[:, k, : size - k]
        matrix[:, rows[k:], rows[: size - k]] = parts[:, k, : size - k]
    return matrix


@lru_cache(maxsize=16)
def roughness(intervals: int) -> Array:
    """Sum of squared third differences of the coefficients, as a matrix (K+3, K+3).

    It is zero for polynomials of degree two, so for the logarithm of a normal density.
    """
    differences = np.diff(np.eye(intervals + 3), 3, axis=0)
    penalty: Array = differences.T @ differences
    return penalty


def of_quadratic(center: Array, curvature: Array, intervals: int) -> Array:
    """Coefficients (N, K+3) of curvature (t - center)^2, both (N,), exactly."""
    step = 1.0 / intervals
    place = (np.arange(intervals + 3) - 1.0) * step
    coefficients = (place - center[:, None]) ** 2 - step**2 / 3.0
    return np.asarray(curvature[:, None] * coefficients)


def evaluate(coefficients: Array, t: Array, derivative: int = 0) -> Array:
    """Splines (N, G) with coefficients (N, K+3) at t (N, G) in [0, 1], or their derivative 0, 1."""
    intervals = coefficients.shape[1] - 3
    piece = np.clip((t * intervals).astype(np.int64), 0, intervals - 1)
    x = t * intervals - piece
    near = [np.take_along_axis(coefficients, piece + k, axis=1) for k in range(4)]
    powers = [sum(_PIECE[m, k] * near[k] for k in range(4)) for m in range(4)]
    if derivative == 0:
        return np.asarray(powers[0] + x * (powers[1] + x * (powers[2] + x * powers[3])))
    return np.asarray(intervals * (powers[1] + x * (2.0 * powers[2] + 3.0 * x * powers[3])))


@lru_cache(maxsize=16)
def _in_powers(intervals: int) -> Array:
    """Each spline (columns, K+3) as a sum of K+6 features of the clipped outcome x (rows).

    1; x_+, x_+^2, x_+^3; (x - i/K)_+^3, i = 1..K-1; (x - 1)_+, (x - 1)_+^2, (x - 1)_+^3, by which
    the value stays that at 1.
    """
    ends = [splines(np.array([0.0, 1.0]), intervals, m) for m in range(3)]
    middles = (np.arange(intervals) + 0.5) / intervals
    third = splines(middles, intervals, 3)
    return np.concatenate(
        [
            [ends[0][0], ends[1][0], ends[2][0] / 2.0, third[0] / 6.0],
            np.diff(third, axis=0) / 6.0,
            [-ends[1][1], -ends[2][1] / 2.0, -third[-1] / 6.0],
        ]
    )


@dataclass(frozen=True)
class NoisyPowers:
    """E (m + s e)_+^q, q = 0..3, with e ~ Normal(0, 1), m = t - i/K (N, J, K+1), s (N, 1, 1).

    In closed form: with z = m/s, E (m + s e)_+ = m Phi(z) + s phi(z), and
    E (m + s e)_+^q = m E (.)_+^(q-1) + (q - 1) s^2 E (.)_+^(q-2).
    """

    powers: tuple[Array, Array, Array, Array]
    density: Array
    noise: Array

    @classmethod
    def at(cls, t: Array, s: Array, intervals: int) -> NoisyPowers:
        """Of outcomes t (N, J) with noise s (N,)."""
        m = t[:, :, None] - np.arange(intervals + 1) / intervals
        s = np.maximum(s, _SMALLEST_NOISE)[:, None, None]
        # farther out nothing changes but the time that tiny numbers take
        z = np.clip(m / s, -_FAR, _FAR)
        below = ndtr(z)
        density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
        first = m * below + s * density
        second = m * first + s**2 * below
        return cls((below, first, second, m * second + 2.0 * s**2 * first), density, s)

    def values(self) -> Array:
        """Features (N, J, K+6) as `_in_powers`."""
        _, first, second, third = self.powers
        return self._features(np.ones_like(first[:, :, :1]), first, second, third)

    def by_place(self) -> Array:
        """Derivatives (N, J, K+6) of the features by t."""
        zeroth, first, second, _ = self.powers
        return self._features(np.zeros_like(first[:, :, :1]), zeroth, 2.0 * first, 3.0 * second)

    def by_noise(self) -> Array:
        """Derivatives (N, J, K+6) of the features by s."""
        zeroth, first, _, _ = self.powers
        s = self.noise
        return self._features(
            np.zeros_like(first[:, :, :1]), self.density, 2.0 * s * zeroth, 6.0 * s * first
        )

    @staticmethod
    def _features(one: Array, first: Array, second: Array, third: Array) -> Array:
        start = [part[:, :, :1] for part in (first, second)]
        end = [part[:, :, -1:] for part in (first, second)]
        return np.concatenate([one, *start, third[:, :, :-1], *end, third[:, :, -1:]], axis=2)


def expected_splines(powers: NoisyPowers, weights: Array) -> Array:
    """sum_j w_j E B_k(t_j + s e) (N, K+3)."""
    sums = np.einsum("j,njf->nf", weights, powers.values())
    return np.asarray(sums @ _in_powers(sums.shape[1] - 6))


def noisy(coefficients: Array, powers: NoisyPowers) -> tuple[Array, Array, Array]:
    """E g(t_j + s e) (N, J), g the splines with coefficients (N, K+3); its slopes by t_j and s."""
    features = coefficients @ _in_powers(coefficients.shape[1] - 3).T
    value, by_place, by_noise = (
        np.asarray(np.einsum("njf,nf->nj", part, features))
        for part in (powers.values(), powers.by_place(), powers.by_noise())
    )
    return value, by_place, by_noise
