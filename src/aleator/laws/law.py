"""The interface of a marginal law; every law fills it in a file of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aleator.laws.hyperparameter import Hyperparameter, filled
from aleator.types import Array


@dataclass(frozen=True)
class Rule:
    """A quadrature rule of q nodes for a law with k hyperparameters.

    `x` (q,) are the nodes, `weights` (q,) sum to one, `t` (q,) are the nodes in the
    variable of the law's polynomials; `dx` and `dweights` (q, k) are the derivatives by the
    law's hyperparameters, so that the derivative of any weighted sum is exact for any q.
    """

    x: Array
    weights: Array
    t: Array
    dx: Array
    dweights: Array


@dataclass(frozen=True)
class Standard:
    """A law as the image x = F^-1(Phi(theta)) of standard normal variates theta of any shape.

    `x` has the shape of theta, and so has its derivative by theta, `dtheta`; `dvalues`
    (*theta.shape, k) are the derivatives by the law's hyperparameters.
    """

    x: Array
    dtheta: Array
    dvalues: Array


@dataclass(frozen=True)
class MeanSd:
    """Mean and standard deviation of a law, with derivatives (k,) by its hyperparameters."""

    mean: float
    sd: float
    dmean: Array
    dsd: Array

    @classmethod
    def of(cls, rule: Rule) -> MeanSd:
        """Those of a rule of two nodes or more, which are the law's own.

        >>> import numpy as np
        >>> half = np.array([0.5, 0.5])
        >>> zero, one = np.zeros((2, 1)), np.ones((2, 1))
        >>> m = MeanSd.of(Rule(np.array([1.0, 3.0]), half, np.array([-1.0, 1.0]), one, zero))
        >>> m.mean, m.sd, m.dmean.tolist(), m.dsd.tolist()
        (2.0, 1.0, [1.0], [0.0])
        """
        mean = float(rule.weights @ rule.x)
        away = rule.x - mean
        sd = float(rule.weights @ away**2) ** 0.5
        dmean = rule.weights @ rule.dx + away @ rule.dweights
        dvariance = 2.0 * (rule.weights * away) @ rule.dx + away**2 @ rule.dweights
        return cls(mean, sd, dmean, dvariance / (2.0 * sd))


class Law(Protocol):
    """A marginal law P_X(alpha) of one parameter.

    `values` (k,) are its hyperparameters in the order of `hyperparameters`.
    """

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters, resolved and in order."""
        ...

    @property
    def box(self) -> tuple[float, float]:
        """Finite interval that holds every node for every admissible alpha."""
        ...

    @property
    def bounded(self) -> bool:
        """Whether the user stated the box, rather than the law having to guess one."""
        ...

    @property
    def scatters(self) -> bool:
        """Whether the parameter varies between experiments (a constant does not)."""
        ...

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss rule of the law with `nodes` nodes (one for a constant)."""
        ...

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """The first coefficients a (count,), b (count,) of the law's orthonormal polynomials.

        They belong to the variable t of `Rule`; see `aleator.polynomials`. A constant
        has one pair, whatever the count.
        """
        ...

    def log_density(self, values: Array, x: Array) -> Array:
        """log f(x) at each x (J,), minus infinity outside the support."""
        ...

    def normal_score(self, values: Array, x: Array) -> Array:
        """theta = Phi^-1(F(x)) at each x (J,), the inverse of `standard`; infinite outside."""
        ...

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile of the law at each probability; maps uniform samples to the law."""
        ...

    def standard(self, values: Array, theta: Array) -> Standard:
        """The law as the image of standard normal variates of any shape, with derivatives.

        `values` are (k,), one law for every theta, or (k, ...) with rows that broadcast against
        theta: laws (k, B, 1) of B experiments for theta (B, J).
        """
        ...

    def mean_and_sd(self, values: Array) -> MeanSd:
        """Mean and standard deviation of the law, with derivatives by its hyperparameters."""
        ...

    def filling(self, center: float, sd: float | None = None) -> Array:
        """Hyperparameters (k,) of the law of this family with this center and sd.

        They are cut to their limits, and fixed ones keep their values. With `sd` None only the
        location is set; the others are at their starts.
        """
        ...


class ByMeanAndSd(ABC):
    """What laws share whose two hyperparameters are their own mean and standard deviation."""

    @property
    @abstractmethod
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`mean` and `sd`."""

    @property
    def scatters(self) -> bool:
        """The parameter varies between experiments."""
        return True

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The two hyperparameters."""
        return MeanSd(float(values[0]), float(values[1]), np.eye(2)[0], np.eye(2)[1])

    def filling(self, center: float, sd: float | None = None) -> Array:
        """The center and the sd, within their limits."""
        return filled(self.hyperparameters, center, sd)
