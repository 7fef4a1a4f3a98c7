"""Laws of the measurement error of one response, normal and Student's t, with censored values."""

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
    """Numerical settings of measurement errors, chosen by tests/observations/test_errors.py."""

    narrow: float = 1e-3
    """Width of an interval, in units of the error's scale, up to which its probability is computed
    as its width times the density in its middle. For a normal error the limit is smaller for an
    interval far from the simulated value."""
    df: tuple[float, float] = (1.0, 100.0)
    """Default limits of the degrees of freedom of Student's law, chosen by judgement: from Cauchy's
    law to one that is practically normal."""
    step: float = 2e-3
    """Relative step of the difference that gives the derivative by the degrees of freedom."""
    eta_step: float = 1e-4
    """Step, in units of the error's scale, of the difference that gives a curvature; its error is
    about 1e-8."""
    farthest: float = 1e140
    """The size to which a simulated value is limited, so that its square is a finite number."""
    together: int = 32768
    """The number of values in one array operation, chosen so that they stay in the cache
    (`make bench`)."""


NUMERICS = ErrorNumerics()


class Observed(NamedTuple):
    """The log-density log p(y | eta, scale) with its derivatives by eta and the scale, elementwise.

    y is the measured value, eta the simulated value, and scale the scale of the error.
    """

    value: Array
    d_eta: Array
    d_scale: Array


class ObservationModel(Protocol):
    """The distribution of a measured value y, given the simulated value eta and a scale.

    All methods work elementwise: y, eta and the scale broadcast against each other, in the unit of
    the outcome. The scale is positive. A new kind of measurement error is a class with the members
    of this protocol; no other code has to be changed for it.
    """

    @property
    def name(self) -> str:
        """Name of the error in reports, and as `[noise] kind` in a study."""

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        """log p(y | eta, scale) and its derivatives; minus infinity where y is impossible."""

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        """Probability that the measured value is at most y."""

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        """The value that the measured value does not exceed with the given probability."""

    def moments(self, order: int) -> Array:
        """E[((y - eta)/scale)^m] for m from 0 to `order`, (order + 1,); NaN where infinite."""


class Bounded(ObservationModel, Protocol):
    """An observation model with its own method for probabilities of intervals, exact in both tails.

    For any other model such a probability is a difference of values of its `cdf`, which is inexact
    in the upper tail.
    """

    def log_probability(self, lower: Array, upper: Array, eta: Array, scale: Array) -> Observed:
        """log P(lower < y < upper | eta, scale) and its derivatives; the ends may be infinite."""


class CurvedModel(ObservationModel, Protocol):
    """An observation model whose log-density has a second derivative in closed form.

    For any other model it is computed by differences.
    """

    def curvature(self, y: Array, eta: Array, scale: Array) -> Array:
        """Minus the second derivative of log p(y | eta, scale) by eta, which may be negative."""


class Shaped(ObservationModel, Protocol):
    """An observation model with shape hyperparameters, as degrees of freedom, beside the scale.

    Where none of them is free, `shapes` is empty and the methods `at` and `by_shapes` are not used.
    """

    @property
    def shapes(self) -> tuple[Hyperparameter, ...]:
        """The free shape hyperparameters, named without the prefix `noise.`."""

    def at(self, values: Sequence[float]) -> ObservationModel:
        """The model with these values of its `shapes`."""

    def by_shapes(
        self, values: Sequence[float], lower: Array, upper: Array, eta: Array, scale: Array
    ) -> tuple[Array, ...]:
        """The derivatives of log p by each of the `shapes` at these values.

        Where lower and upper are equal, log p is the log-density there; otherwise it is the log
        probability of the interval between them.
        """


# Only one attribute is looked up: isinstance with a protocol would take longer than the rest.
def is_bounded(model: ObservationModel) -> TypeGuard[Bounded]:
    """Whether a model has its own method for probabilities of intervals (`Bounded`)."""
    return hasattr(model, "log_probability")


def is_curved(model: ObservationModel) -> TypeGuard[CurvedModel]:
    """Whether a model has a closed form of the second derivative (`CurvedModel`)."""
    return hasattr(model, "curvature")


def is_shaped(model: ObservationModel) -> TypeGuard[Shaped]:
    """Whether a model has shape hyperparameters that are free (`Shaped`)."""
    return bool(getattr(model, "shapes", ()))


def observed(
    model: ObservationModel, lower: Array, upper: Array, eta: Array, scale: Array, exact: Flags
) -> Observed:
    """The log-density of exactly known values, and the log probability of censored ones.

    `lower` and `upper` (m, 1) are the bounds of m observations, equal where `exact` (m,) is true.
    `eta` (m, J) are simulated values, and `scale` is (), (m, 1) or (m, J).
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
    """log P(lower < y < upper | eta, scale) and its derivatives, by the model itself or by its cdf.

    For an infinite eta it is the limit.
    """
    eta = np.clip(eta, -NUMERICS.farthest, NUMERICS.farthest)
    if is_bounded(model):
        return model.log_probability(lower, upper, eta, scale)
    return _by_cdf(model, lower, upper, eta, scale)


def _by_cdf(
    model: ObservationModel, lower: Array, upper: Array, eta: Array, scale: Array
) -> Observed:
    """log(F(upper) - F(lower)) and its derivatives, for a cdf F that depends on (y - eta)/scale."""
    below = np.where(np.isneginf(lower), 0.0, model.cdf(lower, eta, scale))
    above = np.where(np.isposinf(upper), 1.0, model.cdf(upper, eta, scale))
    a, b = (lower - eta) / scale, (upper - eta) / scale
    with np.errstate(all="ignore"):
        value = np.log(above - below)
        log_scale = np.log(scale)
        at_a, at_b = (model.log_density(e, eta, scale).value + log_scale for e in (lower, upper))
        return from_ends(value, at_a, at_b, a, b, scale)


def from_ends(value: Array, at_a: Array, at_b: Array, a: Array, b: Array, scale: Array) -> Observed:
    """The derivatives of value = log P(a < u < b), from the log-densities of u at the two ends.

    With u = (y - eta)/scale and its density f, d/d eta = (f(a) - f(b))/(scale P) and
    d/d scale = (a f(a) - b f(b))/(scale P). An end at infinity contributes nothing.
    """
    with np.errstate(all="ignore"):
        ratio_a = np.where(np.isinf(a), 0.0, np.exp(at_a - value))
        ratio_b = np.where(np.isinf(b), 0.0, np.exp(at_b - value))
        moved = np.where(np.isinf(a), 0.0, a * ratio_a) - np.where(np.isinf(b), 0.0, b * ratio_b)
        return Observed(value, (ratio_a - ratio_b) / scale, moved / scale)


def outward(a: Array, b: Array) -> tuple[Array, Array, Flags]:
    """Intervals (a, b) mirrored at zero where needed so that b >= |a|, and which were mirrored.

    For a symmetric law the probability stays the same.
    """
    turned = a + b < 0.0
    return np.where(turned, -b, a), np.where(turned, -a, b), turned


HALF_LOG_2_PI = float(np.log(2.0 * np.pi)) / 2.0
ROOT_2 = float(np.sqrt(2.0))


@dataclass(frozen=True)
class NormalError:
    """Normal measurement error: y = eta + e with e ~ Normal(0, scale^2).

    >>> y, eta, scale = np.array(1.0), np.array(0.0), np.array(2.0)
    >>> [float(v) for v in NormalError().log_density(y, eta, scale)]
    [-1.737, 0.25, -0.375]
    """

    @property
    def name(self) -> str:
        """Name of the error in reports."""
        return "normal"

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        """-u^2/2 - log scale - log(2 pi)/2 with u = (y - eta)/scale, and its derivatives."""
        # Arrays are changed in place, since with millions of values memory traffic is the cost.
        u = (y - eta) / scale
        square = u * u
        value = -0.5 * square
        value -= np.log(scale) + HALF_LOG_2_PI
        square -= 1.0
        square /= scale
        u /= scale
        return Observed(value, u, square)

    def log_probability(self, lower: Array, upper: Array, eta: Array, scale: Array) -> Observed:
        """log(Phi(b) - Phi(a)) with a = (lower - eta)/scale, b = (upper - eta)/scale; derivatives.

        It is exact in both tails.

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
        """Minus the second derivative of the log-density by eta, 1/scale^2."""
        return np.broadcast_to(scale**-2.0, np.broadcast_shapes(y.shape, eta.shape, scale.shape))

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        """Probability that the measured value is at most y, Phi((y - eta)/scale)."""
        return np.asarray(special.ndtr((y - eta) / scale))

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        """The quantile of the measured value, eta + scale Phi^-1(probability)."""
        return np.asarray(eta + scale * special.ndtri(probability))

    def moments(self, order: int) -> Array:
        """The moments of the standard normal law: (m - 1)!! for even m, zero for odd m."""
        m = np.arange(order + 1)
        return np.where(m % 2 == 0, special.factorial2(np.maximum(m - 1, 0)), 0.0)


_Found = tuple[Array, Array, Array]
"""For a standard normal u: log P(a < u < b), (phi(a) - phi(b))/P, (a phi(a) - b phi(b))/P."""


def _narrow(a: Array, b: Array) -> _Found:
    """`_Found` for a narrow interval, over which a series of the normal density is integrated.

    The series about the middle of the interval has terms to the third order in its width.
    """
    m, d = 0.5 * (a + b), b - a
    value = -0.5 * m**2 - HALF_LOG_2_PI + np.log(d) + np.log1p(d**2 * (m**2 - 1.0) / 24.0)
    return value, m - d**2 * m / 12.0, m**2 - 1.0 - d**2 * (2.0 * m**2 - 1.0) / 12.0


def _beyond(a: Array, b: Array) -> _Found:
    """`_Found` for 0 <= a: P = Q(a)(1 - Q(b)/Q(a)); ratios of upper tails Q keep their digits."""
    tail, drop = special.erfcx(a / ROOT_2), 0.5 * (b - a) * (b + a)
    left = -np.expm1(np.log(special.erfcx(b / ROOT_2) / tail) - drop)
    at_a = np.sqrt(2.0 / np.pi) / (tail * left)
    at_b = at_a * np.exp(-drop)
    moved = a * at_a - np.where(np.isinf(b), 0.0, b * at_b)
    return special.log_ndtr(-a) + np.log(left), at_a - at_b, moved


def _across(a: Array, b: Array) -> _Found:
    """`_Found` for a < 0 < b: P is a sum of two positive numbers."""
    probability = 0.5 * (special.erf(b / ROOT_2) + special.erf(-a / ROOT_2))
    at_a, at_b = (np.exp(-0.5 * u**2 - HALF_LOG_2_PI) / probability for u in (a, b))
    moved = np.where(np.isinf(a), 0.0, a * at_a) - np.where(np.isinf(b), 0.0, b * at_b)
    return np.log(probability), at_a - at_b, moved


@dataclass(frozen=True)
class StudentError:
    """Measurement error with heavy tails, y = eta + scale t, on which outliers have little effect.

    t follows Student's law with `df` degrees of freedom:
    p(y | eta, scale) = c (1 + u^2/df)^(-(df + 1)/2)/scale with u = (y - eta)/scale. The standard
    deviation is scale sqrt(df/(df - 2)), and does not exist for df <= 2. `df` is a number > 0, or
    `Free(lower, upper)` with default limits 1 and 100, to be identified as the hyperparameter
    `noise.df`. Raises InputsError for any other `df`.

    >>> from scipy import stats
    >>> at = np.array(1.5), np.array(0.2), np.array(0.7)
    >>> bool(np.isclose(StudentError(4.0).log_density(*at).value, stats.t.logpdf(1.5, 4, 0.2, 0.7)))
    True
    """

    df: Specification

    def __post_init__(self) -> None:
        """Check the degrees of freedom; InputsError if not valid."""
        _ = self._shape

    @cached_property
    def _shape(self) -> Hyperparameter:
        if self.df == 0:
            raise InputsError("df = 0", "give the degrees of freedom, a number > 0")
        return resolve("df", self.df, NUMERICS.df, positive=True)

    @property
    def shapes(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameter of the degrees of freedom, if they are to be identified."""
        return (self._shape,) if self._shape.free else ()

    def at(self, values: Sequence[float]) -> StudentError:
        """This error with known degrees of freedom values[0]; unchanged if `values` is empty.

        >>> StudentError(Free(2.0, 30.0)).at([5.0])
        StudentError(df=5.0)
        """
        return StudentError(float(values[0])) if len(values) else self

    @property
    def name(self) -> str:
        """Name of the error in reports, with the degrees of freedom if they are known."""
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
        """log c - (df + 1)/2 log(1 + u^2/df) - log scale with u = (y - eta)/scale; derivatives."""
        df, u = self._df, (y - eta) / scale
        square = u * u
        pull = (df + 1.0) * u / (df + square)
        value = _log_density(df, square) - np.log(scale)
        return Observed(value, pull / scale, (u * pull - 1.0) / scale)

    def log_probability(self, lower: Array, upper: Array, eta: Array, scale: Array) -> Observed:
        """log P(lower < y < upper) and its derivatives, from the tail in which the interval lies.

        For an interval narrower than 1e-3 scales the probability is its width times the density in
        its middle.
        """
        df = self._df
        with np.errstate(all="ignore"):
            a, b = np.broadcast_arrays((lower - eta) / scale, (upper - eta) / scale)
            ends = (_log_density(df, a * a), _log_density(df, b * b))
            return from_ends(_log_between(df, a, b), *ends, a, b, scale)

    def curvature(self, y: Array, eta: Array, scale: Array) -> Array:
        """Minus the second derivative of the log-density by eta, negative where |u| > sqrt(df).

        It is (df + 1)(df - u^2)/(df + u^2)^2/scale^2 with u = (y - eta)/scale.
        """
        df, square = self._df, ((y - eta) / scale) ** 2
        return (df + 1.0) * (df - square) / ((df + square) * scale) ** 2

    def by_shapes(
        self, values: Sequence[float], lower: Array, upper: Array, eta: Array, scale: Array
    ) -> tuple[Array, ...]:
        """The derivative of an observation's log p by df: in closed form for a measured value.

        2 d log p/d df = psi((df + 1)/2) - psi(df/2) - 1/df - log(1 + u^2/df) + u w/df with
        w = (df + 1) u/(df + u^2) the digamma function psi, and the standardized residual u. For a
        censored value it is a finite difference with some ten correct digits.
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
        """Probability that the measured value is at most y, F((y - eta)/scale) of Student's law."""
        return np.asarray(special.stdtr(self._df, (y - eta) / scale))

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        """The quantile of the measured value, eta + scale F^-1(probability) of Student's law."""
        return np.asarray(eta + scale * special.stdtrit(self._df, probability))

    def moments(self, order: int) -> Array:
        """The moments E[t^m] for m from 0 to `order`; NaN where m >= df.

        E[t^m] = df^(m/2) G((m+1)/2) G((df-m)/2)/(G(1/2) G(df/2)) for even m, with the gamma
        function G; odd moments are zero.
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
    """Log-density of Student's standard law, as a function of `square` = u^2."""
    log_c = special.gammaln(0.5 * (df + 1.0)) - special.gammaln(0.5 * df) - 0.5 * np.log(df * np.pi)
    return np.asarray(log_c - 0.5 * (df + 1.0) * np.log1p(square / df))


def _twice_by_df(df: float, square: Array) -> Array:
    rise = special.psi(0.5 * (df + 1.0)) - special.psi(0.5 * df) - 1.0 / df
    return np.asarray(rise - np.log1p(square / df) + (df + 1.0) * square / (df * (df + square)))


def _log_between(df: float, a: Array, b: Array) -> Array:
    """log P(a < t < b) for Student's standard law."""
    a, b, _ = outward(a, b)
    beyond, rest = special.stdtr(df, -a), special.stdtr(df, -b)
    value = np.log(np.where(a >= 0.0, beyond - rest, special.stdtr(df, b) - special.stdtr(df, a)))
    middle = 0.5 * (a + b)
    flat = np.log(b - a) + _log_density(df, middle * middle)
    # The tail can underflow with many degrees of freedom. Then it is f(a) over its rate of decay.
    far = _log_density(df, a * a) - np.log((df + 1.0) * a / (df + a * a))
    value = np.where(np.isneginf(value), far, value)
    return np.where(b - a < NUMERICS.narrow, flat, value)
