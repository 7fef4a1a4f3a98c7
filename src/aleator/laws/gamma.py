"""The gamma law above a known end, with generalized Laguerre polynomials."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

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
from aleator.laws.law import (
    FARTHEST,
    MANY,
    ByMeanAndSd,
    Rule,
    Standard,
    Tabulated,
    difference,
    from_probability,
    from_tails,
    slope,
    to_score,
)
from aleator.polynomials import gauss_with_gradient, laguerre_recurrence, recurrence_with_gradient
from aleator.types import Array

LARGEST_VARIATION = 5.0**0.5
"""sd over distance from the end that the box takes account of: shape 0.2."""
NARROWEST = 1e-3
"""Share of its upper limit that stands for an sd of zero: quantiles keep their digits."""
FAR = 1e-15
"""Probability left beyond the box."""


@dataclass(frozen=True)
class Gamma(ByMeanAndSd):
    """Gamma law of x - lower, by its own mean and sd, with generalized Laguerre polynomials.

    The shape is k = ((mean - lower)/sd)^2 and the scale sd^2/(mean - lower) (Wiener-Askey table of
    Xiu and Karniadakis, 2002); k = 1 is the exponential law, and for large k the law tends to the
    normal one. `mean` and `sd` are those of x; each is a number (known) or `Free` (identified).
    The mean needs finite limits above `lower`; an sd limit left open becomes a thousandth and a
    half of their width. Measured for k from 0.2 to 1e6. Raises InputsError where limits are
    missing, out of order, or not above `lower`.

    The density is infinite at `lower` where sd > mean - lower (k < 1). The law has no box of its
    own: where the simulator fails beyond some value, use `Beta` or `TruncatedNormal`.

    >>> law = Gamma(mean=2.0, sd=1.0, lower=1.0)                # 1 + an exponential law
    >>> rule = law.rule(np.array([2.0, 1.0]), 2)                # Gauss-Laguerre: 2 -+ sqrt(2)
    >>> rule.x.round(6).tolist(), rule.weights.round(6).tolist()
    ([1.585786, 4.414214], [0.853553, 0.146447])
    """

    mean: Specification = OPEN
    sd: Specification = OPEN
    lower: float = 0.0

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`mean` and `sd` of the law."""
        return require_above(self.lower, location_and_scale(self.mean, self.sd, NARROWEST))

    @cached_property
    def box(self) -> tuple[float, float]:
        """From `lower` to where 1e-15 of any law is left whose shape is 0.2 or more.

        Far nodes of a rule may lie beyond it.
        """
        tail = np.array([1.0 - FAR])
        corners = widest_above(self.lower, self.hyperparameters, LARGEST_VARIATION)
        return self.lower, max(float(self.quantile(corner, tail)[0]) for corner in corners)

    @property
    def bounded(self) -> bool:
        """A gamma law has no box of its own."""
        return False

    def rule(self, values: Array, nodes: int) -> Rule:
        """Gauss-Laguerre nodes mean + sd t_j(c) with c = sd/(mean - lower)."""
        distance = values[0] - self.lower
        c = values[1] / distance
        t, weights, by_t, by_weight = gauss_with_gradient(
            *recurrence_with_gradient(laguerre_recurrence, nodes, [c])
        )
        # c moves by -c/distance with the mean and by 1/distance with the sd
        dc = np.array([-c, 1.0]) / distance
        dx = np.stack([np.ones(nodes), t], axis=1) + values[1] * by_t * dc
        # rounding must not push a node below the end
        x = np.maximum(values[0] + values[1] * t, self.lower)
        return Rule(x, weights, t, dx, by_weight * dc)

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """Generalized Laguerre polynomials of (x - mean)/sd."""
        a, b = laguerre_recurrence(count, values[1] / (values[0] - self.lower))
        return np.real(a), np.real(b)

    def log_density(self, values: Array, x: Array) -> Array:
        """(k - 1) log g - g - log Gamma(k) - log(scale) with g = (x - lower)/scale."""
        k, scale = self._shape_and_scale(values)
        g = (x - self.lower) / scale
        return np.where(g >= 0.0, _log_density(k, scale, np.maximum(g, 0.0)), -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """Phi^-1 of the regularized incomplete gamma function."""
        k, scale = self._shape_and_scale(values)
        g = np.maximum(x - self.lower, 0.0) / scale
        return to_score(special.gammainc(k, g), special.gammaincc(k, g))

    def quantile(self, values: Array, probability: Array) -> Array:
        """lower + scale P^-1(k, probability), P the regularized incomplete gamma function."""
        k, scale = self._shape_and_scale(values)
        return self.lower + scale * from_probability(
            probability,
            lambda p: special.gammaincinv(k, p),
            lambda p: special.gammainccinv(k, p),
        )

    def standard(self, values: Array, theta: Array) -> Standard:
        """The quantile at Phi(theta); its derivative by the shape is a difference (1e-8)."""
        k, scale = self._shape_and_scale(values)
        g = _standard_gamma(k, theta)
        c = k**-0.5
        by_c = difference(lambda v: (_standard_gamma(v**-2.0, theta) - v**-2.0) * v, c)
        dvalues = np.stack([1.0 - c**2 * by_c, (g - k) * c + c * by_c], axis=-1)
        return Standard(self.lower + scale * g, slope(theta, _log_density(k, scale, g)), dvalues)

    def _shape_and_scale(self, values: Array) -> tuple[Array, Array]:
        distance = values[0] - self.lower
        return (distance / values[1]) ** 2, values[1] ** 2 / distance


def _log_density(k: Array, scale: Array, g: Array) -> Array:
    """log f of x = lower + scale g, g >= 0; infinite at the end where k < 1."""
    with np.errstate(divide="ignore"):
        power = special.xlogy(k - 1.0, g)
    log_density: Array = power - g - special.gammaln(k) - np.log(scale)
    return log_density


def _standard_gamma(k: Array, theta: Array) -> Array:
    """The gamma law of shape k and scale 1 at Phi(theta), which keeps its digits near zero.

    Of one law many values are interpolations of their logarithm.
    """
    if np.ndim(k) == 0 and theta.size >= MANY and np.max(np.abs(theta)) < FARTHEST:
        table = _table(float(k))
        if table.finite:
            return np.exp(table(theta))
    return _exactly(k, theta)


def _exactly(k: Array | float, theta: Array) -> Array:
    return from_tails(
        theta,
        lambda p, k: special.gammaincinv(k, p),
        lambda p, k: special.gammainccinv(k, p),
        np.asarray(k),
    )


@lru_cache(maxsize=256)
def _table(k: float) -> Tabulated:
    """log g of the standard normal variate, with its slope phi/(f g)."""
    theta = Tabulated.knots()
    with np.errstate(all="ignore"):
        g = _exactly(k, theta)
        return Tabulated(np.log(g), slope(theta, k * np.log(g) - g - special.gammaln(k)))
