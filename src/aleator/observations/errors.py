"""The measurement errors of all observations together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aleator.laws.hyperparameter import Hyperparameter
from aleator.observations.noise import Noise
from aleator.types import Array, Indices


class Terms(NamedTuple):
    """log p(y_k | eta_k) (m, J), its derivative by eta (m, J), and by each of P values.

    Of each value: the observations that it concerns, and the derivative (their number, J).
    """

    value: Array
    d_eta: Array
    d_values: tuple[tuple[Indices, Array], ...]


@dataclass(frozen=True, eq=False)
class MeasurementErrors:
    """Measurement errors of M observations of one response."""

    noise: Noise
    y: Array

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of the noise."""
        return (self.noise.hyperparameter,)

    def terms(self, values: Array, eta: Array, rows: slice) -> Terms:
        """log p and its derivatives for a slice of the observations."""
        found = self.noise.kind.log_density(self.y[rows, None], eta, np.array(values[0]))
        every = np.arange(len(eta))
        return Terms(found.value, found.d_eta, ((every, found.d_scale),))

    def curvature(self, values: Array, eta: Array, rows: slice) -> Array:  # noqa: ARG002
        """-d2 log p/d eta2."""
        return np.full(eta.shape, values[0] ** -2)
