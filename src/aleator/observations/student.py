"""Measurement error with outliers: Student's t."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special

from aleator.errors import InputsError
from aleator.laws import Free, Hyperparameter, Specification, resolve
from aleator.observations.model import Observed, from_ends, outward
from aleator.types import Array

LIMITS = (1.0, 100.0)
"""Degrees of freedom where none are given: from Cauchy's law to what nobody tells from a normal."""
STEP = 2e-3
"""Relative step in the degrees of freedom of a difference of the fourth order."""


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
        """Check at once, so that the mistake is reported where it was made."""
        _ = self._shape

    @cached_property
    def _shape(self) -> Hyperparameter:
        if self.df == 0:
            raise InputsError("df = 0", "give the degrees of freedom, a number > 0")
        return resolve("df", self.df, LIMITS, positive=True)

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
    def reach(self) -> float:
        """There is no end: tails fall as a power."""
        return np.inf

    @property
    def _known(self) -> float:
        if isinstance(self.df, Free):
            raise InputsError(
                "the degrees of freedom are to be identified and have no value",
                "ask for the error at a value: StudentError(...).at([df])",
            )
        return float(self.df)

    def log_density(self, y: Array, eta: Array, scale: Array) -> Observed:
        """log c - (df + 1)/2 log(1 + u^2/df) - log scale, with derivatives."""
        df, u = self._known, (y - eta) / scale
        square = u * u
        pull = (df + 1.0) * u / (df + square)
        value = _log_density(df, square) - np.log(scale)
        return Observed(value, pull / scale, (u * pull - 1.0) / scale)

    def log_probability(self, lower: Array, upper: Array, eta: Array, scale: Array) -> Observed:
        """log P(lower < y < upper), by the tail in which the interval lies.

        An interval narrower than 1e-3 scales is its width times the density in its middle.
        """
        df = self._known
        with np.errstate(all="ignore"):
            a, b = np.broadcast_arrays((lower - eta) / scale, (upper - eta) / scale)
            ends = (_log_density(df, a * a), _log_density(df, b * b))
            return from_ends(_log_between(df, a, b), *ends, a, b, scale)

    def curvature(self, y: Array, eta: Array, scale: Array) -> Array:
        """(df + 1)(df - u^2)/(df + u^2)^2/scale^2, negative where |u| > sqrt(df)."""
        df, square = self._known, ((y - eta) / scale) ** 2
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
                found[apart] = _difference(df, a[apart], b[apart])
        return (found,)

    def cdf(self, y: Array, eta: Array, scale: Array) -> Array:
        """F((y - eta)/scale)."""
        return np.asarray(special.stdtr(self._known, (y - eta) / scale))

    def quantile(self, probability: Array, eta: Array, scale: Array) -> Array:
        """Eta + scale F^-1(probability)."""
        return np.asarray(eta + scale * special.stdtrit(self._known, probability))

    def moments(self, order: int) -> Array:
        """Those of order below df exist: E[t^m] = df^(m/2) G((m+1)/2) G((df-m)/2)/(G(1/2) G(df/2)).

        G is the gamma function; odd moments are zero.
        """
        df, m = self._known, np.arange(order + 1)
        with np.errstate(all="ignore"):
            log = (
                0.5 * m * np.log(df)
                + special.gammaln(0.5 * (m + 1)) + special.gammaln(0.5 * (df - m))
                - special.gammaln(0.5) - special.gammaln(0.5 * df)
            )  # fmt: skip
            return np.where(m < df, np.where(m % 2 == 0, np.exp(log), 0.0), np.nan)


def _log_density(df: float, square: Array) -> Array:
    """Of the standard law, by u^2."""
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
    return np.where(b - a < 1e-3, flat, value)


def _difference(df: float, a: Array, b: Array) -> Array:
    h = STEP * df
    one, two = (_log_between(df + k * h, a, b) - _log_between(df - k * h, a, b) for k in (1.0, 2.0))
    return (8.0 * one - two) / (12.0 * h)
