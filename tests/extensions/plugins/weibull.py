"""A law from outside the package: Weibull, by its shape and scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array
from aleator.laws import Hyperparameter, QuantileLaw, Specification, resolve


@dataclass(frozen=True)
class Weibull(QuantileLaw):
    """F(x) = 1 - exp(-(x/scale)^shape) for x > 0; each of the two is a number or `Free`."""

    shape: Specification
    scale: Specification

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`shape` and `scale`, both positive; limits have no defaults."""
        return (
            resolve("shape", self.shape, (None, None), positive=True),
            resolve("scale", self.scale, (None, None), positive=True),
        )

    def log_density(self, values: Array, x: Array) -> Array:
        shape, scale = values
        with np.errstate(divide="ignore", invalid="ignore"):
            z = np.where(x > 0.0, x / scale, np.nan)
            log_density = np.log(shape / scale) + (shape - 1.0) * np.log(z) - z**shape
        return np.where(x > 0.0, log_density, -np.inf)

    def quantile(self, values: Array, probability: Array) -> Array:
        shape, scale = values
        return scale * (-np.log1p(-probability)) ** (1.0 / shape)

    def upper_quantile(self, values: Array, probability: Array) -> Array:
        shape, scale = values
        return scale * (-np.log(probability)) ** (1.0 / shape)
