"""A parameter that is the same in every experiment and unknown (or known)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.laws.hyperparameter import OPEN, Hyperparameter, Specification, resolve, within
from aleator.laws.law import MeanSd, Rule, Standard
from aleator.types import Array


@dataclass(frozen=True)
class Constant:
    """A parameter without scatter, P(x = value) = 1; its one hyperparameter is `value`.

    `value` is a number (known) or `Free(lower, upper)` (identified). Raises InputsError where
    the limits are missing or out of order.

    >>> from aleator.laws import Free
    >>> Constant(Free(-20.0, 0.0)).hyperparameters[0].start
    -10.0
    """

    value: Specification = OPEN

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The one hyperparameter, `value`."""
        return (resolve("value", self.value, (None, None)),)

    @property
    def box(self) -> tuple[float, float]:
        """The limits of the value."""
        value = self.hyperparameters[0]
        return value.lower, value.upper

    @property
    def bounded(self) -> bool:
        """The limits of the value are its box."""
        return True

    @property
    def scatters(self) -> bool:
        """A constant does not vary between experiments."""
        return False

    def rule(self, values: Array, nodes: int) -> Rule:  # noqa: ARG002 (one node suffices)
        """One node at the value."""
        one = np.ones((1, 1))
        return Rule(values[:1].copy(), np.ones(1), np.zeros(1), one, np.zeros((1, 1)))

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:  # noqa: ARG002
        """Only the polynomial of degree zero exists."""
        return np.zeros(1), np.ones(1)

    def log_density(self, values: Array, x: Array) -> Array:
        """log P(x): zero at the value, minus infinity elsewhere."""
        return np.where(x == values[0], 0.0, -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """A constant has no scatter: zero at the value, infinite beside it."""
        return np.where(x == values[0], 0.0, np.copysign(np.inf, x - values[0]))

    def quantile(self, values: Array, probability: Array) -> Array:
        """The value at every probability."""
        return np.full(probability.shape, values[0])

    def standard(self, values: Array, theta: Array) -> Standard:
        """The value, whatever theta is."""
        return Standard(
            np.full(theta.shape, values[0]), np.zeros(theta.shape), np.ones((*theta.shape, 1))
        )

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The value, and no scatter."""
        return MeanSd(float(values[0]), 0.0, np.ones(1), np.zeros(1))

    def filling(self, center: float, sd: float | None = None) -> Array:  # noqa: ARG002
        """The center, within the limits."""
        return within(self.hyperparameters, [center])
