"""Densities of the outcome that are fitted to its moments: the interface, and the normal density.

A `Density` is a kind of density, as `Gaussian()` or `MaximumEntropy(order=4)`. Its `fit` returns a
`FittedDensity`: N densities at once, each with a `Status`. A user's own density with a formula in
u = (y - mean)/sd is a subclass of `StandardizedDensity`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from aleator.core.status import DEGENERATE_VALUE, Status
from aleator.core.types import Array, Flags
from aleator.errors import InputsError
from aleator.laws.law import invert
from aleator.moments.moments import Moments

Codes = NDArray[np.int64]


@dataclass(frozen=True)
class DensityPartials:
    """The log-density that a search uses at one outcome per experiment, with exact derivatives.

    `value` (N,) is log f_Y(y) inside the support; outside it is a finite continuation. `d_mean`,
    `d_sd` (N,) and `d_standardized` (N, M+1) are its partial derivatives by the mean, the sd and
    the standardized moments; columns 0, 1, 2 are zero because these moments are constants.
    Units: `value` is the logarithm of 1/outcome, `d_mean` and `d_sd` are 1/outcome. All numbers are
    finite; `status` (N,) holds `Status` codes.
    """

    value: Array
    d_mean: Array
    d_sd: Array
    d_standardized: Array
    status: Codes


class FittedDensity(Protocol):
    """Densities of the outcomes of N experiments, each with a status.

    Outcomes y are (N,), one for each experiment, or (N, G), G for each experiment. Every method
    returns an array of the shape of y.
    """

    @property
    def status(self) -> Codes:
        """The `Status` code of each fit (N,)."""

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y; -inf outside the support."""

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y; 0 outside the support."""

    def cdf(self, y: ArrayLike) -> Array:
        """Probability that the outcome is at most y."""

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,)."""


class FittedMomentDensity(FittedDensity, Protocol):
    """Densities that are fitted to moments, and can be differentiated by them."""

    def sensitivity(self, y: ArrayLike) -> DensityPartials:
        """The log-density for a search at y (N,), with its partial derivatives."""


class Density(Protocol):
    """A kind of density that can be fitted to moments of the outcome."""

    @property
    def order(self) -> int:
        """Number of moments that the density needs."""

    @property
    def name(self) -> str:
        """Name of the density in reports."""

    def fit(self, moments: Moments, lower: ArrayLike, upper: ArrayLike) -> FittedMomentDensity:
        """Fit N densities to the moments on the physical ranges lower, upper (N,)."""


# ---------------------------------------------------------------------------- by u = (y - mean)/sd


class FittedStandardized(ABC):
    """Base of fitted densities f_Y(y) = g(u)/sd of N outcomes, with u = (y - mean)/sd.

    The public methods are those of `FittedDensity`. A subclass gives `moments`, and g by
    `log_density`, `below` and `partials`. Where sd is not positive the outcome is a point mass at
    its mean: there is no density, and the cdf is one step. Where a moment is not finite the
    quantiles are NaN.
    """

    moments: Moments

    @abstractmethod
    def log_density(self, u: Array) -> Array:
        """The logarithm of g at u (N, G)."""

    @abstractmethod
    def below(self, u: Array) -> Array:
        """Probability (N, G) of a standardized outcome below u (N, G)."""

    @abstractmethod
    def partials(self, u: Array) -> DensityPartials:
        """The value that a search uses for log g at u (N,), with its partials for an sd of one.

        `d_mean` is -d log g/du and `d_sd` is -u d log g/du if only u depends on the mean and the
        sd. The value is finite; where the fit failed it lies below log g.
        """

    @property
    def _scatters(self) -> Flags:
        """Whether each outcome scatters (N,); an sd below 1e-100 counts as no scatter."""
        return np.asarray(self.moments.sd > 1e-100)

    @property
    def degenerate(self) -> Flags:
        """Whether an outcome has no density (N,): no scatter, or a moment that is not finite."""
        finite: Flags = np.isfinite(self.moments.mean) & np.isfinite(self.moments.sd)
        return ~(finite & self._scatters)

    @property
    def status(self) -> Codes:
        """The `Status` code of each density (N,): SOLVED, or DEGENERATE where there is none."""
        return np.where(self.degenerate, Status.DEGENERATE, Status.SOLVED).astype(np.int64)

    def safe(self) -> tuple[Array, Array]:
        """Mean and sd (N,), replaced by 0 and 1 where there is no density."""
        none = self.degenerate
        return np.where(none, 0.0, self.moments.mean), np.where(none, 1.0, self.moments.sd)

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y (N,) or (N, G); -inf for a point mass."""
        u, sd = self._standardized(y)
        value = self.log_density(u) - np.log(sd)
        return np.where(self.degenerate[:, None], -np.inf, value).reshape(np.shape(y))

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N,) or (N, G)."""
        return np.exp(self.log_pdf(y))

    def cdf(self, y: ArrayLike) -> Array:
        """Probability that the outcome is at most y (N,) or (N, G)."""
        u, _ = self._standardized(y)
        mean = self.moments.mean[:, None]
        step = by_experiment(y, mean.size, "the outcome") >= mean
        return np.where(self.degenerate[:, None], step, self.below(u)).reshape(np.shape(y))

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,)."""
        level, none = probabilities(p), self.degenerate
        mean, sd = self.safe()
        unknown = self._scatters | np.isnan(self.moments.sd)
        point = np.where(unknown, np.nan, self.moments.mean)
        outcome = mean[:, None] + sd[:, None] * self.inverse(level)
        return np.where(none[:, None], point[:, None], outcome)

    def inverse(self, p: Array) -> Array:
        """Quantiles u (N, P) for the probabilities p (P,), within a million standard deviations."""
        levels = np.broadcast_to(p, (self.moments.mean.size, p.size))
        low, high = np.full(levels.shape, -1.0), np.full(levels.shape, 1.0)
        while np.any(far := (self.below(low) > levels) & (low > -1e6)):
            low = np.where(far, 2.0 * low, low)
        while np.any(far := (self.below(high) < levels) & (high < 1e6)):
            high = np.where(far, 2.0 * high, high)
        return invert(self.below, lambda u: np.exp(self.log_density(u)), levels, low, high)

    def sensitivity(self, y: ArrayLike) -> DensityPartials:
        """The log-density for a search at y (N,), with its partial derivatives.

        If only u depends on the mean and the sd, d log f/d mean = -(d log g/du)/sd and
        d log f/d sd = -(1 + u d log g/du)/sd. Where there is no density, or the outcome is not
        finite, the value is DEGENERATE_VALUE with zero derivatives.
        """
        outcome = one_per_experiment(y, self.moments.mean.size, "the outcome")
        none = self.degenerate | ~np.isfinite(outcome)
        mean, sd = self.safe()
        u = in_sds(np.where(none, mean, outcome), mean, sd)
        own = self.partials(u)
        return DensityPartials(
            value=np.where(none, DEGENERATE_VALUE, own.value - np.log(sd)),
            d_mean=np.where(none, 0.0, own.d_mean / sd),
            d_sd=np.where(none, 0.0, (own.d_sd - 1.0) / sd),
            d_standardized=np.where(none[:, None], 0.0, own.d_standardized),
            status=np.where(none, Status.DEGENERATE, own.status).astype(np.int64),
        )

    def _standardized(self, y: ArrayLike) -> tuple[Array, Array]:
        """Standardized outcomes u (N, G), and sd (N, 1), with the mean and sd of `safe`."""
        mean, sd = self.safe()
        outcome = by_experiment(y, mean.size, "the outcome")
        return in_sds(outcome, mean[:, None], sd[:, None]), sd[:, None]


class StandardizedDensity(ABC):
    """A density g of u = (y - mean)/sd on the real line, given by a formula in the moments of u.

    A subclass gives `name`, the order M of the moments it needs, and g by `log_density` and
    `cumulative`, as functions of u (N, G) and of the standardized moments c (N, 1, M+1); c[..., 3]
    is the skewness. Quantiles are computed by inversion. g must have mean zero and standard
    deviation one.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the density in reports."""

    @property
    @abstractmethod
    def order(self) -> int:
        """Number of moments that the density needs."""

    @abstractmethod
    def log_density(self, u: Array, c: Array) -> tuple[Array, Array, Array]:
        """log g (N, G), its derivatives by u (N, G) and by c (N, G, M+1); all must be finite."""

    @abstractmethod
    def cumulative(self, u: Array, c: Array) -> Array:
        """Probability (N, G) of a standardized outcome below u."""

    def fit(self, moments: Moments, lower: ArrayLike, upper: ArrayLike) -> FittedStandardized:  # noqa: ARG002
        """Fit N densities; the range of the outcome is not used.

        Raises InputsError for too few moments.
        """
        check_moments(moments, self.order, self.name)
        return _Written(moments, self)


@dataclass(frozen=True)
class _Written(FittedStandardized):
    """A `StandardizedDensity` that is fitted to the moments of N experiments."""

    moments: Moments
    choice: StandardizedDensity

    @property
    def _used(self) -> Array:
        return self.moments.standardized[:, None, : self.choice.order + 1]

    def log_density(self, u: Array) -> Array:
        return self.choice.log_density(u, self._used)[0]

    def below(self, u: Array) -> Array:
        return self.choice.cumulative(u, self._used)

    def partials(self, u: Array) -> DensityPartials:
        value, d_u, own = self.choice.log_density(u[:, None], self._used)
        d_standardized = np.zeros(self.moments.standardized.shape)
        d_standardized[:, : own.shape[2]] = own[:, 0]
        return DensityPartials(value[:, 0], -d_u[:, 0], -u * d_u[:, 0], d_standardized, self.status)


@dataclass(frozen=True)
class Gaussian:
    """The normal density with the first two moments of the outcome (paper, sec. PDF-MM).

    f(y) = exp(-u^2/2)/(sd sqrt(2 pi)), u = (y - mean)/sd, on the whole real line: the physical
    range of the outcome is not used, since a truncated normal would not keep the two moments.
    Cost O(N). It cannot fail except where sd is not positive or a moment is not finite
    (status DEGENERATE). `fit` raises InputsError where fewer than two moments are given.

    >>> m = Moments(np.array([1.0]), np.array([2.0]), np.array([[1.0, 0.0, 1.0]]))
    >>> float(Gaussian().fit(m, -np.inf, np.inf).pdf([1.0])[0])  # 1/(2 sqrt(2 pi))
    0.199471
    """

    @property
    def order(self) -> int:
        """Number of moments that the density needs."""
        return 2

    @property
    def name(self) -> str:
        """Name of the density in reports."""
        return "gaussian"

    def fit(
        self,
        moments: Moments,
        lower: ArrayLike,  # noqa: ARG002  one interface for all densities
        upper: ArrayLike,  # noqa: ARG002
    ) -> FittedGaussian:
        """Take the mean and sd (N,) of the moments; lower and upper are not used."""
        check_moments(moments, self.order, self.name)
        return FittedGaussian(moments)


@dataclass(frozen=True)
class FittedGaussian(FittedStandardized):
    """Normal densities of N experiments, with the methods of `FittedDensity`."""

    moments: Moments

    def log_density(self, u: Array) -> Array:
        """The standard normal log-density -u^2/2 - log sqrt(2 pi) at u (N, G)."""
        return np.asarray(-0.5 * u**2 - 0.5 * np.log(2.0 * np.pi))

    def below(self, u: Array) -> Array:
        """The standard normal distribution function Phi(u) at u (N, G)."""
        return np.asarray(ndtr(u))

    def inverse(self, p: Array) -> Array:
        """The standard normal quantiles Phi^-1(p) (1, P), one row for all experiments."""
        return np.asarray(ndtri(p))[None]

    def partials(self, u: Array) -> DensityPartials:
        """The log-density at u (N,), with slope -u; moments above the second have no effect."""
        none = np.zeros(self.moments.standardized.shape)
        return DensityPartials(self.log_density(u), u, u**2, none, self.status)


# ---------------------------------------------------------------------------- what is given


def check_moments(moments: Moments, order: int, name: str) -> None:
    """Raise InputsError where there are fewer moments than the density needs."""
    if moments.order < order:
        raise InputsError(
            f"density {name} needs {order} moments, {moments.order} given",
            f"ask the propagation for moments up to order {order}",
        )


def by_experiment(values: ArrayLike, experiments: int, what: str) -> Array:
    """Return G numbers for each experiment as (N, G); a vector (N,) becomes (N, 1).

    Raises InputsError for any other shape.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim not in (1, 2) or array.shape[0] != experiments:
        raise InputsError(
            f"{what} has shape {array.shape}, expected ({experiments},) or ({experiments}, G)",
            "give one row to each experiment",
        )
    return array[:, None] if array.ndim == 1 else array


def one_per_experiment(values: ArrayLike, experiments: int, what: str) -> Array:
    """Return one number for each experiment as (N,). Raise InputsError for another shape."""
    array = np.asarray(values, dtype=float)
    if array.shape != (experiments,):
        raise InputsError(
            f"{what} has shape {array.shape}, expected ({experiments},)",
            "give one number to each experiment",
        )
    return array


def in_sds(y: Array, mean: Array, sd: Array) -> Array:
    """(y - mean)/sd, limited to +-1e100 so that its square is finite."""
    with np.errstate(over="ignore"):
        return np.clip((y - mean) / sd, -1e100, 1e100)


def probabilities(values: ArrayLike) -> Array:
    """Return probabilities as (P,). Raise InputsError where one is not in [0, 1]."""
    p = np.atleast_1d(np.asarray(values, dtype=float))
    if p.ndim != 1 or not np.all((p >= 0.0) & (p <= 1.0)):
        raise InputsError(
            "a probability of a quantile is not in [0, 1]", "give a vector of numbers in [0, 1]"
        )
    return p


def range_end(values: ArrayLike, experiments: int, what: str) -> Array:
    """Return a limit of the physical range as (N,); one number holds for all experiments."""
    array = np.asarray(values, dtype=float)
    return one_per_experiment(
        np.full(experiments, array) if array.ndim == 0 else array, experiments, what
    )
