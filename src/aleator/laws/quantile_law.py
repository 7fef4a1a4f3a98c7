"""A law of which only density and quantile are written down; the rest is computed from them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import product

import numpy as np
from scipy import optimize

from aleator import polynomials as gauss
from aleator.laws.hyperparameter import Hyperparameter, limits_of, within
from aleator.laws.law import (
    STEP,
    MeanSd,
    Rule,
    Standard,
    by_distinct,
    difference,
    from_tails,
    slope,
)
from aleator.polynomials import gauss_legendre, stieltjes
from aleator.types import Array

FAR = 1e-15
"""Probability left beyond either end of the box."""
POINTS = 400
"""Points of the fine rule in the standard normal variate, by which expectations are computed."""
WIDEST = 14.0
"""The standard normal variate goes this far on either side, for high moments of long tails."""
HALVINGS = 60


class QuantileLaw(ABC):
    """A law by `hyperparameters`, `log_density` and `quantile`, which a subclass gives.

    x = F^-1(Phi(theta)) with theta ~ N(0, 1). Expectations are integrals over theta by 400 points,
    Gauss rules those of the law's own polynomials (Stieltjes procedure), derivatives by the
    hyperparameters central differences of fourth order. Their steps are 1e-3 of the value of a
    positive hyperparameter, and 1e-3 of the width of the limits of another; where that one is
    fixed, 1e-3 of its magnitude, or 1e-3 if it is zero. The law must exist two steps beyond its
    limits, and beyond what is fixed. Measured with Weibull laws: moments and their derivatives to
    1e-11 with up to 10 nodes. A subclass that knows the upper tail overrides `upper_quantile`, one
    that knows its ends `box` and `bounded`. Cost: some ten times that of a law whose polynomials
    are known.

    >>> from dataclasses import dataclass
    >>> from aleator.laws.hyperparameter import resolve
    >>> @dataclass(frozen=True)
    ... class Exponential(QuantileLaw):
    ...     scale: float
    ...     @property
    ...     def hyperparameters(self):
    ...         return (resolve("scale", self.scale, (None, None), positive=True),)
    ...     def log_density(self, values, x):
    ...         return np.where(x < 0.0, -np.inf, -x / values[0] - np.log(values[0]))
    ...     def quantile(self, values, probability):
    ...         return -values[0] * np.log1p(-probability)
    >>> Exponential(1.0).rule(np.ones(1), 2).x.round(6).tolist()    # Gauss-Laguerre: 2 -+ sqrt(2)
    [0.585786, 3.414214]
    """

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _ = self.hyperparameters

    @property
    @abstractmethod
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters, resolved and in order."""

    @abstractmethod
    def log_density(self, values: Array, x: Array) -> Array:
        """log f(x) at each x (J,), minus infinity outside the support."""

    @abstractmethod
    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile of the law at each probability (J,)."""

    def upper_quantile(self, values: Array, probability: Array) -> Array:
        """What is exceeded with each probability (J,); a law that has it keeps its upper tail."""
        return self.quantile(values, np.minimum(1.0 - probability, 1.0 - 2.0**-53))

    @property
    def box(self) -> tuple[float, float]:
        """Where 1e-15 is left beyond, of the laws at the corners of the limits."""
        limits = [(h.lower, h.upper) for h in self.hyperparameters]
        corners = [np.array(corner) for corner in product(*limits)]
        tail = np.array([FAR])
        lower = min(float(self.quantile(corner, tail)[0]) for corner in corners)
        return lower, max(float(self.upper_quantile(corner, tail)[0]) for corner in corners)

    @property
    def bounded(self) -> bool:
        """The box is a guess."""
        return False

    @property
    def scatters(self) -> bool:
        """The parameter varies between experiments."""
        return True

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss rule of the law's own polynomials; their variable has mean zero and sd one."""
        x, weights, t = self._rule(values, nodes)
        dx = self._slopes(lambda at: self._rule(at, nodes)[0], values)
        dweights = self._slopes(lambda at: self._rule(at, nodes)[1], values)
        return Rule(x, weights, t, dx, dweights)

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """The polynomials of (x - mean)/sd."""
        _, _, z, weights = self._points(values)
        return stieltjes(z, weights, count)

    def normal_score(self, values: Array, x: Array) -> Array:
        """Phi^-1(F(x)), by bisection of the quantile."""
        low, high = np.full(x.shape, -40.0), np.full(x.shape, 40.0)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            below = self._image(values, middle) < x
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        outside = ~np.isfinite(self.log_density(values, x))
        score: Array = np.where(outside, np.sign(low) * np.inf, 0.5 * (low + high))
        return score

    def standard(self, values: Array, theta: Array) -> Standard:
        """The quantile at Phi(theta); a loop over the distinct values where they are many."""
        return by_distinct(self._standard, values, theta)

    def _standard(self, values: Array, theta: Array) -> Standard:
        x = self._image(values, theta)
        dvalues = self._slopes(lambda at: self._image(at, theta), values)
        return Standard(x, slope(theta, self.log_density(values, x)), dvalues)

    def mean_and_sd(self, values: Array) -> MeanSd:
        """Mean and sd by a Gauss rule, which is exact for both."""
        return MeanSd.of(self.rule(values, 2))

    def filling(self, center: float, sd: float | None = None) -> Array:
        """The law of this mean and sd, as near to it as the limits admit."""
        start = np.array([h.start for h in self.hyperparameters])
        free = np.array([h.free for h in self.hyperparameters], dtype=bool)
        if not free.any():
            return start
        lower, upper = limits_of(self.hyperparameters, np.flatnonzero(free))
        scale = self._points(start)[1] if sd is None else sd

        def away(at: Array) -> Array:
            values = start.copy()
            values[free] = at
            mean, own = self._points(values)[:2]
            gaps = [(mean - center) / scale, 0.0 if sd is None else np.log(own / sd)]
            return np.array(gaps)

        inside = np.clip(
            start[free], lower + STEP * (upper - lower), upper - STEP * (upper - lower)
        )
        start[free] = optimize.least_squares(
            away, inside, bounds=(lower, upper), x_scale=upper - lower
        ).x
        return within(self.hyperparameters, start.tolist())

    def _image(self, values: Array, theta: Array) -> Array:
        return from_tails(
            theta, lambda p: self.quantile(values, p), lambda p: self.upper_quantile(values, p)
        )

    def _points(self, values: Array) -> tuple[float, float, Array, Array]:
        """Mean, sd, and the law as standardized points z (Q,) with weights (Q,)."""
        theta, weights = fine_points()
        return standardized(self._image(values, theta), weights)

    def _rule(self, values: Array, nodes: int) -> tuple[Array, Array, Array]:
        mean, sd, z, fine = self._points(values)
        t, weights = gauss(*stieltjes(z, fine, nodes))
        return mean + sd * t, weights, t

    def _slopes(self, function: Callable[[Array], Array], values: Array) -> Array:
        """Derivatives (..., k) by the hyperparameters of what is (...)."""
        columns = []
        for k, known in enumerate(self.hyperparameters):
            width = known.upper - known.lower or abs(known.start) or 1.0
            at = float(values[k])

            def moved(value: Array, k: int = k) -> Array:
                return function(np.concatenate([values[:k], [value], values[k + 1 :]]))

            columns.append(difference(moved, at, STEP * (at if known.log else width)))
        return np.stack(columns, axis=-1)


def fine_points() -> tuple[Array, Array]:
    """Standard normal variates theta (Q,) and their weights, which sum to one."""
    t, weights = gauss_legendre(POINTS)
    theta = WIDEST * t
    weights = weights * np.exp(-0.5 * theta**2)
    return theta, weights / weights.sum()


def standardized(x: Array, weights: Array) -> tuple[float, float, Array, Array]:
    """Mean and sd of points x (Q,), the points standardized, and their weights."""
    mean = float(weights @ x)
    sd = float(np.sqrt(weights @ (x - mean) ** 2))
    return mean, sd, (x - mean) / sd, weights
