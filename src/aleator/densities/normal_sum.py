"""Weighted sums of normal densities: what a mixture and a convolution with noise both are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from aleator.densities.interface import FARTHEST
from aleator.densities.inversion import invert
from aleator.types import Array

_LOG_SQRT_2PI = 0.5 * np.log(2.0 * np.pi)

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
        with np.errstate(over="ignore"):
            z = (y[:, :, None] - self.centers[:, None]) / self.sds[:, None]
        z = np.clip(z, -FARTHEST, FARTHEST)
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
        """Probability of an outcome not above y."""
        value = np.empty(y.shape)
        for part in self._columns(y.shape[1]):
            with np.errstate(over="ignore"):
                z = (y[:, part, None] - self.centers[:, None]) / self.sds[:, None]
            value[:, part] = np.einsum("ngj,nj->ng", ndtr(z), self.weights)
        return np.clip(value, 0.0, 1.0)

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
        y = invert(self.cdf, lambda y: np.exp(self.log_pdf(y)), inner, low, high)
        return np.where(every <= 0.0, -np.inf, np.where(every >= 1.0, np.inf, y))

    def _columns(self, columns: int) -> Iterator[slice]:
        """Columns of y that fit the memory of one batch."""
        width = max(1, _LARGEST_BATCH // max(1, self.weights.size))
        yield from (slice(first, first + width) for first in range(0, columns, width))
