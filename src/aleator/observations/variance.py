"""Variance functions: scales of the error that follow the simulated value or a column."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from aleator.core.types import Array, Flags
from aleator.errors import InputsError
from aleator.laws import Free, Hyperparameter, Specification, resolve


class VarianceFactor(NamedTuple):
    """The factor of the scale with the derivatives of its logarithm, elementwise.

    `by_covariate` is the derivative by the covariate v, `by_value` that by the hyperparameter.
    """

    value: Array
    by_covariate: Array
    by_value: Array


class VarianceFunction(Protocol):
    """A factor of the error's scale that depends on a covariate v.

    v is the simulated value, or the column of the table that `of` names. `hyperparameter` is named
    without the prefix `noise.`.
    """

    @property
    def of(self) -> str | None:
        """The column of the table that is the covariate; None for the simulated value."""

    @property
    def hyperparameter(self) -> Hyperparameter:
        """The hyperparameter of the function, known or free."""

    def admissible(self, cells: Array) -> Flags:
        """Which numbers of the column can be the covariate."""

    def factor(self, value: float, covariate: Array) -> VarianceFactor:
        """The factor at a value of the hyperparameter, for covariates of any shape."""


DEFAULT_EXPONENT = Free(-2.0, 2.0)
"""The default limits of the exponent of a power: from 1/v^2 to v^2."""


@dataclass(frozen=True)
class PowerVariance:
    """A scale that is a power of the simulated value, or of a column: sd |v/at|^exponent.

    It is `varPower` of nlme (Pinheiro and Bates, 2000, section 5.2.1). `exponent`, the
    hyperparameter `noise.exponent`, is a number or `Free(lower, upper)`, by default between -2 and
    2. `of` names a column of the table without zeros; left out, v is the simulated value. The `sd`
    of the noise is the scale where |v| is `at`. Far from the values v, it is hardly told apart from
    the exponent. Raises InputsError for limits that are not finite or out of order, and where `at`
    is not positive. Where v is zero, so is the scale, and a measured value has no density there.

    >>> found = PowerVariance(0.5).factor(0.5, np.array([4.0]))
    >>> [part.tolist() for part in found]
    [[2.0], [0.125], [1.3862943611198906]]
    """

    exponent: Specification = DEFAULT_EXPONENT
    of: str | None = None
    at: float = 1.0

    def __post_init__(self) -> None:
        """Check the arguments; InputsError if they are not valid."""
        if not 0.0 < self.at < np.inf:
            raise InputsError(f"variance: at = {self.at}", "give a number > 0")
        _ = self.hyperparameter

    @cached_property
    def hyperparameter(self) -> Hyperparameter:
        """The exponent, known or free."""
        default = (DEFAULT_EXPONENT.lower, DEFAULT_EXPONENT.upper)
        return resolve("exponent", self.exponent, default)

    def admissible(self, cells: Array) -> Flags:
        """All numbers but zero, whose powers are no scale."""
        return np.asarray(cells != 0.0)

    def factor(self, value: float, covariate: Array) -> VarianceFactor:
        """|v/at|^exponent with the derivatives of its logarithm, exponent/v and log |v/at|."""
        log = np.log(np.abs(covariate) / self.at)
        return VarianceFactor(np.exp(value * log), value / covariate, log)


@dataclass(frozen=True)
class ExponentialVariance:
    """A scale that grows with the simulated value, or a column: sd exp(rate (v - at)).

    It is `varExp` of nlme (Pinheiro and Bates, 2000, section 5.2.1). `rate`, the hyperparameter
    `noise.rate`, is a number or `Free(lower, upper)`, in units of 1/v; both limits are needed. `of`
    names a column of the table; left out, v is the simulated value. The `sd` of the noise is the
    scale where v is `at`. Raises InputsError for limits that are missing, not finite or out of
    order.

    >>> found = ExponentialVariance(0.5).factor(0.5, np.array([2.0]))
    >>> [part.tolist() for part in found]
    [[2.718281828459045], [0.5], [2.0]]
    """

    rate: Specification
    of: str | None = None
    at: float = 0.0

    def __post_init__(self) -> None:
        """Check the arguments; InputsError if they are not valid."""
        if not np.isfinite(self.at):
            raise InputsError(f"variance: at = {self.at}", "give a finite number")
        _ = self.hyperparameter

    @cached_property
    def hyperparameter(self) -> Hyperparameter:
        """The rate, known or free."""
        return resolve("rate", self.rate, (None, None))

    def admissible(self, cells: Array) -> Flags:
        """All numbers."""
        return np.isfinite(cells)

    def factor(self, value: float, covariate: Array) -> VarianceFactor:
        """exp(rate (v - at)) with the derivatives of its logarithm, the rate and v - at."""
        away = covariate - self.at
        return VarianceFactor(np.exp(value * away), np.broadcast_to(value, away.shape), away)
