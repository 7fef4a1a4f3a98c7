"""Normal measurement error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from aleator.observations.model import Observed
from aleator.types import Array

HALF_LOG_2_PI = 0.5 * float(np.log(2.0 * np.pi))


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
        u = (y - eta) / scale
        return Observed(
            -0.5 * u**2 - np.log(scale) - HALF_LOG_2_PI, u / scale, (u**2 - 1.0) / scale
        )

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
