"""Laws of the measurement error of one response: normal and Student's t, for bounds as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol, TypeGuard

import numpy as np
from scipy import special

from aleator.core.types import Array, Flags
from aleator.errors import InputsError
from aleator.laws import Free, Hyperparameter, Specification, resolve
from aleator.laws.law import difference


@dataclass(frozen=True)
class ErrorNumerics:
    """How exactly errors are computed; chosen by tests/observations/test_errors.py."""

    narrow: float = 1e-3
    """Width of an interval, in scales (of a normal error relative to its distance, too), up to
    which its probability is its width times the density in its middle."""
    df: tuple[float, float] = (1.0, 100.0)
    """Limits of the degrees of freedom where none are given, from Cauchy's law to what nobody tells
    from a normal law (by judgement)."""
    step: float = 2e-3
    """Relative step of a difference in the degrees of freedom."""
    eta_step: float = 1e-4
    """Step, in scales, of the difference that gives a curvature; its error is about 1e-8."""
    farthest: float = 1e140
    """The largest simulated value that is told from infinity; its square is a finite number."""
    together: int = 32768
    """Numbers of one array operation: intermediate ones stay in the cache (`make bench`)."""


NUMERICS = ErrorNumerics()


class Observed(NamedTuple):
    """log p(y | eta, scale) with its derivatives by eta and by the scale, elementwise."""

    value: Array
    d_eta: Array
    d_scale: Array


class ObservationModel(Protocol):
    """The distribution of a measured value y, given the simulated value eta and a scale.

    Everything is elementwise: y, eta and the scale broadcast against each other, in the unit of the
    outcome. The scale is positive. A new kind of measurement error fills this protocol in a file of
    its own; nothing else in the package knows which kinds there are.
    """

    @property
    def name(self) -> str:
        """Name for reports and for `[noise] kind` in a study."""

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        """log p(y | eta, scale), d/d eta and d/d scale; minus infinity where y cannot be."""

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        """Probability of a measured value not above y."""

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        """The measured value that is not exceeded with a probability."""

    def moments(self, order: int) -> Array:
        """E[((y - eta)/scale)^m] for m from 0 to `order`, (order + 1,); NaN where there is none."""


class Bounded(ObservationModel, Protocol):
    """An observation model that also computes probabilities of bounds itself, exact in both tails.

    That of a model without it is the difference of its `cdf`, which loses the upper tail.
    """

    def log_probability(self, lower: Array, upper: Array, eta: Array, scale: Array) -> Observed:
        """log P(lower < y < upper | eta, scale), d/d eta and d/d scale; ends may be infinite."""


class CurvedModel(ObservationModel, Protocol):
    """An observation model whose log density has a second derivative in closed form.

    That of a model without it is a difference.
    """

    def curvature(self, y: Array, eta: Array, scale: Array) -> Array:
        """-d2 log p(y | eta, scale)/d eta2, which may be negative."""


class Shaped(ObservationModel, Protocol):
    """An observation model with hyperparameters of its own beside the scale.

    Where none of them is free `shapes` is empty, and the model is used as it is.
    """

    @property
    def shapes(self) -> tuple[Hyperparameter, ...]:
        """The free shapes, named without a prefix."""

    def at(self, values: Sequence[float]) -> ObservationModel:
        """The model with these values of its `shapes`."""

    def by_shapes(
        self, values: Sequence[float], lower: Array, upper: Array, eta: Array, scale: Array
    ) -> tuple[Array, ...]:
        """The derivative by each of the `shapes` at these values.

        It is that of the log density where lower and upper are equal, and of the log probability
        between them where they are not.
        """


# One attribute is looked up: isinstance with a protocol would cost more than the computation.
def is_bounded(model: ObservationModel) -> TypeGuard[Bounded]:
    """Whether a model computes probabilities of bounds itself."""
    return hasattr(model, "log_probability")


def is_curved(model: ObservationModel) -> TypeGuard[CurvedModel]:
    """Whether a model has a closed form of the second derivative."""
    return hasattr(model, "curvature")


def is_shaped(model: ObservationModel) -> TypeGuard[Shaped]:
    """Whether a model has shapes that are free."""
    return bool(getattr(model, "shapes", ()))


def observed(
    model: ObservationModel, lower: Array, upper: Array, eta: Array, scale: Array, exact: Flags
) -> Observed:
    """The log density of exact values (lower == upper), the log probability between bounds.

    `lower` and `upper` (m, 1), `eta` (m, J), `scale` () or (m, 1) or (m, J), `exact` (m,).
    """
    if np.all(exact):
        return model.log_density(upper, eta, scale)
    if not np.any(exact):
        return log_probability(model, lower, upper, eta, scale)
    scale = np.broadcast_to(scale, eta.shape)
    found = Observed(*(np.empty(eta.shape) for _ in range(3)))
    for which in (exact, ~exact):
        part = observed(model, lower[which], upper[which], eta[which], scale[which], exact[which])
        for whole, values in zip(found, part, strict=True):
            whole[which] = values
    return found


def log_probability(
    model: ObservationModel, lower: Array, upper: Array, eta: Array, scale: Array
) -> Observed:
    """log P(lower < y < upper | eta, scale) with derivatives: the model's own, or by its cdf.

    An infinite eta gives the limit.
    """
    eta = np.clip(eta, -NUMERICS.farthest, NUMERICS.farthest)
    if is_bounded(model):
        return model.log_probability(lower, upper, eta, scale)
    return _by_cdf(model, lower, upper, eta, scale)


def _by_cdf(
    model: ObservationModel, lower: Array, upper: Array, eta: Array, scale: Array
) -> Observed:
    """P = F(upper) - F(lower), where F depends on y, eta and the scale by (y - eta)/scale only."""
    below = np.where(np.isneginf(lower), 0.0, model.cdf(lower, eta, scale))
    above = np.where(np.isposinf(upper), 1.0, model.cdf(upper, eta, scale))
    a, b = (lower - eta) / scale, (upper - eta) / scale
    with np.errstate(all="ignore"):
        value = np.log(above - below)
        log_scale = np.log(scale)
        at_a, at_b = (model.log_density(e, eta, scale).value + log_scale for e in (lower, upper))
        return from_ends(value, at_a, at_b, a, b, scale)


def from_ends(value: Array, at_a: Array, at_b: Array, a: Array, b: Array, scale: Array) -> Observed:
    """The derivatives of value = log P(a < u < b) from the log densities of u at the two ends.

    d/d eta = (f(a) - f(b))/(scale P), d/d scale = (a f(a) - b f(b))/(scale P); an end at infinity
    gives nothing.
    """
    with np.errstate(all="ignore"):
        ratio_a = np.where(np.isinf(a), 0.0, np.exp(at_a - value))
        ratio_b = np.where(np.isinf(b), 0.0, np.exp(at_b - value))
        moved = np.where(np.isinf(a), 0.0, a * ratio_a) - np.where(np.isinf(b), 0.0, b * ratio_b)
        return Observed(value, (ratio_a - ratio_b) / scale, moved / scale)


def outward(a: Array, b: Array) -> tuple[Array, Array, Flags]:
    """Ends mirrored so that b >= |a|, which have equal probability by symmetry; which were."""
    turned = a + b < 0.0
    return np.where(turned, -b, a), np.where(turned, -a, b), turned


HALF_LOG_2_PI = float(np.log(2.0 * np.pi)) / 2.0
ROOT_2 = float(np.sqrt(2.0))


@dataclass(frozen=True)
class NormalError:
    """y = eta + e with e ~ Normal(0, scale^2).

    >>> y, eta, scale = np.array(1.0), np.array(0.0), np.array(2.0)
    >>> [float(v) for v in NormalError().log_density(y, eta, scale)]
    [-1.737, 0.25, -0.375]
    """

    @property
    def name(self) -> str:
        """Name for reports."""
        return "normal"

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        """-u^2/2 - log scale - log(2 pi)/2 with u = (y - eta)/scale."""
        # In place, because memory traffic is the cost: it is called for millions of values.
        u = (y - eta) / scale
        square = u * u
        value = -0.5 * square
        value -= np.log(scale) + HALF_LOG_2_PI
        square -= 1.0
        square /= scale
        u /= scale
        return Observed(value, u, square)

    def log_probability(self, lower: Array, upper: Array, eta: Array, scale: Array) -> Observed:
        """log(Phi(b) - Phi(a)) with a and b the ends in scales from eta; all digits in both tails.

        >>> seen = NormalError().log_probability(*map(np.array, ([40.0], [np.inf], [0.0], [1.0])))
        >>> [v.round(6).tolist() for v in seen]
        [[-804.608], [40.025], [1600.998]]
        """
        with np.errstate(all="ignore"):
            a, b = np.broadcast_arrays((lower - eta) / scale, (upper - eta) / scale)
            a, b, turned = outward(a, b)
            sign = np.where(turned, -1.0, 1.0)
            value, by_eta, by_scale = (np.empty(a.shape) for _ in range(3))
            width, middle = b - a, 0.5 * (a + b)
            narrow = width * np.maximum(1.0, middle) < NUMERICS.narrow
            for which, between in (
                (narrow, _narrow),
                (~narrow & (a >= 0.0), _beyond),
                (~narrow & ~(a >= 0.0), _across),
            ):
                if np.any(which):
                    found = between(a[which], b[which])
                    value[which], by_eta[which], by_scale[which] = found
            return Observed(value, sign * by_eta / scale, by_scale / scale)

    def curvature(self, y: Array, eta: Array, scale: Array) -> Array:
        """1/scale^2."""
        return np.broadcast_to(scale**-2.0, np.broadcast_shapes(y.shape, eta.shape, scale.shape))

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        """Phi((y - eta)/scale)."""
        return np.asarray(special.ndtr((y - eta) / scale))

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        """Eta + scale Phi^-1(probability)."""
        return np.asarray(eta + scale * special.ndtri(probability))

    def moments(self, order: int) -> Array:
        """(m - 1)!! for even m, zero for odd."""
        m = np.arange(order + 1)
        return np.where(m % 2 == 0, special.factorial2(np.maximum(m - 1, 0)), 0.0)


_Found = tuple[Array, Array, Array]
"""log P(a < u < b), (phi(a) - phi(b))/P and (a phi(a) - b phi(b))/P of a standard normal u."""


def _narrow(a: Array, b: Array) -> _Found:
    """Case of a narrow interval: the integral of phi about its middle, to third order."""
    m, d = 0.5 * (a + b), b - a
    value = -0.5 * m**2 - HALF_LOG_2_PI + np.log(d) + np.log1p(d**2 * (m**2 - 1.0) / 24.0)
    return value, m - d**2 * m / 12.0, m**2 - 1.0 - d**2 * (2.0 * m**2 - 1.0) / 12.0


def _beyond(a: Array, b: Array) -> _Found:
    """Case 0 <= a: P = Q(a)(1 - Q(b)/Q(a)), since ratios of upper tails Q keep their digits."""
    tail, drop = special.erfcx(a / ROOT_2), 0.5 * (b - a) * (b + a)
    left = -np.expm1(np.log(special.erfcx(b / ROOT_2) / tail) - drop)
    at_a = np.sqrt(2.0 / np.pi) / (tail * left)
    at_b = at_a * np.exp(-drop)
    moved = a * at_a - np.where(np.isinf(b), 0.0, b * at_b)
    return special.log_ndtr(-a) + np.log(left), at_a - at_b, moved


def _across(a: Array, b: Array) -> _Found:
    """Case a < 0 < b: P is a sum of two positive numbers."""
    probability = 0.5 * (special.erf(b / ROOT_2) + special.erf(-a / ROOT_2))
    at_a, at_b = (np.exp(-0.5 * u**2 - HALF_LOG_2_PI) / probability for u in (a, b))
    moved = np.where(np.isinf(a), 0.0, a * at_a) - np.where(np.isinf(b), 0.0, b * at_b)
    return np.log(probability), at_a - at_b, moved


@dataclass(frozen=True)
class StudentError:
    """y = eta + scale t, t of Student's law with `df` degrees of freedom: outliers pull little.

    p(y | eta, scale) = c (1 + u^2/df)^(-(df + 1)/2)/scale with u = (y - eta)/scale. The scale is
    not the standard deviation: that is scale sqrt(df/(df - 2)), and there is none up to df = 2.
    `df` is a number > 0, or `Free(lower, upper)`, whose limits default to 1 and 100; its
    hyperparameter is `noise.df`. Raises InputsError for what is neither.

    >>> from scipy import stats
    >>> at = np.array(1.5), np.array(0.2), np.array(0.7)
    >>> bool(np.isclose(StudentError(4.0).log_density(*at).value, stats.t.logpdf(1.5, 4, 0.2, 0.7)))
    True
    """

    df: Specification

    def __post_init__(self) -> None:
        """Check the degrees of freedom at once."""
        _ = self._shape

    @cached_property
    def _shape(self) -> Hyperparameter:
        if self.df == 0:
            raise InputsError("df = 0", "give the degrees of freedom, a number > 0")
        return resolve("df", self.df, NUMERICS.df, positive=True)

    @property
    def shapes(self) -> tuple[Hyperparameter, ...]:
        """The degrees of freedom, if they are to be identified."""
        return (self._shape,) if self._shape.free else ()

    def at(self, values: Sequence[float]) -> StudentError:
        """The same error with a known df; with no values, itself.

        >>> StudentError(Free(2.0, 30.0)).at([5.0])
        StudentError(df=5.0)
        """
        return StudentError(float(values[0])) if len(values) else self

    @property
    def name(self) -> str:
        """Name for reports."""
        return "student_t" if isinstance(self.df, Free) else f"student_t({self.df:g})"

    @property
    def _df(self) -> float:
        if isinstance(self.df, Free):
            raise InputsError(
                "the degrees of freedom are to be identified and have no value",
                "ask for the error at a value: StudentError(...).at([df])",
            )
        return float(self.df)

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        """log c - (df + 1)/2 log(1 + u^2/df) - log scale, with derivatives."""
        df, u = self._df, (y - eta) / scale
        square = u * u
        pull = (df + 1.0) * u / (df + square)
        value = _log_density(df, square) - np.log(scale)
        return Observed(value, pull / scale, (u * pull - 1.0) / scale)

    def log_probability(self, lower: Array, upper: Array, eta: Array, scale: Array) -> Observed:
        """log P(lower < y < upper), by the tail in which the interval lies.

        An interval narrower than 1e-3 scales is its width times the density in its middle.
        """
        df = self._df
        with np.errstate(all="ignore"):
            a, b = np.broadcast_arrays((lower - eta) / scale, (upper - eta) / scale)
            ends = (_log_density(df, a * a), _log_density(df, b * b))
            return from_ends(_log_between(df, a, b), *ends, a, b, scale)

    def curvature(self, y: Array, eta: Array, scale: Array) -> Array:
        """(df + 1)(df - u^2)/(df + u^2)^2/scale^2, negative where |u| > sqrt(df)."""
        df, square = self._df, ((y - eta) / scale) ** 2
        return (df + 1.0) * (df - square) / ((df + square) * scale) ** 2

    def by_shapes(
        self, values: Sequence[float], lower: Array, upper: Array, eta: Array, scale: Array
    ) -> tuple[Array, ...]:
        """d/d df: in closed form where lower and upper are equal, else a difference.

        2 d log p/d df = psi((df + 1)/2) - psi(df/2) - 1/df - log(1 + u^2/df) + u pull/df with
        pull = (df + 1) u/(df + u^2). The difference has some ten digits.
        """
        df = float(values[0])
        with np.errstate(all="ignore"):
            a, b = np.broadcast_arrays((lower - eta) / scale, (upper - eta) / scale)
            found = np.asarray(0.5 * _twice_by_df(df, a * a))
            apart = a != b
            if np.any(apart):
                ends = a[apart], b[apart]
                found[apart] = difference(
                    lambda at: _log_between(float(at), *ends), df, NUMERICS.step * df
                )
        return (found,)

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        """F((y - eta)/scale)."""
        return np.asarray(special.stdtr(self._df, (y - eta) / scale))

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        """Eta + scale F^-1(probability)."""
        return np.asarray(eta + scale * special.stdtrit(self._df, probability))

    def moments(self, order: int) -> Array:
        """Moments of order below df: E[t^m] = df^(m/2) G((m+1)/2) G((df-m)/2)/(G(1/2) G(df/2)).

        G is the gamma function; odd moments are zero.
        """
        df, m = self._df, np.arange(order + 1)
        with np.errstate(all="ignore"):
            log = (
                0.5 * m * np.log(df)
                + special.gammaln(0.5 * (m + 1)) + special.gammaln(0.5 * (df - m))
                - special.gammaln(0.5) - special.gammaln(0.5 * df)
            )  # fmt: skip
            return np.where(m < df, np.where(m % 2 == 0, np.exp(log), 0.0), np.nan)


def _log_density(df: float, square: Array) -> Array:
    """Log-density of Student's standard law by u^2."""
    log_c = special.gammaln(0.5 * (df + 1.0)) - special.gammaln(0.5 * df) - 0.5 * np.log(df * np.pi)
    return np.asarray(log_c - 0.5 * (df + 1.0) * np.log1p(square / df))


def _twice_by_df(df: float, square: Array) -> Array:
    rise = special.psi(0.5 * (df + 1.0)) - special.psi(0.5 * df) - 1.0 / df
    return np.asarray(rise - np.log1p(square / df) + (df + 1.0) * square / (df * (df + square)))


def _log_between(df: float, a: Array, b: Array) -> Array:
    """log P(a < t < b)."""
    a, b, _ = outward(a, b)
    beyond, rest = special.stdtr(df, -a), special.stdtr(df, -b)
    value = np.log(np.where(a >= 0.0, beyond - rest, special.stdtr(df, b) - special.stdtr(df, a)))
    middle = 0.5 * (a + b)
    flat = np.log(b - a) + _log_density(df, middle * middle)
    # Where the tail underflows, which needs many degrees of freedom: f(a) over its fall there.
    far = _log_density(df, a * a) - np.log((df + 1.0) * a / (df + a * a))
    value = np.where(np.isneginf(value), far, value)
    return np.where(b - a < NUMERICS.narrow, flat, value)
