"""The lognormal law above a known end, handled through its normal variate."""

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
    require_above,
    widest_above,
)
from aleator.laws.law import ByMeanAndSd, Rule, Standard, normal_log_density
from aleator.polynomials import gauss_hermite, hermite_recurrence
from aleator.types import Array

REACH = 8.0
"""Standard deviations of theta that the box spans: mass beyond is 1e-15."""
LARGEST_VARIATION = 1.0
"""sd over distance from the end that the box takes account of."""


@dataclass(frozen=True)
class LogNormal(ByMeanAndSd):
    """Lognormal law of x - lower, by the mean and sd of x itself, with Hermite polynomials.

    x = lower + exp(m + s theta), theta ~ N(0, 1), with s^2 = log(1 + c^2), c = sd/(mean - lower),
    and m = log(mean - lower) - s^2/2. Each of `mean` and `sd` is a number (known) or `Free`
    (identified). The mean needs finite limits above `lower`; an sd limit left open becomes a
    thousandth and a half of their width. Raises InputsError where limits are missing, out of
    order, or not above `lower`.

    The polynomials are those of theta, not of x: the moments of a lognormal law do not
    determine it (Heyde, 1963), so its own polynomials are not dense, and an expansion in them may
    converge to something else (Ernst, Mugler, Starkloff and Ullmann, 2012). Hence a rule of q
    nodes is exact for polynomials of theta and not of x; with c up to 1 and q = 20 the error of the
    mean and sd is below 1e-7 of them.

    >>> values = np.array([np.e**0.5, np.sqrt(np.e**2 - np.e)])                   # m = 0, s = 1
    >>> law = LogNormal(*values)
    >>> law.quantile(values, special.ndtr(np.array([-1.0, 0.0, 1.0]))).round(6).tolist()
    [0.367879, 1.0, 2.718282]
    """

    mean: Specification = OPEN
    sd: Specification = OPEN
    lower: float = 0.0

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`mean` and `sd` of the law itself, not of its logarithm."""
        return require_above(self.lower, location_and_scale(self.mean, self.sd))

    @cached_property
    def box(self) -> tuple[float, float]:
        """From `lower` to eight sd of theta for any law whose sd is at most mean - lower.

        Far nodes of a rule may lie beyond it.
        """
        far = np.array([REACH])
        corners = widest_above(self.lower, self.hyperparameters, LARGEST_VARIATION)
        return self.lower, max(float(self.standard(corner, far).x[0]) for corner in corners)

    @property
    def bounded(self) -> bool:
        """A lognormal law has no box of its own."""
        return False

    def rule(self, values: Array, nodes: int) -> Rule:
        """Gauss-Hermite nodes of theta; the weights do not depend on alpha."""
        theta, weights = gauss_hermite(nodes)
        image = self.standard(values, theta)
        return Rule(image.x, weights, theta, image.dvalues, np.zeros((nodes, 2)))

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:  # noqa: ARG002
        """Hermite polynomials of theta."""
        return hermite_recurrence(count)

    def log_density(self, values: Array, x: Array) -> Array:
        """log phi(theta) - log(s (x - lower)) with theta = (log(x - lower) - m)/s."""
        s = _log_sd(values[1] / (values[0] - self.lower))
        inside = x > self.lower
        above = np.where(inside, x - self.lower, 1.0)
        log_density = normal_log_density(self.normal_score(values, x)) - np.log(s * above)
        return np.where(inside, log_density, -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """(log(x - lower) - m)/s."""
        distance = values[0] - self.lower
        s = _log_sd(values[1] / distance)
        with np.errstate(divide="ignore"):
            logarithm = np.log(np.maximum(x - self.lower, 0.0) / distance)
        score: Array = logarithm / s + 0.5 * s
        return score

    def quantile(self, values: Array, probability: Array) -> Array:
        """lower + exp(m + s Phi^-1(probability))."""
        s = _log_sd(values[1] / (values[0] - self.lower))
        scale = (values[0] - self.lower) * np.exp(-0.5 * s**2)
        x: Array = self.lower + scale * np.exp(s * special.ndtri(probability))
        return x

    def standard(self, values: Array, theta: Array) -> Standard:
        """lower + exp(m + s theta)."""
        distance = values[0] - self.lower
        c = values[1] / distance
        s = _log_sd(c)
        share = np.exp(s * (theta - 0.5 * s))
        above = distance * share
        # d log(x - lower)/ds = theta - s, and ds/dc = c/(s (1 + c^2))
        dvalues = np.empty((*above.shape, 2))
        dvalues[..., 1] = by_sd = share * (theta - s) * (c / (s * (1.0 + c**2)))
        dvalues[..., 0] = share - c * by_sd
        return Standard(self.lower + above, s * above, dvalues)


def _log_sd(variation: Array) -> Array:
    """Standard deviation of the logarithm, from the coefficient of variation."""
    sd: Array = np.sqrt(np.log1p(variation**2))
    return sd
