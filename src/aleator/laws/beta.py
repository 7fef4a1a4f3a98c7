"""The beta law on a box, with Jacobi polynomials."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy import special

from aleator.errors import InputsError
from aleator.laws.hyperparameter import OPEN, Hyperparameter, Specification, resolve
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
from aleator.polynomials import gauss_with_gradient, jacobi_recurrence, recurrence_with_gradient
from aleator.types import Array

NARROWEST = 1e-3
"""Share of its upper limit that stands for an sd of zero: quantiles keep their digits."""
WIDEST = 0.99
"""Largest sd over that of the law which has all its mass on the two ends of the box."""


@dataclass(frozen=True)
class Beta(ByMeanAndSd):
    """Beta law on `box`, by its own mean and sd, with Jacobi polynomials.

    With m = (mean - lower)/w, v = (sd/w)^2 for the box's width w and s = m (1 - m)/v - 1, the
    shapes are p = m s and q = (1 - m) s (Wiener-Askey table of Xiu and Karniadakis, 2002):
    p = q = 1 is uniform, p, q > 1 has one peak, a shape below 1 is infinite at its end of the
    box. Each of `mean` and `sd` is a number (known) or `Free` (identified).

    A beta law exists where sd < sqrt((mean - lower)(upper - mean)). All laws within the limits
    must exist, so the largest sd must be below 0.99 of that at both limits of the mean; InputsError
    says how large it may be. Limits left open are: mean within the inner 80 % of the box, sd from
    w/1000 to 0.95 of the largest. A mean close to an end leaves little sd: state both limits, with
    the mean in a narrow range.

    >>> law = Beta(box=(0.0, 2.0), mean=1.0, sd=3.0**-0.5)                      # uniform
    >>> law.rule(np.array([1.0, 3.0**-0.5]), 2).x.round(6).tolist()
    [0.42265, 1.57735]
    """

    box: tuple[float, float]
    mean: Specification = OPEN
    sd: Specification = OPEN

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        lower, upper = float(self.box[0]), float(self.box[1])
        if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
            raise InputsError(
                f"box: {lower} to {upper} is no finite interval", "give two numbers in order"
            )
        object.__setattr__(self, "box", (lower, upper))
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`mean` and `sd` of the law."""
        lower, upper = self.box
        width = upper - lower
        mean = resolve("mean", self.mean, (lower + 0.1 * width, upper - 0.1 * width))
        if not lower < mean.lower <= mean.upper < upper:
            raise InputsError(
                f"mean: {mean.lower} to {mean.upper} is not inside the box ({lower}, {upper})",
                "a beta law has its mean strictly inside its box",
            )
        widest = min(math.sqrt((m - lower) * (upper - m)) for m in (mean.lower, mean.upper))
        limits = (min(1e-3 * width, 0.1 * widest), 0.95 * widest)
        sd = resolve("sd", self.sd, limits, positive=True, least=NARROWEST)
        if sd.upper > WIDEST * widest:
            raise InputsError(
                f"sd: no beta law on ({lower:g}, {upper:g}) has mean {mean.lower:g} to "
                f"{mean.upper:g} and sd {sd.upper:g}",
                f"lower the largest sd to {WIDEST * widest:.4g}, or narrow the limits of the mean",
            )
        return mean, sd

    @property
    def bounded(self) -> bool:
        """The box is the user's."""
        return True

    def rule(self, values: Array, nodes: int) -> Rule:
        """Gauss-Jacobi nodes mean + sd t_j(p, q)."""
        p, q, jac = self._shapes(values)
        t, weights, by_t, by_weight = gauss_with_gradient(
            *recurrence_with_gradient(jacobi_recurrence, nodes, [float(p), float(q)])
        )
        dx = np.stack([np.ones(nodes), t], axis=1) + values[1] * by_t @ jac
        # rounding must not push a node out of the box
        x = np.clip(values[0] + values[1] * t, *self.box)
        return Rule(x, weights, t, dx, by_weight @ jac)

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """Jacobi polynomials of (x - mean)/sd."""
        p, q, _ = self._shapes(values)
        a, b = jacobi_recurrence(count, float(p), float(q))
        return np.real(a), np.real(b)

    def log_density(self, values: Array, x: Array) -> Array:
        """(p - 1) log z + (q - 1) log(1 - z) - log B(p, q) - log w with z = (x - lower)/w."""
        p, q, _ = self._shapes(values)
        lower, upper = self.box
        width = upper - lower
        z, rest = (np.maximum(part, 0.0) / width for part in (x - lower, upper - x))
        inside = (x >= lower) & (x <= upper)
        return np.where(inside, _log_density(p, q, z, rest) - math.log(width), -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """Phi^-1 of the regularized incomplete beta function."""
        p, q, _ = self._shapes(values)
        lower, upper = self.box
        z, rest = (np.clip(part / (upper - lower), 0.0, 1.0) for part in (x - lower, upper - x))
        return to_score(special.betainc(p, q, z), special.betainc(q, p, rest))

    def quantile(self, values: Array, probability: Array) -> Array:
        """lower + w I^-1(p, q, probability), I the regularized incomplete beta function."""
        p, q, _ = self._shapes(values)
        lower, upper = self.box
        width = upper - lower
        x = from_probability(
            probability,
            lambda u: lower + width * special.betaincinv(p, q, u),
            lambda v: upper - width * special.betaincinv(q, p, v),
        )
        return np.clip(x, lower, upper)

    def standard(self, values: Array, theta: Array) -> Standard:
        """The quantile at Phi(theta); its derivatives by the shapes are differences (1e-8)."""
        p, q, jac = self._shapes(values)
        lower, upper = self.box
        width = upper - lower
        z, rest = _standard_beta(p, q, theta), _standard_beta(q, p, -theta)
        log_density = _log_density(p, q, z, rest) - math.log(width)
        by_p = difference(lambda v: _standard_beta(v, q, theta), p)
        by_q = difference(lambda v: _standard_beta(p, v, theta), q)
        x = np.where(theta < 0.0, lower + width * z, upper - width * rest)
        by_mean, by_sd = (width * (by_p * dp + by_q * dq) for dp, dq in jac.swapaxes(0, 1))
        dvalues = np.stack([by_mean, by_sd], axis=-1)
        return Standard(np.clip(x, lower, upper), slope(theta, log_density), dvalues)

    def _shapes(self, values: Array) -> tuple[Array, Array, Array]:
        """p, q and their derivatives (2, 2, ...) by mean and sd."""
        lower, upper = self.box
        width = upper - lower
        m, v = (values[0] - lower) / width, (values[1] / width) ** 2
        s = m * (1.0 - m) / v - 1.0
        by_mean, by_sd = (1.0 - 2.0 * m) / (v * width), -2.0 * (s + 1.0) / values[1]
        dp = [m * by_mean + s / width, m * by_sd]
        dq = [(1.0 - m) * by_mean - s / width, (1.0 - m) * by_sd]
        jac = np.stack([np.broadcast_arrays(*d) for d in (dp, dq)])
        return m * s, (1.0 - m) * s, jac


def _log_density(p: Array, q: Array, z: Array, rest: Array) -> Array:
    """log f of z on [0, 1] with rest = 1 - z; infinite at an end whose shape is below 1."""
    with np.errstate(divide="ignore"):
        powers = special.xlogy(p - 1.0, z) + special.xlogy(q - 1.0, rest)
    log_density: Array = powers - special.betaln(p, q)
    return log_density


def _standard_beta(p: Array, q: Array, theta: Array) -> Array:
    """The beta law on [0, 1] at Phi(theta); of one law many by interpolation of its logit."""
    if np.ndim(p) == 0 and theta.size >= MANY and np.max(np.abs(theta)) < FARTHEST:
        table = _table(float(p), float(q))
        if table.finite:
            return np.asarray(special.expit(table(theta)))
    return _exactly(p, q, theta)


def _exactly(p: Array | float, q: Array | float, theta: Array) -> Array:
    return from_tails(
        theta,
        lambda u, p, q: special.betaincinv(p, q, u),
        lambda v, p, q: special.betainccinv(p, q, v),
        np.asarray(p),
        np.asarray(q),
    )


@lru_cache(maxsize=256)
def _table(p: float, q: float) -> Tabulated:
    """log z/(1 - z) of the standard normal variate, with its slope phi/(f z (1 - z))."""
    theta = Tabulated.knots()
    with np.errstate(all="ignore"):
        low, high = np.log(_exactly(p, q, theta)), np.log(_exactly(q, p, -theta))
        density = p * low + q * high - special.betaln(p, q)
        return Tabulated(low - high, slope(theta, density))
