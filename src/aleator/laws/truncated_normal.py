"""The normal law truncated to an interval, with its own orthogonal polynomials.

The module also has the paper's "clip": the map from a standard normal variate to the law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from scipy import special

from aleator.core.polynomials import gauss, gauss_legendre, stieltjes
from aleator.core.types import Array
from aleator.errors import InputsError, disordered, naming
from aleator.laws.hyperparameter import LIMITS, OPEN, Hyperparameter, Specification, filled, resolve
from aleator.laws.law import MeanSd, Rule, Standard, ThroughNormal, normal_log_density


@dataclass(frozen=True)
class Truncation:
    """Settings for the truncated normal law; chosen by tests/laws/test_laws.py.

    sds: an infinite end of the interval is replaced by one this number of standard deviations
    beyond the mean, which contains the nodes of rules up to q = 20. drop: the density is cut where
    it is below e^-drop of its largest value; beyond that the square of a polynomial of degree 20
    adds nothing to an integral. nodes: the number of nodes of the fine rule from which the
    orthogonal polynomials are computed. step: the step of numerical derivatives of a rule, relative
    to the width of the law. least: probabilities smaller than this are computed as logarithms.
    faint: a difference of two probabilities that is below this has lost too many digits and is
    computed by logarithms.
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

    f(x) = phi((x - mean)/sd) / (sd (Phi(b) - Phi(a))) with a = (lower - mean)/sd and
    b = (upper - mean)/sd. `mean` and `sd` are those of the normal law before truncation. Each is a
    number (known) or `Free` (identified). The default limits for a finite interval of width w are
    the interval for the mean and [w/1000, w/2] for the sd. An end of the interval may be infinite
    if the limits of mean and sd are stated. `polynomials` chooses the basis: "own" (orthogonal
    under the truncated density, by the Stieltjes procedure; converges fastest) or "hermite" (the
    paper's: Hermite polynomials of theta ~ N(0, 1), which is mapped to x). Raises InputsError for a
    `box` or limits that are out of order.

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
            problem, remedy = disordered(lower, upper)
            raise InputsError(f"box: {problem}", remedy)
        if polynomials not in ("own", "hermite"):
            raise InputsError(f"polynomials '{polynomials}' unknown", "use 'own' or 'hermite'")
        object.__setattr__(self, "box_limits", (lower, upper))
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "sd", sd)
        object.__setattr__(self, "basis", polynomials)
        with naming(type(self).__name__):
            _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters `mean` and `sd` of the normal law before truncation."""
        lower, upper = self.box_limits
        width = upper - lower
        finite = math.isfinite(width)
        mean = resolve("mean", self.mean, (lower, upper) if finite else (None, None))
        limits = (LIMITS.sd[0] * width, LIMITS.sd[1] * width) if finite else (None, None)
        return mean, resolve("sd", self.sd, limits, positive=True, least=LIMITS.zero)

    @property
    def box(self) -> tuple[float, float]:
        """The interval; an infinite end is replaced by one ten standard deviations beyond the mean.

        A mean beyond the other end counts as lying on it, because the density is largest there.
        """
        (lower, upper), (mean, sd) = self.box_limits, self.hyperparameters
        far = TRUNCATION.sds * sd.upper
        return max(lower, min(mean.lower, upper) - far), min(upper, max(mean.upper, lower) + far)

    @property
    def bounded(self) -> bool:
        """Whether both ends of the interval are finite."""
        return math.isfinite(self.box_limits[1] - self.box_limits[0])

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss rule of the truncated density, or the Gauss-Hermite rule mapped to x."""
        own = self.basis == "own"
        return self._own_rule(values, nodes) if own else super().rule(values, nodes)

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """The recurrence coefficients of the chosen orthonormal polynomials.

        They are orthonormal under the truncated density, or are Hermite polynomials of theta.
        """
        if self.basis == "hermite":
            return super().recurrence(values, count)
        t, weights = _fine_rule(*(np.array(end) for end in self._standard_limits(values)))
        return stieltjes(t, weights, count)

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density log phi(t) - log sd - log(Phi(b) - Phi(a)) with t = (x - mean)/sd.

        It is minus infinity outside the interval.
        """
        lower, upper = self.box_limits
        a, b = self._standard_limits(values)
        t = (x - values[0]) / values[1]
        log_density = normal_log_density(t) - np.log(values[1]) - _log_mass(a, b)
        return np.where((x >= lower) & (x <= upper), log_density, -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score Phi^-1((Phi(t) - Phi(a))/(Phi(b) - Phi(a))), t = (x - mean)/sd.

        It is computed with logarithms where a tail probability is very small.
        """
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
        """The quantile mean + sd t at probability u, with Phi(t) = (1 - u) Phi(a) + u Phi(b)."""
        a, b = self._standard_limits(values)
        t = _truncated_quantile(np.asarray(probability, dtype=float), a, b)
        return self._inside(values, t)

    def standard(self, values: Array, theta: Array) -> Standard:
        """The parameter x = mean + sd t(theta), with derivatives; t(theta) is given by `clip`."""
        a, b = self._standard_limits(values)
        t, by_a, by_b, by_theta = clip(theta, a, b)
        # The derivative of a, times sd, is -1 by the mean and -a by the sd. An infinite end does
        # not move, and by_a is then zero.
        by_mean = 1.0 - by_a - by_b
        by_sd = t - by_a * _finite(a) - by_b * _finite(b)
        dvalues = np.stack([by_mean, by_sd], axis=-1)
        return Standard(self._inside(values, t), values[1] * by_theta, dvalues)

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The mean and the sd after truncation, by a Gauss rule that is exact for both."""
        return MeanSd.of(self._own_rule(values, 2))

    def filling(self, center: float, sd: float | None = None) -> Array:
        """The values (mean, sd) of the normal law before truncation, moved into their limits."""
        return filled(self.hyperparameters, center, sd)

    def customary(self, values: Array) -> Mapping[str, float]:  # noqa: ARG002
        """None: the law is told by the normal law before truncation."""
        return {}

    def _own_rule(self, values: Array, nodes: int) -> Rule:
        a, b = self._standard_limits(values)
        t, weights, by_end = _own_rule(float(a), float(b), nodes)
        da, db = self._limits_jac(values)
        dt = by_end[0][:, :1] * da + by_end[1][:, :1] * db
        dweights = by_end[0][:, 1:] * da + by_end[1][:, 1:] * db
        dx = values[1] * dt + np.stack([np.ones(nodes), t], axis=1)
        return Rule(self._inside(values, t), weights, t, dx, dweights)

    def _inside(self, values: Array, t: Array) -> Array:
        # Clipping keeps rounding from moving a node out of the interval.
        return np.asarray(np.clip(values[0] + values[1] * t, *self.box_limits))

    def _limits_jac(self, values: Array) -> tuple[Array, Array]:
        """The derivatives of a (2,) and of b (2,) by mean and sd; zero for an infinite end."""
        a, b = self._standard_limits(values)
        da = np.array([-1.0, -a]) / values[1] if np.isfinite(a) else np.zeros(2)
        db = np.array([-1.0, -b]) / values[1] if np.isfinite(b) else np.zeros(2)
        return da, db

    def _standard_limits(self, values: Array) -> tuple[Array, Array]:
        lower, upper = self.box_limits
        return (lower - values[0]) / values[1], (upper - values[0]) / values[1]


def clip(theta: Array, a: Array | float, b: Array | float) -> tuple[Array, Array, Array, Array]:
    """The map t(theta) of a normal variate to [a, b] (the paper's clip), with derivatives.

    Returns t and its derivatives by a, b and theta. Each has the shape of theta, against which a
    and b broadcast. Phi(t) = Phi(a) + Phi(theta) (Phi(b) - Phi(a)), so that with u = Phi(theta)
    phi(t) dt = (1 - u) phi(a) da + u phi(b) db + (Phi(b) - Phi(a)) phi(theta) dtheta.
    Probabilities too small for floating-point numbers are computed as logarithms.
    """
    tail = special.ndtr(-np.abs(theta))
    rest, negative = 1.0 - tail, theta < 0.0
    u, v = np.where(negative, tail, rest), np.where(negative, rest, tail)
    below = v * special.ndtr(a) + u * special.ndtr(b)
    above = v * special.ndtr(np.negative(a)) + u * special.ndtr(np.negative(b))
    smaller = np.minimum(below, above)
    if min(smaller.min(initial=1.0), tail.min(initial=1.0)) > TRUNCATION.least:
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
    """The difference t^2 - end^2, which is minus infinity where the end is infinite."""
    if np.ndim(end) == 0:
        return (t - end) * (t + end) if np.isfinite(end) else np.full_like(t, -np.inf)
    near = _finite(end)
    return np.where(np.isfinite(end), (t - near) * (t + near), -np.inf)


def _finite(end: Array | float) -> Array:
    """The given end, or zero where the end is infinite."""
    if np.ndim(end) == 0:
        return np.asarray(end if np.isfinite(end) else 0.0)
    return np.where(np.isfinite(end), end, 0.0)


def _log_mass(a: float | Array, b: float | Array) -> Array:
    """The log probability log(Phi(b) - Phi(a)), computed in the tail that keeps its digits."""
    if np.ndim(a) == np.ndim(b) == 0:
        return _log_mass_between(float(a), float(b))
    return _log_masses(np.asarray(a), np.asarray(b))


@lru_cache(maxsize=64)
def _log_mass_between(a: float, b: float) -> Array:
    """The log probability between two ends, which many blocks of experiments ask for in turn."""
    return _log_masses(np.asarray(a), np.asarray(b))


def _log_masses(a: Array, b: Array) -> Array:
    reflected = a > -b
    outer = special.log_ndtr(np.where(reflected, -a, b))
    inner = special.log_ndtr(np.where(reflected, -b, a))
    with np.errstate(divide="ignore"):
        mass: Array = outer + np.log(-np.expm1(inner - outer))
    return mass


def _faint_score(t: Array, a: Array, b: Array) -> Array:
    """The normal score of t in [a, b] by logarithms, which keep their digits in far tails."""
    log_u, log_v = _log_mass(a, t) - _log_mass(a, b), _log_mass(t, b) - _log_mass(a, b)
    below, above = special.ndtri_exp(np.minimum([log_u, log_v], 0.0))
    return np.asarray(np.where(log_u < log_v, below, -above))


def _truncated_quantile(u: Array, a: Array, b: Array) -> Array:
    with np.errstate(divide="ignore"):
        return _truncated_quantile_from_logs(np.log(u), np.log1p(-u), a, b)


def _truncated_quantile_from_logs(
    log_u: Array, log_v: Array, a: Array | float, b: Array | float
) -> Array:
    """The solution t of Phi(t) = (1 - u) Phi(a) + u Phi(b), from log u and log v = log(1 - u)."""
    below = np.logaddexp(log_v + special.log_ndtr(a), log_u + special.log_ndtr(b))
    above = np.logaddexp(
        log_v + special.log_ndtr(np.negative(a)), log_u + special.log_ndtr(np.negative(b))
    )
    # The smaller of the two keeps its digits: each point is sought in its own tail.
    found = special.ndtri_exp(np.minimum(np.minimum(below, above), 0.0))
    return np.asarray(np.clip(np.where(below < above, found, -found), a, b))


def _effective_limits(a: Array, b: Array) -> tuple[Array, Array]:
    """The part of [a, b] where exp(-t^2/2) is at least e^-drop of its largest value there."""
    peak = np.clip(0.0, a, b)
    reach = np.sqrt(peak**2 + 2.0 * TRUNCATION.drop)
    return np.maximum(a, -reach), np.minimum(b, reach)


def _fine_rule(a: Array, b: Array) -> tuple[Array, Array]:
    """Gauss-Legendre points (..., Q) on [a, b] and weights (..., Q) with the truncated density."""
    low, high = _effective_limits(a, b)
    s, w = gauss_legendre(TRUNCATION.nodes)
    half = 0.5 * (high - low)[..., None]
    t = 0.5 * (high + low)[..., None] + half * s
    peak = np.clip(0.0, low, high)[..., None]
    weights = w * np.exp(-0.5 * (t - peak) * (t + peak))
    return t, weights / weights.sum(axis=-1, keepdims=True)


@lru_cache(maxsize=64)
def _own_rule(a: float, b: float, nodes: int) -> tuple[Array, Array, tuple[Array, Array]]:
    """The Gauss rule of the truncated normal law on [a, b], with derivatives by a and by b.

    Each derivative (q, 2) has the columns of nodes and weights. It is a central difference of the
    rule itself, with a step of 1e-4 of the effective width and an error of the order of 1e-9.
    """
    low, high = _effective_limits(np.array(a), np.array(b))
    h = TRUNCATION.step * min(1.0, float(high - low))
    ends_a = np.array([a, a + h, a - h, a, a])
    ends_b = np.array([b, b, b, b + h, b - h])
    t, weights = gauss(*stieltjes(*_fine_rule(ends_a, ends_b), nodes))
    rules = np.stack([t, weights], axis=-1)
    by_a, by_b = (rules[1] - rules[2]) / (2 * h), (rules[3] - rules[4]) / (2 * h)
    # Cached arrays are read-only: the same rule serves again while other laws change.
    for array in (rules, t, weights, by_a, by_b):
        array.setflags(write=False)
    return t[0], weights[0], (by_a, by_b)
