"""Any continuous distribution of SciPy as a law, with polynomials of its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from aleator.errors import InputsError
from aleator.laws.discretized import Support, discretize
from aleator.laws.hyperparameter import Hyperparameter, Specification, about, location_and_scale
from aleator.laws.law import (
    MeanSd,
    Rule,
    Standard,
    Tail,
    from_probability,
    from_tails,
    slope,
    to_score,
)
from aleator.polynomials.gauss import gauss
from aleator.polynomials.recurrence import stieltjes
from aleator.types import Array

FAR = 1e-15
"""Probability left beyond an open end of the box."""
AGREE = 1e-5
"""Distance of mass, mean and variance of a density from one and from what SciPy says."""
LEVELS = (230.0, 460.0)
"""Falls of the log-density below its value in the middle between which a tail is measured."""
SLACK = 0.96
"""Share of the critical exponent that a tail must have; prefactors hide some of it."""


@dataclass(frozen=True)
class ScipyLaw:
    """The law of a frozen continuous distribution of `scipy.stats`, known or moved and scaled.

    With T the distribution, x = T where neither `mean` nor `sd` is given: a known law without a
    hyperparameter. Else x = mean + sd (T - E T)/sd T, and each of `mean` and `sd` is a number
    (known; T's own where left out) or `Free` (identified); the shape of T stays. An sd limit left
    open becomes a thousandth and a half of the width of the mean's limits.

    Its polynomials are orthonormal on the density, by the Stieltjes procedure on a composite
    Gauss-Legendre rule (Gautschi, Orthogonal Polynomials, 2004, sec. 2.2); they are computed once
    (some 10 ms), for they are those of T. Raises InputsError for what is not a frozen continuous
    distribution, for shapes without mean and variance, for tails so heavy that the moments do not
    determine the law (Krein's condition: slower than exp(-|x|) on both sides, or than exp(-sqrt(x))
    on one), and where the density does not integrate to one. Samples cost what SciPy's `ppf` costs,
    which for some distributions is a search for each number.

    >>> from scipy import stats
    >>> law = ScipyLaw(stats.expon())
    >>> law.rule(np.empty(0), 2).x.round(6).tolist()             # Gauss-Laguerre: 2 -+ sqrt(2)
    [0.585786, 3.414214]
    """

    distribution: Any
    mean: Specification | None = None
    sd: Specification | None = None

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        _require_frozen(self.distribution)
        _ = self._own, self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """`mean` and `sd`, or none for a known law."""
        if self.mean is None and self.sd is None:
            return ()
        own = self._own
        return location_and_scale(
            own.mean if self.mean is None else self.mean, own.sd if self.sd is None else self.sd
        )

    @cached_property
    def box(self) -> tuple[float, float]:
        """The widest support that the limits admit; an open end is put where 1e-15 is left.

        Far nodes of a rule may lie beyond an open end.
        """
        lower, upper = self._own.lower, self._own.upper
        if math.isinf(lower):
            lower = float(self.distribution.ppf(FAR))
        if math.isinf(upper):
            upper = float(self.distribution.isf(FAR))
        if not self.hyperparameters:
            return lower, upper
        mean, sd = self.hyperparameters
        reach = sd.upper / self._own.sd
        below, above = self._own.mean - lower, upper - self._own.mean
        return mean.lower - below * reach, mean.upper + above * reach

    @property
    def bounded(self) -> bool:
        """Whether the law is known and has finite ends: they are then the box."""
        finite = math.isfinite(self._own.upper - self._own.lower)
        return finite and not any(h.free for h in self.hyperparameters)

    @property
    def scatters(self) -> bool:
        """The parameter varies between experiments."""
        return True

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss rule of T, moved and scaled; the weights do not depend on alpha."""
        z, weights = gauss(*_recurrence(self._shape, nodes))
        x, dx = self._moved(values, z)
        return Rule(x, weights, z, dx, np.zeros(dx.shape))

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:  # noqa: ARG002
        """Polynomials of (T - E T)/sd T, orthonormal under its density."""
        return _recurrence(self._shape, count)

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density of T, moved and scaled."""
        at, scale = self._back(values, x)
        log_density: Array = np.asarray(self.distribution.logpdf(at)) - math.log(scale)
        return log_density

    def normal_score(self, values: Array, x: Array) -> Array:
        """Phi^-1 of T's distribution function; digits as SciPy has them."""
        at, _ = self._back(values, x)
        return to_score(self.distribution.cdf(at), self.distribution.sf(at))

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile of T, moved and scaled."""
        return self._moved(values, self._standardized(probability, from_probability))[0]

    def standard(self, values: Array, theta: Array) -> Standard:
        """The quantile of T at Phi(theta), moved and scaled; digits as SciPy has them."""
        z = self._standardized(theta, from_tails)
        x, dx = self._moved(values, z)
        shape = _support(self._shape)
        with np.errstate(all="ignore"):
            log_density = np.asarray(self._shape.logpdf(shape.mean + shape.sd * z))
        dz = slope(theta, log_density) / shape.sd
        return Standard(x, (values[1] if values.size else self._own.sd) * dz, dx)

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The two hyperparameters, or T's own mean and sd."""
        if not values.size:
            return MeanSd(self._own.mean, self._own.sd, np.empty(0), np.empty(0))
        return MeanSd(float(values[0]), float(values[1]), np.eye(2)[0], np.eye(2)[1])

    def filling(self, center: float, sd: float | None = None) -> Array:
        """The center and the sd, within their limits; nothing for a known law."""
        return about(self.hyperparameters, center, sd) if self.hyperparameters else np.empty(0)

    @cached_property
    def _shape(self) -> Any:
        """T without SciPy's loc and scale, in which distances from an end keep their digits."""
        kind, shapes = self.distribution.dist, self.distribution.args
        named = {k: v for k, v in self.distribution.kwds.items() if k not in ("loc", "scale")}
        return kind(*shapes[: kind.numargs], **named)

    @cached_property
    def _own(self) -> Support:
        """Ends, mean and sd of T."""
        lower, upper = _ends(self.distribution)
        standard = _support(self._shape)
        scale = float(self.distribution.std()) / float(self._shape.std())
        loc = float(self.distribution.mean()) - scale * float(self._shape.mean())
        return Support(lower, upper, loc + scale * standard.mean, scale * standard.sd)

    def _standardized(self, at: Array, by: Callable[[Array, Tail, Tail], Array]) -> Array:
        shape = _support(self._shape)
        t: Array = by(np.asarray(at, dtype=float), self._shape.ppf, self._shape.isf)
        return (t - shape.mean) / shape.sd

    def _back(self, values: Array, x: Array) -> tuple[Array, float]:
        """The value of T that x is made of, and dx/dT."""
        if not values.size:
            return x, 1.0
        scale = float(values[1]) / self._own.sd
        return self._own.mean + (x - values[0]) / scale, scale

    def _moved(self, values: Array, z: Array) -> tuple[Array, Array]:
        """x and its derivatives (*z.shape, k) at standardized points z."""
        if not values.size:
            # rounding must not push a node out of the support
            x = np.clip(self._own.mean + self._own.sd * z, self._own.lower, self._own.upper)
            return x, np.empty((*z.shape, 0))
        return values[0] + values[1] * z, np.stack([np.ones(z.shape), z], axis=-1)


def _require_frozen(distribution: Any) -> None:
    kind = getattr(distribution, "dist", None)
    if kind is None or not all(hasattr(distribution, name) for name in ("ppf", "isf", "mean")):
        raise InputsError(
            f"{distribution!r} is not a frozen distribution of scipy.stats",
            "give its shapes, as in ScipyLaw(scipy.stats.weibull_min(2.0, scale=3.0))",
        )
    if not hasattr(kind, "logpdf"):
        raise InputsError(
            f"'{kind.name}' is a discrete distribution", "a parameter needs a continuous law"
        )
    if kind.name == "lognorm":
        raise InputsError(
            "the moments of a lognormal law do not determine it, nor a basis", "use LogNormal"
        )


def _ends(distribution: Any) -> tuple[float, float]:
    lower, upper = (float(end) for end in distribution.support())
    if math.isnan(lower) or math.isnan(upper):
        raise InputsError(
            f"'{distribution.dist.name}' has no such shape or scale",
            "correct the numbers given to SciPy",
        )
    return lower, upper


@lru_cache(maxsize=64)
def _support(shape: Any) -> Support:
    """Ends, mean and sd; raises InputsError where there are none, or a tail is too heavy."""
    name = shape.dist.name
    lower, upper = _ends(shape)
    mean, sd = float(shape.mean()), float(shape.std())
    if not (math.isfinite(mean) and math.isfinite(sd) and sd > 0.0):
        raise InputsError(
            f"'{name}' with this shape has no finite mean and variance",
            "a law needs moments; truncate it, or take a law with lighter tails",
        )
    support = Support(lower, upper, mean, sd)
    tails = [(-1.0, lower), (1.0, upper)]
    exponents = [_tail_exponent(shape, support, sign) for sign, end in tails if math.isinf(end)]
    if exponents and max(exponents) < SLACK * 0.5 * len(exponents):
        raise InputsError(
            f"the tails of '{name}' with this shape are so heavy that its moments do not exist "
            "or do not determine it, nor a basis",
            "use LogNormal, or a law with lighter tails (weibull_min needs c >= 0.5)",
        )
    z, weights = _points(shape, support, 4)
    mass, first, second = (float(weights @ z**power) for power in (0, 1, 2))
    if max(abs(mass - 1.0), abs(first), abs(second - 1.0)) > AGREE:
        raise InputsError(
            f"the density of '{name}' has mass {mass:.6g}, and its mean is {first:.2g} sd and its "
            f"variance {second:.6g} times what SciPy says of them",
            "use another form of this law",
        )
    # the moments of the density itself, which SciPy may know to few digits only
    return replace(support, mean=mean + sd * first, sd=sd * math.sqrt(second - first**2))


def _tail_exponent(shape: Any, support: Support, sign: float) -> float:
    """r of a tail like exp(-|x|^r), from where the log-density fell by two levels."""
    distance = support.sd * np.exp(np.arange(-10.0, 80.0, 0.01))
    with np.errstate(all="ignore"):
        fall = -np.asarray(shape.logpdf(support.mean + sign * distance), dtype=float)
    fall = fall - np.min(fall)
    reached = [distance[np.argmax(fall > level)] for level in LEVELS if np.any(fall > level)]
    if len(reached) < len(LEVELS):
        return 0.0
    steps = math.log(reached[1] / reached[0])
    return math.log(LEVELS[1] / LEVELS[0]) / max(steps, 1e-3)


def _points(shape: Any, support: Support, degree: int) -> tuple[Array, Array]:
    """Standardized points and weights of the whole mass.

    What is next to a finite end is one point at its mean, that of a density d^(r-1) in the distance
    d: r/(r + 1) of the way.
    """
    with np.errstate(all="ignore"):
        z, weights = discretize(support, shape.logpdf, degree)
        for end, near in support.near_ends():
            mass = shape.cdf(near) if end == support.lower else shape.sf(near)
            if mass > 0.0:
                power = shape.pdf(near) * abs(near - end) / mass
                at = end + (near - end) * power / (power + 1.0)
                z = np.append(z, (at - support.mean) / support.sd)
                weights = np.append(weights, mass)
    return z, weights


@lru_cache(maxsize=256)
def _recurrence(shape: Any, count: int) -> tuple[Array, Array]:
    """Recurrence coefficients (count,) of (T - E T)/sd T, read-only."""
    z, weights = _points(shape, _support(shape), 2 * count)
    a, b = stieltjes(z, weights / weights.sum(), count)
    a.setflags(write=False)
    b.setflags(write=False)
    return a, b
