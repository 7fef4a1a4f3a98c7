"""Any continuous distribution of SciPy as a law."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from aleator.core.types import Array
from aleator.errors import InputsError, naming
from aleator.laws.hyperparameter import (
    Hyperparameter,
    Specification,
    filled,
    location_and_scale,
)
from aleator.laws.law import (
    NUMERICS,
    MeanSd,
    Standard,
    ThroughNormal,
    from_probability,
    from_tails,
    slope,
    to_score,
)


@dataclass(frozen=True)
class ScipyLaw(ThroughNormal):
    """The law of a frozen continuous distribution T of `scipy.stats`, possibly shifted and scaled.

    If neither `mean` nor `sd` is stated, x = T: a known law without hyperparameters. Otherwise
    x = mean + sd (T - E T)/sd(T). Each of `mean` and `sd` is then a number (known), `Free`
    (identified), or left out (that of T); the shape of T does not change. Default limits of the sd
    are 1/1000 and 1/2 of the width of the mean's limits.

    The law uses Hermite polynomials of theta, where T = F^-1(Phi(theta)). A rule of q nodes is
    exact for polynomials of theta and converges to the moments of T. Raises InputsError for an
    object that is not a frozen continuous distribution, and for shapes without mean and variance.
    Each value costs a call of SciPy's `ppf`, which for some distributions is a search for each
    number.

    >>> from scipy import stats
    >>> law = ScipyLaw(stats.expon(), mean=2.0)
    >>> law.quantile(np.array([2.0, 1.0]), np.array([0.0, 1.0 - np.exp(-1.0)])).round(6).tolist()
    [1.0, 2.0]
    """

    distribution: Any
    mean: Specification | None = None
    sd: Specification | None = None
    scatters = True

    def __post_init__(self) -> None:
        _require_frozen(self.distribution)
        _require_moments(self.distribution)
        with naming(type(self).__name__):
            _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters `mean` and `sd`, or none for a known law."""
        if self.mean is None and self.sd is None:
            return ()
        own = _moments(self.distribution)
        return location_and_scale(
            own[0] if self.mean is None else self.mean, own[1] if self.sd is None else self.sd
        )

    @cached_property
    def box(self) -> tuple[float, float]:
        """The widest support that the limits admit; an infinite end becomes a 1e-15 quantile."""
        lower, upper = _ends(self.distribution)
        if math.isinf(lower):
            lower = float(self.distribution.ppf(NUMERICS.tail))
        if math.isinf(upper):
            upper = float(self.distribution.isf(NUMERICS.tail))
        if not self.hyperparameters:
            return lower, upper
        (mean, sd), own = self.hyperparameters, _moments(self.distribution)
        reach = sd.upper / own[1]
        return mean.lower - (own[0] - lower) * reach, mean.upper + (upper - own[0]) * reach

    @property
    def bounded(self) -> bool:
        """Whether the law is known and has finite ends, which are then its `box`."""
        lower, upper = _ends(self.distribution)
        return math.isfinite(upper - lower) and all(h.is_number for h in self.hyperparameters)

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density of the shifted and scaled T at x."""
        at, scale = self._back(values, x)
        return np.asarray(np.asarray(self.distribution.logpdf(at)) - math.log(scale))

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score Phi^-1(F(x)), to the accuracy of SciPy's distribution function F."""
        at, _ = self._back(values, x)
        return to_score(self.distribution.cdf(at), self.distribution.sf(at))

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile of the shifted and scaled T."""
        p = np.asarray(probability, dtype=float)
        t = from_probability(p, self._shape.ppf, self._shape.isf)
        return self._moved(values, _standardized(self._shape, t))[0]

    def standard(self, values: Array, theta: Array) -> Standard:
        """The quantile of the shifted and scaled T at Phi(theta), to SciPy's accuracy."""
        t = from_tails(np.asarray(theta, dtype=float), self._shape.ppf, self._shape.isf)
        x, dx = self._moved(values, _standardized(self._shape, t))
        with np.errstate(all="ignore"):
            log_density = np.asarray(self._shape.logpdf(t))
        dz = slope(theta, log_density) / _moments(self._shape)[1]
        return Standard(x, (values[1] if values.size else _moments(self.distribution)[1]) * dz, dx)

    def mean_and_sd(self, values: Array) -> MeanSd:
        """The mean and the sd: the two hyperparameters, or for a known law those of T."""
        if not values.size:
            return MeanSd(*_moments(self.distribution), np.empty(0), np.empty(0))
        return MeanSd(float(values[0]), float(values[1]), np.eye(2)[0], np.eye(2)[1])

    def filling(self, center: float, sd: float | None = None) -> Array:
        """The values (mean, sd) moved into their limits; an empty array for a known law."""
        return filled(self.hyperparameters, center, sd) if self.hyperparameters else np.empty(0)

    def customary(self, values: Array) -> Mapping[str, float]:
        """SciPy's loc and scale, with which the distribution has this mean and sd."""
        if not values.size:
            return {}
        mean, sd = _moments(self._shape)
        scale = float(values[1]) / sd
        return {"loc": float(values[0]) - scale * mean, "scale": scale}

    @cached_property
    def _shape(self) -> Any:
        """T without SciPy's loc and scale, so that distances from an end keep their digits."""
        kind, shapes = self.distribution.dist, self.distribution.args
        named = {k: v for k, v in self.distribution.kwds.items() if k not in ("loc", "scale")}
        return kind(*shapes[: kind.numargs], **named)

    def _back(self, values: Array, x: Array) -> tuple[Array, float]:
        """The value of T from which x results by shifting and scaling, and the slope dx/dT."""
        if not values.size:
            return x, 1.0
        mean, sd = _moments(self.distribution)
        scale = float(values[1]) / sd
        return mean + (x - values[0]) / scale, scale

    def _moved(self, values: Array, z: Array) -> tuple[Array, Array]:
        """The parameter x and its derivatives (*z.shape, k) at standardized values z of T."""
        if not values.size:
            mean, sd = _moments(self.distribution)
            # Clipping keeps rounding from moving a value out of the support.
            x = np.clip(mean + sd * z, *_ends(self.distribution))
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


def _ends(distribution: Any) -> tuple[float, float]:
    lower, upper = (float(end) for end in distribution.support())
    if math.isnan(lower) or math.isnan(upper):
        raise InputsError(
            f"'{distribution.dist.name}' has no such shape or scale",
            "correct the numbers given to SciPy",
        )
    return lower, upper


def _require_moments(distribution: Any) -> None:
    """Raise InputsError where the shape is not admissible, or has no mean or variance."""
    _ends(distribution)
    mean, sd = _moments(distribution)
    if not (math.isfinite(mean) and math.isfinite(sd) and sd > 0.0):
        raise InputsError(
            f"'{distribution.dist.name}' with this shape has no finite mean and variance",
            "a law needs moments; truncate it, or take a law with lighter tails",
        )


@lru_cache(maxsize=64)
def _moments(distribution: Any) -> tuple[float, float]:
    """The mean and the sd of the distribution, which SciPy may compute by integration."""
    return float(distribution.mean()), float(distribution.std())


def _standardized(shape: Any, t: Array) -> Array:
    mean, sd = _moments(shape)
    return np.asarray((t - mean) / sd)
