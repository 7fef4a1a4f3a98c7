"""The marginal laws in closed form that scatter: normal, lognormal, uniform, gamma, beta."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from scipy import special

from aleator.core.polynomials import (
    gauss_legendre,
    gauss_with_gradient,
    jacobi_recurrence,
    laguerre_recurrence,
    legendre_recurrence,
    recurrence_with_gradient,
)
from aleator.core.types import Array
from aleator.errors import InputsError, naming
from aleator.laws.hyperparameter import (
    OPEN,
    Hyperparameter,
    Specification,
    location_and_scale,
    require_above,
    resolve,
    widest_above,
)
from aleator.laws.law import (
    NUMERICS,
    ByMeanAndSd,
    Rule,
    Standard,
    Tabulated,
    ThroughNormal,
    difference,
    from_probability,
    from_tails,
    normal_log_density,
    slope,
    to_score,
)


@dataclass(frozen=True)
class Shapes:
    """Settings for the most extreme shapes of laws; chosen by tests/laws.

    narrowest: a lower limit of zero for the sd of a gamma or beta law is replaced by this share of
    the upper limit, so that quantiles keep their digits. widest: the largest sd of a beta law,
    relative to the sd of a law with all its probability on the two ends. lognormal_variation,
    gamma_variation: the largest sd, relative to the distance of the mean from the lower end, for
    which the assumed range of the parameter is large enough (shape 0.2 of a gamma law).
    beta_margin: the default distance of a beta law's mean from the ends, relative to the width of
    its range. beta_sd: default limits of its sd (by judgement); the lower one is the smaller of the
    first number times the width and the second times the largest possible sd, the upper one is the
    third number times the largest possible sd.
    """

    narrowest: float = 1e-3
    widest: float = 0.99
    lognormal_variation: float = 1.0
    gamma_variation: float = 5.0**0.5
    beta_margin: float = 0.1
    beta_sd: tuple[float, float, float] = (1e-3, 0.1, 0.95)


SHAPES = Shapes()


@dataclass(frozen=True)
class Normal(ThroughNormal, ByMeanAndSd):
    """Normal law, x = mean + sd theta with theta ~ N(0, 1) (paper, table of Wiener-Askey).

    `mean` and `sd` are numbers (known) or `Free` (identified). A free mean needs finite limits.
    Default limits of the sd are 1/1000 and 1/2 of the width of the mean's limits. Raises
    InputsError where limits are missing or out of order. The parameter can take any value: where
    the simulator fails beyond some value, use `TruncatedNormal` with its `box`.

    >>> from aleator.laws import Free
    >>> law = Normal(mean=Free(-1.0, 1.0), sd=0.5)
    >>> rule = law.rule(np.array([1.0, 0.5]), 3)
    >>> rule.x.round(6).tolist()
    [0.133975, 1.0, 1.866025]
    """

    mean: Specification = OPEN
    sd: Specification = OPEN

    @property
    def box(self) -> tuple[float, float]:
        """The limits of the mean, widened on both sides by eight of the largest sds."""
        mean, sd = self.hyperparameters
        return mean.lower - NUMERICS.sds * sd.upper, mean.upper + NUMERICS.sds * sd.upper

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density -theta^2/2 - log(sd sqrt(2 pi)) with theta = (x - mean)/sd."""
        return np.asarray(normal_log_density(self.normal_score(values, x)) - np.log(values[1]))

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score (x - mean)/sd."""
        return np.asarray((x - values[0]) / values[1])

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile mean + sd Phi^-1(probability)."""
        theta: Array = special.ndtri(probability)
        return np.asarray(values[0] + values[1] * theta)

    def standard(self, values: Array, theta: Array) -> Standard:
        """The parameter x = mean + sd theta, with derivatives."""
        dvalues = np.ones((*theta.shape, 2))
        dvalues[..., 1] = theta
        return Standard(values[0] + values[1] * theta, np.full(theta.shape, values[1]), dvalues)


@dataclass(frozen=True)
class LogNormal(ThroughNormal, ByMeanAndSd):
    """Lognormal law of x - lower, by the mean and sd of x itself, with Hermite polynomials.

    x = lower + exp(m + s theta), theta ~ N(0, 1), with s^2 = log(1 + c^2), c = sd/(mean - lower),
    and m = log(mean - lower) - s^2/2. Each of `mean` and `sd` is a number (known) or `Free`
    (identified). The mean needs finite limits above `lower`. Default limits of the sd are 1/1000
    and 1/2 of the width of the mean's limits. Raises InputsError where limits are missing, out of
    order, or not above `lower`.

    The orthogonal polynomials are polynomials of theta, not of x. The moments of a lognormal law do
    not determine it (Heyde, 1963), so that an expansion in polynomials of x may converge to a wrong
    result (Ernst, Mugler, Starkloff and Ullmann, 2012). Hence a rule of q nodes is exact for
    polynomials of theta and not of x. With c up to 1 and q = 20 the relative error of the mean and
    the sd is below 1e-7.

    >>> values = np.array([np.e**0.5, np.sqrt(np.e**2 - np.e)])                   # m = 0, s = 1
    >>> law = LogNormal(*values)
    >>> law.quantile(values, special.ndtr(np.array([-1.0, 0.0, 1.0]))).round(6).tolist()
    [0.367879, 1.0, 2.718282]
    """

    mean: Specification = OPEN
    sd: Specification = OPEN
    lower: float = 0.0

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters `mean` and `sd`, which are those of x and not of its logarithm."""
        return require_above(self.lower, location_and_scale(self.mean, self.sd))

    @cached_property
    def box(self) -> tuple[float, float]:
        """The interval from `lower` to the largest x(theta = 8) of laws with sd <= mean - lower.

        Far nodes of a quadrature rule may lie beyond it.
        """
        far = np.array([NUMERICS.sds])
        corners = widest_above(self.lower, self.hyperparameters, SHAPES.lognormal_variation)
        return self.lower, max(float(self.standard(corner, far).x[0]) for corner in corners)

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density log phi(theta) - log(s (x - lower)), theta = (log(x - lower) - m)/s."""
        s = _log_sd(values[1] / (values[0] - self.lower))
        inside = x > self.lower
        above = np.where(inside, x - self.lower, 1.0)
        log_density = normal_log_density(self.normal_score(values, x)) - np.log(s * above)
        return np.where(inside, log_density, -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score (log(x - lower) - m)/s."""
        distance = values[0] - self.lower
        s = _log_sd(values[1] / distance)
        with np.errstate(divide="ignore"):
            logarithm = np.log(np.maximum(x - self.lower, 0.0) / distance)
        return np.asarray(logarithm / s + 0.5 * s)

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile lower + exp(m + s Phi^-1(probability))."""
        s = _log_sd(values[1] / (values[0] - self.lower))
        scale = (values[0] - self.lower) * np.exp(-0.5 * s**2)
        return np.asarray(self.lower + scale * np.exp(s * special.ndtri(probability)))

    def standard(self, values: Array, theta: Array) -> Standard:
        """The parameter x = lower + exp(m + s theta), with derivatives."""
        distance = values[0] - self.lower
        c = values[1] / distance
        s = _log_sd(c)
        share = np.exp(s * (theta - 0.5 * s))
        above = distance * share
        # The chain rule uses d log(x - lower)/ds = theta - s and ds/dc = c/(s (1 + c^2)).
        dvalues = np.empty((*above.shape, 2))
        dvalues[..., 1] = by_sd = share * (theta - s) * (c / (s * (1.0 + c**2)))
        dvalues[..., 0] = share - c * by_sd
        return Standard(self.lower + above, s * above, dvalues)

    def customary(self, values: Array) -> Mapping[str, float]:
        """The median of x, and sdlog = s and the geometric sd e^s of x - lower.

        >>> law = LogNormal(np.e**0.5, np.sqrt(np.e**2 - np.e))                   # m = 0, s = 1
        >>> [round(v, 6) for v in law.customary(np.array([law.mean, law.sd])).values()]
        [1.0, 1.0, 2.718282]
        """
        distance = values[0] - self.lower
        s = float(_log_sd(values[1] / distance))
        median = self.lower + float(distance) * math.exp(-0.5 * s**2)
        return {"median": median, "sdlog": s, "geometric sd": math.exp(s)}


def _log_sd(variation: Array) -> Array:
    """The standard deviation of the logarithm of x, from the coefficient of variation of x."""
    return np.asarray(np.sqrt(np.log1p(variation**2)))


HALF = math.sqrt(3.0)
"""Half the width of a uniform law, in standard deviations."""


@dataclass(frozen=True)
class Uniform(ByMeanAndSd):
    """Uniform law on [mean - sqrt(3) sd, mean + sqrt(3) sd], with Legendre polynomials.

    x = mean + sqrt(3) sd t with t uniform on [-1, 1] (Wiener-Askey table of Xiu and Karniadakis,
    2002). `mean` and `sd` are those of the law; each is a number (known) or `Free` (identified).
    A free mean needs finite limits. Default limits of the sd are 1/1000 and 1/2 of their width.
    `Uniform.between(lower, upper)` is the known law between two ends. Raises InputsError where
    limits or ends are missing or out of order.

    The log-likelihood is not a smooth function of the ends of a uniform law. With little
    measurement noise the identified interval is as narrow as the outermost outcomes allow, and
    standard errors mean little.

    >>> from aleator.laws import Free
    >>> law = Uniform(mean=Free(0.0, 2.0), sd=Free(0.1, 1.0))
    >>> law.rule(np.array([1.0, 1.0 / 3.0**0.5]), 2).x.round(6).tolist()     # on [0, 2]
    [0.42265, 1.57735]
    >>> Uniform.between(0.0, 2.0).quantile(np.array([1.0, 3.0**-0.5]), np.array([0.25])).tolist()
    [0.5]
    """

    mean: Specification = OPEN
    sd: Specification = OPEN
    ends: tuple[float, float] | None = field(default=None, init=False)

    @classmethod
    def between(cls, lower: float, upper: float) -> Uniform:
        """The known uniform law on [lower, upper], with exactly these ends."""
        if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
            raise InputsError(
                f"uniform between {lower} and {upper}", "give two finite numbers, the lower first"
            )
        law = cls(0.5 * (lower + upper), (upper - lower) / (2.0 * HALF))
        object.__setattr__(law, "ends", (float(lower), float(upper)))
        return law

    @property
    def box(self) -> tuple[float, float]:
        """The ends of a law made by `between`; else the widest support that the limits admit."""
        if self.ends is not None:
            return self.ends
        mean, sd = self.hyperparameters
        return mean.lower - HALF * sd.upper, mean.upper + HALF * sd.upper

    @property
    def bounded(self) -> bool:
        """Whether all hyperparameters are known; the support of the law is then its `box`."""
        return all(h.is_number for h in self.hyperparameters)

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss-Legendre rule, whose weights do not depend on alpha."""
        t, weights = gauss_legendre(nodes)
        dx = np.stack([np.ones(nodes), HALF * t], axis=1)
        return Rule(self._at(values, t), weights, t, dx, np.zeros((nodes, 2)))

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:  # noqa: ARG002
        """The recurrence coefficients of the Legendre polynomials of t in [-1, 1]."""
        return legendre_recurrence(count)

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density -log(2 sqrt(3) sd) between the ends, minus infinity elsewhere."""
        lower, upper = self._ends(values)
        return np.where((x >= lower) & (x <= upper), -math.log(upper - lower), -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score Phi^-1((x - lower)/(upper - lower))."""
        lower, upper = self._ends(values)
        width = upper - lower
        below, above = (np.clip(part / width, 0.0, 1.0) for part in (x - lower, upper - x))
        return to_score(below, above)

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile mean + sqrt(3) sd (2 probability - 1)."""
        return self._at(values, 2.0 * np.asarray(probability, dtype=float) - 1.0)

    def standard(self, values: Array, theta: Array) -> Standard:
        """The parameter x = mean + sqrt(3) sd erf(theta/sqrt(2)), with derivatives."""
        t = special.erf(theta / math.sqrt(2.0))
        dtheta = HALF * values[1] * math.sqrt(2.0 / math.pi) * np.exp(-0.5 * theta**2)
        dvalues = np.stack([np.ones(theta.shape), HALF * t], axis=-1)
        return Standard(self._at(values, t), dtheta, dvalues)

    def customary(self, values: Array) -> Mapping[str, float]:
        """The two ends."""
        lower, upper = self._ends(values)
        return {"lower": lower, "upper": upper}

    def _ends(self, values: Array) -> tuple[float, float]:
        if self.ends is not None:
            return self.ends
        half = HALF * float(values[1])
        return float(values[0]) - half, float(values[0]) + half

    def _at(self, values: Array, t: Array) -> Array:
        # Clipping keeps rounding from moving a node out of the range.
        return np.asarray(np.clip(values[0] + HALF * values[1] * t, *self.box))


@dataclass(frozen=True)
class Gamma(ByMeanAndSd):
    """Gamma law of x - lower, by its own mean and sd, with generalized Laguerre polynomials.

    The shape is k = ((mean - lower)/sd)^2 and the scale sd^2/(mean - lower) (Wiener-Askey table of
    Xiu and Karniadakis, 2002); k = 1 is the exponential law, and for large k the law tends to the
    normal one. `mean` and `sd` are those of x; each is a number (known) or `Free` (identified).
    The mean needs finite limits above `lower`. Default limits of the sd are 1/1000 and 1/2 of their
    width. The law was tested for k from 0.2 to 1e6. Raises InputsError where limits are missing,
    out of order, or not above `lower`.

    The density is infinite at `lower` where sd > mean - lower (k < 1). The parameter has no upper
    end: where the simulator fails beyond some value, use `Beta` or `TruncatedNormal`.

    >>> law = Gamma(mean=2.0, sd=1.0, lower=1.0)                # 1 + an exponential law
    >>> rule = law.rule(np.array([2.0, 1.0]), 2)                # Gauss-Laguerre: 2 -+ sqrt(2)
    >>> rule.x.round(6).tolist(), rule.weights.round(6).tolist()
    ([1.585786, 4.414214], [0.853553, 0.146447])
    """

    mean: Specification = OPEN
    sd: Specification = OPEN
    lower: float = 0.0

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters `mean` and `sd` of the law."""
        return require_above(self.lower, location_and_scale(self.mean, self.sd, SHAPES.narrowest))

    @cached_property
    def box(self) -> tuple[float, float]:
        """The interval from `lower` to the largest 1 - 1e-15 quantile of laws with shape >= 0.2.

        Far nodes of a quadrature rule may lie beyond it.
        """
        tail = np.array([1.0 - NUMERICS.tail])
        corners = widest_above(self.lower, self.hyperparameters, SHAPES.gamma_variation)
        return self.lower, max(float(self.quantile(corner, tail)[0]) for corner in corners)

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss-Laguerre rule with nodes mean + sd t_j(c), where c = sd/(mean - lower)."""
        distance = values[0] - self.lower
        c = values[1] / distance
        t, weights, by_t, by_weight = gauss_with_gradient(
            *recurrence_with_gradient(laguerre_recurrence, nodes, [c])
        )
        # The derivative of c is -c/distance by the mean and 1/distance by the sd.
        dc = np.array([-c, 1.0]) / distance
        dx = np.stack([np.ones(nodes), t], axis=1) + values[1] * by_t * dc
        # The maximum keeps rounding from moving a node below the lower end.
        x = np.maximum(values[0] + values[1] * t, self.lower)
        return Rule(x, weights, t, dx, by_weight * dc)

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """The recurrence coefficients of generalized Laguerre polynomials of (x - mean)/sd."""
        a, b = laguerre_recurrence(count, values[1] / (values[0] - self.lower))
        return np.real(a), np.real(b)

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density (k - 1) log g - g - log Gamma(k) - log(scale), g = (x - lower)/scale."""
        k, scale = self._shape_and_scale(values)
        g = (x - self.lower) / scale
        return np.where(g >= 0.0, _log_gamma(k, scale, np.maximum(g, 0.0)), -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score Phi^-1(P), with P the regularized incomplete gamma function."""
        k, scale = self._shape_and_scale(values)
        g = np.maximum(x - self.lower, 0.0) / scale
        return to_score(special.gammainc(k, g), special.gammaincc(k, g))

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile lower + scale P^-1(k, probability), P the incomplete gamma function."""
        k, scale = self._shape_and_scale(values)
        return self.lower + scale * from_probability(
            probability,
            lambda p: special.gammaincinv(k, p),
            lambda p: special.gammainccinv(k, p),
        )

    def standard(self, values: Array, theta: Array) -> Standard:
        """The quantile at Phi(theta), with derivatives.

        The derivative by the shape is numerical, with a relative error of 1e-8.
        """
        k, scale = self._shape_and_scale(values)
        g = _standard_gamma(k, theta)
        c = k**-0.5
        by_c = difference(lambda v: (_standard_gamma(v**-2.0, theta) - v**-2.0) * v, c)
        dvalues = np.stack([1.0 - c**2 * by_c, (g - k) * c + c * by_c], axis=-1)
        return Standard(self.lower + scale * g, slope(theta, _log_gamma(k, scale, g)), dvalues)

    def customary(self, values: Array) -> Mapping[str, float]:
        """The shape k and the scale."""
        shape, scale = self._shape_and_scale(values)
        return {"shape": float(shape), "scale": float(scale)}

    def _shape_and_scale(self, values: Array) -> tuple[Array, Array]:
        distance = values[0] - self.lower
        return (distance / values[1]) ** 2, values[1] ** 2 / distance


def _log_gamma(k: Array, scale: Array, g: Array) -> Array:
    """The log-density at x = lower + scale g with g >= 0; infinite at g = 0 where k < 1."""
    with np.errstate(divide="ignore"):
        power = special.xlogy(k - 1.0, g)
    return np.asarray(power - g - special.gammaln(k) - np.log(scale))


def _standard_gamma(k: Array, theta: Array) -> Array:
    """The quantile at Phi(theta) of the gamma law of shape k and scale 1, exact near zero too."""
    return _at_once(theta, _gamma_table, np.exp, _exact_gamma, k)


def _exact_gamma(k: Array | float, theta: Array) -> Array:
    return from_tails(
        theta,
        lambda p, k: special.gammaincinv(k, p),
        lambda p, k: special.gammainccinv(k, p),
        np.asarray(k),
    )


@lru_cache(maxsize=256)
def _gamma_table(k: float) -> Tabulated:
    """The table of log g as a function of the normal variate, with its slope phi/(f g)."""
    theta = Tabulated.knots()
    with np.errstate(all="ignore"):
        g = _exact_gamma(k, theta)
        return Tabulated(np.log(g), slope(theta, k * np.log(g) - g - special.gammaln(k)))


@dataclass(frozen=True)
class Beta(ByMeanAndSd):
    """Beta law on the interval `box` = (lower, upper), by its own mean and sd.

    Its polynomials are Jacobi polynomials. With the width w of the interval, m = (mean - lower)/w,
    v = (sd/w)^2 and s = m (1 - m)/v - 1, the shapes are p = m s and q = (1 - m) s (Wiener-Askey
    table of Xiu and Karniadakis, 2002). The law is uniform for p = q = 1 and has one peak for
    p, q > 1. Its density is infinite at the lower end where p < 1, at the upper end where q < 1.
    Each of `mean` and `sd` is a number (known) or `Free` (identified).

    A beta law exists where sd < sqrt((mean - lower)(upper - mean)). All laws within the limits must
    exist: the upper limit of the sd must be below 0.99 of this bound at both limits of the mean.
    Otherwise InputsError states the largest possible limit. By default the mean lies within the
    inner 80 % of the interval and the sd between w/1000 and 0.95 of the bound. A mean close to an
    end permits only a small sd: then state limits of both, with a narrow range of the mean.

    >>> law = Beta(box=(0.0, 2.0), mean=1.0, sd=3.0**-0.5)                      # uniform
    >>> law.rule(np.array([1.0, 3.0**-0.5]), 2).x.round(6).tolist()
    [0.42265, 1.57735]
    """

    box: tuple[float, float]
    mean: Specification = OPEN
    sd: Specification = OPEN
    bounded = True

    def __post_init__(self) -> None:
        lower, upper = float(self.box[0]), float(self.box[1])
        if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
            raise InputsError(
                f"box: {lower} to {upper} is no finite interval", "give two numbers in order"
            )
        object.__setattr__(self, "box", (lower, upper))
        with naming(type(self).__name__):
            _ = self.hyperparameters

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters `mean` and `sd` of the law."""
        lower, upper = self.box
        width = upper - lower
        margin = SHAPES.beta_margin * width
        mean = resolve("mean", self.mean, (lower + margin, upper - margin))
        if not lower < mean.lower <= mean.upper < upper:
            raise InputsError(
                f"mean: {mean.lower} to {mean.upper} is not inside the box ({lower}, {upper})",
                "a beta law has its mean strictly inside its box",
            )
        widest = min(math.sqrt((m - lower) * (upper - m)) for m in (mean.lower, mean.upper))
        low, low_share, high_share = SHAPES.beta_sd
        limits = (min(low * width, low_share * widest), high_share * widest)
        sd = resolve("sd", self.sd, limits, positive=True, least=SHAPES.narrowest)
        if sd.upper > SHAPES.widest * widest:
            raise InputsError(
                f"sd: no beta law on ({lower:g}, {upper:g}) has mean {mean.lower:g} to "
                f"{mean.upper:g} and sd {sd.upper:g}",
                f"lower the largest sd to {SHAPES.widest * widest:.4g}, or narrow the limits of "
                "the mean",
            )
        return mean, sd

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss-Jacobi rule with nodes mean + sd t_j(p, q)."""
        p, q, jac = self._shapes(values)
        t, weights, by_t, by_weight = gauss_with_gradient(
            *recurrence_with_gradient(jacobi_recurrence, nodes, [float(p), float(q)])
        )
        dx = np.stack([np.ones(nodes), t], axis=1) + values[1] * by_t @ jac
        # Clipping keeps rounding from moving a node out of the interval.
        x = np.clip(values[0] + values[1] * t, *self.box)
        return Rule(x, weights, t, dx, by_weight @ jac)

    def recurrence(self, values: Array, count: int) -> tuple[Array, Array]:
        """The recurrence coefficients of Jacobi polynomials of (x - mean)/sd."""
        p, q, _ = self._shapes(values)
        a, b = jacobi_recurrence(count, float(p), float(q))
        return np.real(a), np.real(b)

    def log_density(self, values: Array, x: Array) -> Array:
        """The log-density at x, with z = (x - lower)/w.

        It is (p - 1) log z + (q - 1) log(1 - z) - log B(p, q) - log w.
        """
        p, q, _ = self._shapes(values)
        lower, upper = self.box
        width = upper - lower
        z, rest = (np.maximum(part, 0.0) / width for part in (x - lower, upper - x))
        inside = (x >= lower) & (x <= upper)
        return np.where(inside, _log_beta(p, q, z, rest) - math.log(width), -np.inf)

    def normal_score(self, values: Array, x: Array) -> Array:
        """The normal score Phi^-1(I), with I the regularized incomplete beta function."""
        p, q, _ = self._shapes(values)
        lower, upper = self.box
        z, rest = (np.clip(part / (upper - lower), 0.0, 1.0) for part in (x - lower, upper - x))
        return to_score(special.betainc(p, q, z), special.betainc(q, p, rest))

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile lower + w I^-1(p, q, probability), I the incomplete beta function."""
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
        """The quantile at Phi(theta), with derivatives.

        The derivatives by the shapes are numerical, with a relative error of 1e-8.
        """
        p, q, jac = self._shapes(values)
        lower, upper = self.box
        width = upper - lower
        z, rest = _standard_beta(p, q, theta), _standard_beta(q, p, -theta)
        log_density = _log_beta(p, q, z, rest) - math.log(width)
        by_p = difference(lambda v: _standard_beta(v, q, theta), p)
        by_q = difference(lambda v: _standard_beta(p, v, theta), q)
        x = np.where(theta < 0.0, lower + width * z, upper - width * rest)
        by_mean, by_sd = (width * (by_p * dp + by_q * dq) for dp, dq in jac.swapaxes(0, 1))
        dvalues = np.stack([by_mean, by_sd], axis=-1)
        return Standard(np.clip(x, lower, upper), slope(theta, log_density), dvalues)

    def customary(self, values: Array) -> Mapping[str, float]:
        """The shapes p and q, as R calls them: shape1 and shape2."""
        p, q, _ = self._shapes(values)
        return {"shape1": float(p), "shape2": float(q)}

    def _shapes(self, values: Array) -> tuple[Array, Array, Array]:
        """The shapes p and q, and their derivatives (2, 2, ...) by the mean and the sd."""
        lower, upper = self.box
        width = upper - lower
        m, v = (values[0] - lower) / width, (values[1] / width) ** 2
        s = m * (1.0 - m) / v - 1.0
        by_mean, by_sd = (1.0 - 2.0 * m) / (v * width), -2.0 * (s + 1.0) / values[1]
        dp = [m * by_mean + s / width, m * by_sd]
        dq = [(1.0 - m) * by_mean - s / width, (1.0 - m) * by_sd]
        jac = np.stack([np.broadcast_arrays(*d) for d in (dp, dq)])
        return m * s, (1.0 - m) * s, jac


def _log_beta(p: Array, q: Array, z: Array, rest: Array) -> Array:
    """The beta log-density at z in [0, 1], rest = 1 - z; infinite at an end with shape below 1."""
    with np.errstate(divide="ignore"):
        powers = special.xlogy(p - 1.0, z) + special.xlogy(q - 1.0, rest)
    return np.asarray(powers - special.betaln(p, q))


def _standard_beta(p: Array, q: Array, theta: Array) -> Array:
    """The quantile at Phi(theta) of the beta law on [0, 1] with shapes p and q."""
    return _at_once(theta, _beta_table, special.expit, _exact_beta, p, q)


def _exact_beta(p: Array | float, q: Array | float, theta: Array) -> Array:
    return from_tails(
        theta,
        lambda u, p, q: special.betaincinv(p, q, u),
        lambda v, p, q: special.betainccinv(p, q, v),
        np.asarray(p),
        np.asarray(q),
    )


@lru_cache(maxsize=256)
def _beta_table(p: float, q: float) -> Tabulated:
    """The table of log(z/(1 - z)) as a function of the normal variate, with its slope."""
    theta = Tabulated.knots()
    with np.errstate(all="ignore"):
        low, high = np.log(_exact_beta(p, q, theta)), np.log(_exact_beta(q, p, -theta))
        density = p * low + q * high - special.betaln(p, q)
        return Tabulated(low - high, slope(theta, density))


def _at_once(
    theta: Array,
    table: Callable[..., Tabulated],
    back: Callable[[Array], Array],
    exactly: Callable[..., Array],
    *shapes: Array,
) -> Array:
    """The quantile at Phi(theta) of a law with these shapes.

    One law at many variates is interpolated in its table, and `back` maps a table's entries to
    quantiles. Otherwise `exactly` computes each quantile.
    """
    if (
        all(np.ndim(shape) == 0 for shape in shapes)
        and theta.size >= NUMERICS.worth
        and np.max(np.abs(theta)) < NUMERICS.farthest
    ):
        found = table(*map(float, shapes))
        if found.finite:
            return np.asarray(back(found(theta)))
    return exactly(*shapes, theta)
