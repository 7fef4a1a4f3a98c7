"""The normal law on the whole line, with Hermite polynomials."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from aleator.laws.hyperparameter import (
    OPEN,
    Hyperparameter,
    Specification,
    location_and_scale,
)
from aleator.laws.law import ByMeanAndSd, Rule, Standard, normal_log_density
from aleator.polynomials import gauss_hermite, hermite_recurrence
from aleator.types import Array

REACH = 8.0
"""Standard deviations that the box spans: mass beyond is 1e-15; holds Hermite nodes to q = 20."""


@dataclass(frozen=True)
class Normal(ByMeanAndSd):
    """Normal law, x = mean + sd theta with theta ~ N(0, 1) (paper, table of Wiener-Askey).

    `mean` and `sd` are numbers (known) or `Free` (identified); both need finite limits, for
    a normal law has no box of its own. An sd limit left open becomes a thousandth and a half
    of the width of the mean's limits. Raises InputsError where limits are missing or out of order.
    The parameter can take any value: where the simulator fails beyond some value, use
    `TruncatedNormal` with a box.

    >>> from aleator.laws import Free
    >>> law = Normal(mean=Free(-1.0, 1.0), sd=0.5)
    >>> rule = law.rule(np.array([1.0, 0.5]), 3)
    >>> rule.x.round(6).tolist()
    [0.133975, 1.0, 1.866025]
    """

    mean: Specification = OPEN
    sd: Specification = OPEN

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`mean` and `sd`."""
        return location_and_scale(self.mean, self.sd)

    @property
    def box(self) -> tuple[float, float]:
        """Mean limits widened by eight of the largest standard deviations."""
        mean, sd = self.hyperparameters
        return mean.lower - REACH * sd.upper, mean.upper + REACH * sd.upper

    @property
    def bounded(self) -> bool:
        """A normal law has no box of its own."""
        return False

    def rule(self, values: Array, nodes: int) -> Rule:
        """Gauss-Hermite nodes mean + sd theta_j; the weights do not depend on alpha."""
        theta, weights = gauss_hermite(nodes)
        dx = np.stack([np.ones(nodes), theta], axis=1)
        return Rule(values[0] + values[1] * theta, weights, theta, dx, np.zeros((nodes, 2)))

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:  # noqa: ARG002
        """Hermite polynomials of theta."""
        return hermite_recurrence(count)

    def log_density(self, values: Array, x: Array) -> Array:
        """-theta^2/2 - log(sd sqrt(2 pi)) with theta = (x - mean)/sd."""
        log_density: Array = normal_log_density(self.normal_score(values, x)) - np.log(values[1])
        return log_density

    def normal_score(self, values: Array, x: Array) -> Array:
        """(x - mean)/sd."""
        score: Array = (x - values[0]) / values[1]
        return score

    def quantile(self, values: Array, probability: Array) -> Array:
        """mean + sd Phi^-1(probability)."""
        theta: Array = special.ndtri(probability)
        x: Array = values[0] + values[1] * theta
        return x

    def standard(self, values: Array, theta: Array) -> Standard:
        """mean + sd theta."""
        dvalues = np.ones((*theta.shape, 2))
        dvalues[..., 1] = theta
        return Standard(values[0] + values[1] * theta, np.full(theta.shape, values[1]), dvalues)
