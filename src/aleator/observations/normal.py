"""Normal measurement error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from aleator.observations.model import Observed, outward
from aleator.types import Array

HALF_LOG_2_PI = 0.5 * float(np.log(2.0 * np.pi))
ROOT_2 = float(np.sqrt(2.0))
NARROW = 1e-3
"""Width of an interval, in scales and relative to its distance, up to which a series is exact."""


@dataclass(frozen=True)
class NormalError:
    """y = eta + e with e ~ Normal(0, scale^2).

    >>> y, eta, scale = np.array(1.0), np.array(0.0), np.array(2.0)
    >>> [float(v) for v in NormalError().log_density(y, eta, scale)]
    [-1.737, 0.25, -0.375]
    """

    @property
    def name(self) -> str:
        """Name for reports."""
        return "normal"

    @property
    def reach(self) -> float:
        """Eight standard deviations: the mass beyond is below 1e-15."""
        return 8.0

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        """-u^2/2 - log scale - log(2 pi)/2 with u = (y - eta)/scale."""
        # In place, because what this costs is memory: it is called for millions of values.
        u = (y - eta) / scale
        square = u * u
        value = -0.5 * square
        value -= np.log(scale) + HALF_LOG_2_PI
        square -= 1.0
        square /= scale
        u /= scale
        return Observed(value, u, square)

    def log_probability(self, lower: Array, upper: Array, eta: Array, scale: Array) -> Observed:
        """log(Phi(b) - Phi(a)) with a and b the ends in scales from eta; all digits in both tails.

        >>> seen = NormalError().log_probability(*map(np.array, ([40.0], [np.inf], [0.0], [1.0])))
        >>> [v.round(6).tolist() for v in seen]
        [[-804.608], [40.025], [1600.998]]
        """
        with np.errstate(all="ignore"):
            a, b = np.broadcast_arrays((lower - eta) / scale, (upper - eta) / scale)
            a, b, turned = outward(a, b)
            sign = np.where(turned, -1.0, 1.0)
            value, by_eta, by_scale = (np.empty(a.shape) for _ in range(3))
            width, middle = b - a, 0.5 * (a + b)
            narrow = width * np.maximum(1.0, middle) < NARROW
            for which, between in (
                (narrow, _narrow),
                (~narrow & (a >= 0.0), _beyond),
                (~narrow & ~(a >= 0.0), _around),
            ):
                if np.any(which):
                    found = between(a[which], b[which])
                    value[which], by_eta[which], by_scale[which] = found
            return Observed(value, sign * by_eta / scale, by_scale / scale)

    def curvature(self, y: Array, eta: Array, scale: Array) -> Array:
        """1/scale^2."""
        return np.broadcast_to(scale**-2.0, np.broadcast_shapes(y.shape, eta.shape, scale.shape))

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        """Phi((y - eta)/scale)."""
        return np.asarray(special.ndtr((y - eta) / scale))

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        """Eta + scale Phi^-1(probability)."""
        return np.asarray(eta + scale * special.ndtri(probability))

    def moments(self, order: int) -> Array:
        """(m - 1)!! for even m, zero for odd."""
        m = np.arange(order + 1)
        return np.where(m % 2 == 0, special.factorial2(np.maximum(m - 1, 0)), 0.0)


_Found = tuple[Array, Array, Array]
"""log P(a < u < b), (phi(a) - phi(b))/P and (a phi(a) - b phi(b))/P of a standard normal u."""


def _narrow(a: Array, b: Array) -> _Found:
    """The integral of phi about the middle m, to the third power of the width d."""
    m, d = 0.5 * (a + b), b - a
    value = -0.5 * m**2 - HALF_LOG_2_PI + np.log(d) + np.log1p(d**2 * (m**2 - 1.0) / 24.0)
    return value, m - d**2 * m / 12.0, m**2 - 1.0 - d**2 * (2.0 * m**2 - 1.0) / 12.0


def _beyond(a: Array, b: Array) -> _Found:
    """0 <= a: P = Q(a)(1 - Q(b)/Q(a)) with the upper tails Q, whose ratios keep their digits."""
    tail, drop = special.erfcx(a / ROOT_2), 0.5 * (b - a) * (b + a)
    left = -np.expm1(np.log(special.erfcx(b / ROOT_2) / tail) - drop)
    at_a = np.sqrt(2.0 / np.pi) / (tail * left)
    at_b = at_a * np.exp(-drop)
    moved = a * at_a - np.where(np.isinf(b), 0.0, b * at_b)
    return special.log_ndtr(-a) + np.log(left), at_a - at_b, moved


def _around(a: Array, b: Array) -> _Found:
    """a < 0 < b: P is a sum of two positive numbers."""
    probability = 0.5 * (special.erf(b / ROOT_2) + special.erf(-a / ROOT_2))
    at_a, at_b = (np.exp(-0.5 * u**2 - HALF_LOG_2_PI) / probability for u in (a, b))
    moved = np.where(np.isinf(a), 0.0, a * at_a) - np.where(np.isinf(b), 0.0, b * at_b)
    return np.log(probability), at_a - at_b, moved
