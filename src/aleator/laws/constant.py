"""The law of a parameter that is the same in all experiments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.core.types import Array
from aleator.errors import naming
from aleator.laws.hyperparameter import OPEN, Hyperparameter, Specification, resolve, within
from aleator.laws.law import MeanSd, Rule, Standard


@dataclass(frozen=True)
class Constant:
    """A parameter without scatter, P(x = value) = 1; its only hyperparameter is `value`.

    `value` is a number (known) or `Free(lower, upper)` (identified). Raises InputsError where
    the limits are missing or out of order.

    >>> from aleator.laws import Free
    >>> Constant(Free(-20.0, 0.0)).hyperparameters[0].start
    -10.0
    """

    value: Specification = OPEN
    bounded = True
    scatters = False

    def __post_init__(self) -> None:
        with naming(type(self).__name__):
            _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The only hyperparameter, `value`."""
        return (resolve("value", self.value, (None, None)),)

    @property
    def box(self) -> tuple[float, float]:
        """The range of the parameter, which is the limits of its value."""
        value = self.hyperparameters[0]
        return value.lower, value.upper

    def rule(self, values: Array, nodes: int) -> Rule:  # noqa: ARG002 (one node suffices)
        """A rule with one node, at the value."""
        one = np.ones((1, 1))
        return Rule(values[:1].copy(), np.ones(1), np.zeros(1), one, np.zeros((1, 1)))

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:  # noqa: ARG002
        """One pair of coefficients, because only the polynomial of degree zero exists."""
        return np.zeros(1), np.ones(1)

    def log_density(self, values: Array, x: Array) -> Array:
        """The log probability of x: zero at the value, minus infinity elsewhere."""
        return np.where(x == values[0], 0.0, -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score, which is zero at the value and infinite elsewhere."""
        return np.where(x == values[0], 0.0, np.copysign(np.inf, x - values[0]))

    def quantile(self, values: Array, probability: Array) -> Array:
        """The value itself, which is the quantile at every probability."""
        return np.full(probability.shape, values[0])

    def standard(self, values: Array, theta: Array) -> Standard:
        """The value itself, which does not depend on theta."""
        return Standard(
            np.full(theta.shape, values[0]), np.zeros(theta.shape), np.ones((*theta.shape, 1))
        )

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The mean, which is the value, and an sd of zero."""
        return MeanSd(float(values[0]), 0.0, np.ones(1), np.zeros(1))

    def filling(self, center: float, sd: float | None = None) -> Array:  # noqa: ARG002
        """The value (1,) equal to the center, moved into its limits."""
        return within(self.hyperparameters, [center])

    def customary(self, values: Array) -> Mapping[str, float]:  # noqa: ARG002
        """None: the value is the usual quantity."""
        return {}
