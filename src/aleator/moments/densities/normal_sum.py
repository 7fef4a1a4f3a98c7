"""Weighted sums of normal densities: what a mixture and a convolution both are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from aleator.blocks import blocks
from aleator.laws.law import invert
from aleator.moments.densities.interface import FARTHEST
from aleator.types import Array

_LOG_SQRT_2PI = 0.5 * np.log(2.0 * np.pi)

NONE, ALL = -38.6, 8.3
"""Standard deviations at which a normal probability is none, and all but rounding."""

_LARGEST_BATCH = 2_000_000
"""Exponentials evaluated at once."""


@dataclass(frozen=True)
class NormalSum:
    """f(y) = sum_j weights_j Normal(y; centers_j, sds_j^2) of N experiments, all arrays (N, J).

    Weights are not negative and sum to one, sds are positive. An outcome y is (N, G).
    """

    weights: Array
    centers: Array
    sds: Array

    def parts(self, y: Array) -> Array:
        """Logarithms (N, J) of Normal(y; centers, sds^2) at y (N,)."""
        return self._parts(y[:, None])[:, 0]

    def _parts(self, y: Array) -> Array:
        z = np.clip(self._standardized(y), -FARTHEST, FARTHEST)
        return np.asarray(-0.5 * z**2 - np.log(self.sds)[:, None] - _LOG_SQRT_2PI)

    def log_pdf(self, y: Array) -> Array:
        """Logarithm of the density, finite as long as y is."""
        value = np.empty(y.shape)
        with np.errstate(divide="ignore"):
            log_weights = np.log(self.weights)[:, None]
        for part in self._columns(y.shape[1]):
            exponent = self._parts(y[:, part]) + log_weights
            top = exponent.max(axis=2)
            value[:, part] = top + np.log(np.exp(exponent - top[:, :, None]).sum(axis=2))
        return value

    def cdf(self, y: Array) -> Array:
        """Probability of an outcome not above y; that of normals far from it is one or none."""
        value = np.empty(y.shape)
        for part in self._columns(y.shape[1]):
            z = self._standardized(y[:, part])
            near = ~((z <= NONE) | (z >= ALL))
            below = (z >= ALL).astype(float)
            below[near] = ndtr(z[near])
            value[:, part] = np.einsum("ngj,nj->ng", below, self.weights)
        return np.clip(value, 0.0, 1.0)

    def pdf(self, y: Array) -> Array:
        """The density; that of normals far from y is none."""
        value, scaled = np.empty(y.shape), self.weights / self.sds / np.sqrt(2.0 * np.pi)
        for part in self._columns(y.shape[1]):
            z = self._standardized(y[:, part])
            near = ~(np.abs(z) >= -NONE)
            density = np.zeros(z.shape)
            density[near] = np.exp(-0.5 * z[near] ** 2)
            value[:, part] = np.einsum("ngj,nj->ng", density, scaled)
        return value

    def quantile(self, p: Array) -> Array:
        """Outcomes (N, P) for p (P,): between the least and the largest quantile of the normals."""
        every = np.broadcast_to(p, (self.weights.shape[0], p.size))
        inner = np.clip(every, 1e-300, 1.0 - 1e-16)
        low, high = np.full(every.shape, np.inf), np.full(every.shape, -np.inf)
        for part in self._columns(p.size):
            own = self.centers[:, None] + self.sds[:, None] * ndtri(inner[:, part, None])
            carries = (self.weights > 0.0)[:, None]
            low[:, part] = np.where(carries, own, np.inf).min(axis=2)
            high[:, part] = np.where(carries, own, -np.inf).max(axis=2)
        start = np.clip(self._central(inner[:1]), low, high)
        y = invert(self.cdf, self.pdf, inner, low, high, start)
        return np.where(every <= 0.0, -np.inf, np.where(every >= 1.0, np.inf, y))

    def _central(self, p: Array) -> Array:
        """Those (N, P) of the centers alone, for p (1, P)."""
        order = np.argsort(self.centers, axis=1)
        below = np.cumsum(np.take_along_axis(self.weights, order, axis=1), axis=1)
        place = [np.sum(below < level, axis=1) for level in p[0]]
        at = np.minimum(np.stack(place, axis=1), order.shape[1] - 1)
        return np.take_along_axis(self.centers, np.take_along_axis(order, at, axis=1), axis=1)

    def _standardized(self, y: Array) -> Array:
        """(N, G, J)"""
        with np.errstate(over="ignore"):
            return np.asarray((y[:, :, None] - self.centers[:, None]) / self.sds[:, None])

    def _columns(self, columns: int) -> list[slice]:
        """Columns of y that fit the memory of one batch."""
        return blocks(columns, self.weights.size, _LARGEST_BATCH)
