"""A density from outside the package: logistic, with the outcome's mean and standard deviation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from aleator.core.types import Array
from aleator.moments.densities import StandardizedDensity

SCALE = math.sqrt(3.0) / math.pi
"""The scale of the logistic law whose standard deviation is one."""


@dataclass(frozen=True)
class Logistic(StandardizedDensity):
    """g(u) = exp(-v)/(s (1 + exp(-v))^2) with v = u/s: tails heavier than those of the normal."""

    @property
    def name(self) -> str:
        return "logistic"

    @property
    def order(self) -> int:
        return 2

    def log_density(self, u: Array, c: Array) -> tuple[Array, Array, Array]:
        v = np.abs(u) / SCALE
        value = -v - 2.0 * np.log1p(np.exp(-v)) - math.log(SCALE)
        by_moments = np.zeros((*u.shape, c.shape[2]))
        return value, -np.tanh(0.5 * u / SCALE) / SCALE, by_moments

    def cumulative(self, u: Array, c: Array) -> Array:  # noqa: ARG002  no moment but two
        return special.expit(u / SCALE)
