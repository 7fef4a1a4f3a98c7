"""The normal law truncated to the feasible box: its own polynomials, and the paper's clip."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from scipy import special

from aleator.core.polynomials import gauss, gauss_legendre, stieltjes
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws.hyperparameter import LIMITS, OPEN, Hyperparameter, Specification, filled, resolve
from aleator.laws.law import MeanSd, Rule, Standard, ThroughNormal, normal_log_density


@dataclass(frozen=True)
class Truncation:
    """How a truncated normal law is computed; chosen by tests/laws/test_laws.py.

    sds: that the box spans where its end is infinite: holds the nodes to q = 20. drop: the density
    is cut where it is e^-drop times its largest value on the box; beyond, the square of a
    polynomial of degree 20 adds nothing to its integral. nodes: of the rule that its polynomials
    are made by. step: of the differences of a rule, over the width of the law. least: smaller
    probabilities are computed by their logarithms. faint: a difference of two probabilities below
    this has lost too many digits.
    """

    sds: float = 10.0
    drop: float = 150.0
    nodes: int = 200
    step: float = 1e-4
    least: float = 1e-280
    faint: float = 1e-5


TRUNCATION = Truncation()


@dataclass(frozen=True)
class TruncatedNormal(ThroughNormal):
    """Normal(mean, sd^2) restricted to [lower, upper] = `box` (paper, sec. uncertainty model).

    f(x) = phi((x - mean)/sd) / (sd (Phi(b) - Phi(a))) with a, b = (box - mean)/sd; `mean` and
    `sd` are those of the normal law before truncation. Each is a number (known) or `Free`
    (identified). Defaults for a finite box of width w: mean within the box, sd within
    [w/1000, w/2]. An end of the box may be infinite if mean and sd have limits of their own.
    `polynomials` chooses the basis: "own" (orthogonal on the truncated density, by Stieltjes;
    converges fastest) or "hermite" (the paper's: Hermite polynomials of theta ~ N(0, 1), which the
    clip maps to x). Raises InputsError for a box or limits that are out of order.

    >>> from aleator.laws import Free
    >>> law = TruncatedNormal(box=(-1.0, 1.0), mean=0.0, sd=Free(0.1, 100.0))
    >>> wide = law.rule(np.array([0.0, 100.0]), 2)     # nearly uniform: Gauss-Legendre nodes
    >>> wide.x.round(4).tolist()
    [-0.5773, 0.5773]
    """

    box_limits: tuple[float, float]
    mean: Specification = OPEN
    sd: Specification = OPEN
    basis: Literal["own", "hermite"] = "own"
    scatters = True

    def __init__(
        self,
        box: tuple[float, float],
        mean: Specification = OPEN,
        sd: Specification = OPEN,
        polynomials: Literal["own", "hermite"] = "own",
    ) -> None:
        try:
            lower, upper = (float(end) for end in box)
        except (TypeError, ValueError):
            raise InputsError(f"box: {box!r} is not two numbers", "write (lower, upper)") from None
        if not lower < upper:
            raise InputsError(f"box: lower {lower} >= upper {upper}", "swap the two numbers")
        if polynomials not in ("own", "hermite"):
            raise InputsError(f"polynomials '{polynomials}' unknown", "use 'own' or 'hermite'")
        object.__setattr__(self, "box_limits", (lower, upper))
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "sd", sd)
        object.__setattr__(self, "basis", polynomials)
        _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`mean` and `sd` of the normal law before truncation."""
        lower, upper = self.box_limits
        width = upper - lower
        finite = math.isfinite(width)
        mean = resolve("mean", self.mean, (lower, upper) if finite else (None, None))
        limits = (LIMITS.sd[0] * width, LIMITS.sd[1] * width) if finite else (None, None)
        return mean, resolve("sd", self.sd, limits, positive=True, least=LIMITS.zero)

    @property
    def box(self) -> tuple[float, float]:
        """The box; an infinite end is put ten standard deviations beyond the mean.

        A mean beyond the other end counts as on it: there the density is largest.
        """
        (lower, upper), (mean, sd) = self.box_limits, self.hyperparameters
        far = TRUNCATION.sds * sd.upper
        return max(lower, min(mean.lower, upper) - far), min(upper, max(mean.upper, lower) + far)

    @property
    def bounded(self) -> bool:
        """Whether both ends of the box are finite."""
        return math.isfinite(self.box_limits[1] - self.box_limits[0])

    def rule(self, values: Array, nodes: int) -> Rule:
        """Gauss rule of the truncated density, or Gauss-Hermite through the clip."""
        own = self.basis == "own"
        return self._own_rule(values, nodes) if own else super().rule(values, nodes)

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """Polynomials orthonormal under the truncated density, or Hermite polynomials of theta."""
        if self.basis == "hermite":
            return super().recurrence(values, count)
        t, weights = _fine_rule(*(np.array(end) for end in self._standard_limits(values)))
        return stieltjes(t, weights, count)

    def log_density(self, values: Array, x: Array) -> Array:
        """log phi(t) - log sd - log(Phi(b) - Phi(a)) with t = (x - mean)/sd, inside the box."""
        lower, upper = self.box_limits
        a, b = self._standard_limits(values)
        t = (x - values[0]) / values[1]
        log_density = normal_log_density(t) - np.log(values[1]) - _log_mass(a, b)
        return np.where((x >= lower) & (x <= upper), log_density, -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """Phi^-1((Phi(t) - Phi(a))/(Phi(b) - Phi(a))), in logarithms where a tail is faint."""
        a, b = self._standard_limits(values)
        t = np.clip((x - values[0]) / values[1], a, b)
        u, v = special.ndtr(t) - special.ndtr(a), special.ndtr(-t) - special.ndtr(-b)
        smaller = np.minimum(u, v)
        faint = smaller < TRUNCATION.faint
        with np.errstate(divide="ignore", invalid="ignore"):
            below = special.ndtri(smaller / np.exp(_log_mass(a, b)))
        score = np.where(u < v, below, -below)
        if np.any(faint):
            score[faint] = _faint_score(
                t[faint], *(np.broadcast_to(end, t.shape)[faint] for end in (a, b))
            )
        return np.asarray(score)

    def quantile(self, values: Array, probability: Array) -> Array:
        """mean + sd t with Phi(t) = (1 - u) Phi(a) + u Phi(b)."""
        a, b = self._standard_limits(values)
        t = _truncated_quantile(np.asarray(probability, dtype=float), a, b)
        return self._inside(values, t)

    def standard(self, values: Array, theta: Array) -> Standard:
        """mean + sd t(theta) by the paper's clip."""
        a, b = self._standard_limits(values)
        t, by_a, by_b, by_theta = clip(theta, a, b)
        # sd da = -1 by the mean and -a by the sd; an infinite end does not move, and by_a is zero
        by_mean = 1.0 - by_a - by_b
        by_sd = t - by_a * _finite(a) - by_b * _finite(b)
        dvalues = np.stack([by_mean, by_sd], axis=-1)
        return Standard(self._inside(values, t), values[1] * by_theta, dvalues)

    def mean_and_sd(self, values: Array) -> MeanSd:
        """Mean and sd after truncation, by a Gauss rule that is exact for both."""
        return MeanSd.of(self._own_rule(values, 2))

    def filling(self, center: float, sd: float | None = None) -> Array:
        """The center and the sd as those of the normal law before truncation."""
        return filled(self.hyperparameters, center, sd)

    def _own_rule(self, values: Array, nodes: int) -> Rule:
        a, b = self._standard_limits(values)
        t, weights, by_end = _own_rule(float(a), float(b), nodes)
        da, db = self._limits_jac(values)
        dt = by_end[0][:, :1] * da + by_end[1][:, :1] * db
        dweights = by_end[0][:, 1:] * da + by_end[1][:, 1:] * db
        dx = values[1] * dt + np.stack([np.ones(nodes), t], axis=1)
        return Rule(self._inside(values, t), weights, t, dx, dweights)

    def _inside(self, values: Array, t: Array) -> Array:
        # rounding must not push a node out of the box
        return np.asarray(np.clip(values[0] + values[1] * t, *self.box_limits))

    def _limits_jac(self, values: Array) -> tuple[Array, Array]:
        """d(a, b)/d(mean, sd); an infinite end does not move."""
        a, b = self._standard_limits(values)
        da = np.array([-1.0, -a]) / values[1] if np.isfinite(a) else np.zeros(2)
        db = np.array([-1.0, -b]) / values[1] if np.isfinite(b) else np.zeros(2)
        return da, db

    def _standard_limits(self, values: Array) -> tuple[Array, Array]:
        lower, upper = self.box_limits
        return (lower - values[0]) / values[1], (upper - values[0]) / values[1]


def clip(theta: Array, a: Array | float, b: Array | float) -> tuple[Array, Array, Array, Array]:
    """The paper's clip: t(theta) in [a, b] and its derivatives by a, b and theta.

    Each has the shape of theta, against which a and b broadcast.

    Phi(t) = Phi(a) + Phi(theta) (Phi(b) - Phi(a)), so that
    phi(t) dt = (1 - u) phi(a) da + u phi(b) db + (Phi(b) - Phi(a)) phi(theta) dtheta with
    u = Phi(theta); in logarithms where a tail is so far out that it would leave the numbers.
    """
    tail = special.ndtr(-np.abs(theta))
    u, v = np.where(theta < 0.0, (tail, 1.0 - tail), (1.0 - tail, tail))
    below = v * special.ndtr(a) + u * special.ndtr(b)
    above = v * special.ndtr(np.negative(a)) + u * special.ndtr(np.negative(b))
    smaller = np.minimum(below, above)
    if min(np.min(smaller, initial=1.0), np.min(tail, initial=1.0)) > TRUNCATION.least:
        found = special.ndtri(smaller)
        t = np.clip(np.where(below < above, found, -found), a, b)
        by_a, by_b = v * np.exp(0.5 * _apart(t, a)), u * np.exp(0.5 * _apart(t, b))
    else:
        log_u, log_v = special.log_ndtr(theta), special.log_ndtr(-theta)
        t = _truncated_quantile_from_logs(log_u, log_v, a, b)
        by_a, by_b = np.exp(log_v + 0.5 * _apart(t, a)), np.exp(log_u + 0.5 * _apart(t, b))
    by_theta = np.exp(_log_mass(a, b) + 0.5 * (t - theta) * (t + theta))
    return t, by_a, by_b, by_theta


def _apart(t: Array, end: Array | float) -> Array:
    """t^2 - end^2, minus infinity where the end is infinite."""
    near = _finite(end)
    return np.where(np.isfinite(end), (t - near) * (t + near), -np.inf)


def _finite(end: Array | float) -> Array:
    """The end, or zero where it is infinite."""
    return np.where(np.isfinite(end), end, 0.0)


def _log_mass(a: float | Array, b: float | Array) -> Array:
    """log(Phi(b) - Phi(a)), of the tail that keeps its digits."""
    a, b = np.asarray(a), np.asarray(b)
    reflected = a > -b
    outer = special.log_ndtr(np.where(reflected, -a, b))
    inner = special.log_ndtr(np.where(reflected, -b, a))
    with np.errstate(divide="ignore"):
        mass: Array = outer + np.log(-np.expm1(inner - outer))
    return mass


def _faint_score(t: Array, a: Array, b: Array) -> Array:
    """The normal score of t in [a, b] by logarithms: far tails keep digits."""
    log_u, log_v = _log_mass(a, t) - _log_mass(a, b), _log_mass(t, b) - _log_mass(a, b)
    below, above = special.ndtri_exp(np.minimum([log_u, log_v], 0.0))
    return np.asarray(np.where(log_u < log_v, below, -above))


def _truncated_quantile(u: Array, a: Array, b: Array) -> Array:
    with np.errstate(divide="ignore"):
        return _truncated_quantile_from_logs(np.log(u), np.log1p(-u), a, b)


def _truncated_quantile_from_logs(
    log_u: Array, log_v: Array, a: Array | float, b: Array | float
) -> Array:
    """Solve Phi(t) = (1 - u) Phi(a) + u Phi(b) from log u and log(1 - u)."""
    # upper tails lose digits, lower tails do not: reflect
    reflected = np.greater(a, np.negative(b))
    low, high = np.where(reflected, np.negative(b), a), np.where(reflected, np.negative(a), b)
    log_low, log_high = np.where(reflected, (log_u, log_v), (log_v, log_u))
    log_cdf = np.logaddexp(log_low + special.log_ndtr(low), log_high + special.log_ndtr(high))
    t = np.clip(special.ndtri_exp(np.minimum(log_cdf, 0.0)), low, high)
    return np.asarray(np.where(reflected, -t, t))


def _effective_limits(a: Array, b: Array) -> tuple[Array, Array]:
    """The part of [a, b] where exp(-t^2/2) is within e^-DROP of its largest value there."""
    peak = np.clip(0.0, a, b)
    reach = np.sqrt(peak**2 + 2.0 * TRUNCATION.drop)
    return np.maximum(a, -reach), np.minimum(b, reach)


def _fine_rule(a: Array, b: Array) -> tuple[Array, Array]:
    """Gauss-Legendre points (..., Q) on [a, b] weighted by the truncated normal density."""
    low, high = _effective_limits(a, b)
    s, w = gauss_legendre(TRUNCATION.nodes)
    half = 0.5 * (high - low)[..., None]
    t = 0.5 * (high + low)[..., None] + half * s
    peak = np.clip(0.0, low, high)[..., None]
    weights = w * np.exp(-0.5 * (t - peak) * (t + peak))
    return t, weights / weights.sum(axis=-1, keepdims=True)


@lru_cache(maxsize=64)
def _own_rule(a: float, b: float, nodes: int) -> tuple[Array, Array, tuple[Array, Array]]:
    """Gauss rule of the truncated normal, and d(nodes, weights)/da and /db as (q, 2) each.

    The derivatives are central differences of the rule itself, which is accurate to rounding:
    with a step h of 1e-4 of the effective width their error is of the order of 1e-9.
    """
    low, high = _effective_limits(np.array(a), np.array(b))
    h = TRUNCATION.step * min(1.0, float(high - low))
    ends_a = np.array([a, a + h, a - h, a, a])
    ends_b = np.array([b, b, b, b + h, b - h])
    t, weights = gauss(*stieltjes(*_fine_rule(ends_a, ends_b), nodes))
    rules = np.stack([t, weights], axis=-1)
    by_a, by_b = (rules[1] - rules[2]) / (2 * h), (rules[3] - rules[4]) / (2 * h)
    # where one law moves, as in differences, those of the others are needed again
    for array in (rules, t, weights, by_a, by_b):
        array.setflags(write=False)
    return t[0], weights[0], (by_a, by_b)
