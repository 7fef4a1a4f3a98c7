"""Densities that are written down by u = (y - mean)/sd, in the unit of the outcome."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aleator.laws.law import invert
from aleator.moments.densities.gaussian import FittedGaussian
from aleator.moments.densities.interface import (
    Codes,
    Sensitivity,
    by_experiment,
    check_moments,
    in_sds,
    one_per_experiment,
    probabilities,
)
from aleator.moments.densities.moments import Moments
from aleator.status import DEGENERATE_VALUE, Status
from aleator.types import Array

MOST_SDS = 1e6
"""Standard deviations within which quantiles are looked for."""


class FittedStandardized(ABC):
    """f_Y(y) = g(u)/sd for N experiments, u = (y - mean)/sd; methods as in `FittedDensity`.

    A subclass gives `normal` (mean and sd, and which experiments have no scatter), `status`, and g
    by `log_density`, `below` and `partials`. Without scatter the outcome is a point mass.
    """

    normal: FittedGaussian

    @property
    @abstractmethod
    def status(self) -> Codes:
        """(N,) `Status` codes of the fits."""

    @abstractmethod
    def log_density(self, u: Array) -> Array:
        """log g at u (N, G)."""

    @abstractmethod
    def below(self, u: Array) -> Array:
        """Probability (N, G) of less than u (N, G)."""

    @abstractmethod
    def partials(self, u: Array) -> tuple[Array, Array, Array]:
        """What a search sees of log g at u (N,), its slope (N,) by u, and (N, M+1) by the moments.

        The value is finite; where the fit failed it is below log g.
        """

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y (N,) or (N, G); -inf for a point mass."""
        u, sd = self._standardized(y)
        return self._or(self.log_density(u) - np.log(sd), -np.inf).reshape(np.shape(y))

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N,) or (N, G)."""
        return np.exp(self.log_pdf(y))

    def cdf(self, y: ArrayLike) -> Array:
        """Probability of an outcome not above y (N,) or (N, G)."""
        u, _ = self._standardized(y)
        normal = self.normal.cdf(by_experiment(y, u.shape[0], "the outcome"))
        return self._or(self.below(u), normal).reshape(np.shape(y))

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,)."""
        level = probabilities(p)
        mean, sd = self.normal.safe()
        own = mean[:, None] + sd[:, None] * self.inverse(level)
        return self._or(own, self.normal.quantile(level))

    def inverse(self, p: Array) -> Array:
        """u (N, P) with probabilities p (P,) below, within a million sds."""
        wanted = np.broadcast_to(p, (self.normal.mean.size, p.size))
        low, high = np.full(wanted.shape, -1.0), np.full(wanted.shape, 1.0)
        while np.any(far := (self.below(low) > wanted) & (low > -MOST_SDS)):
            low = np.where(far, 2.0 * low, low)
        while np.any(far := (self.below(high) < wanted) & (high < MOST_SDS)):
            high = np.where(far, 2.0 * high, high)
        return invert(self.below, lambda u: np.exp(self.log_density(u)), wanted, low, high)

    def sensitivity(self, y: ArrayLike) -> Sensitivity:
        """Value for the search at y (N,) with its partial derivatives.

        d log f/d mean = -(d log g/du)/sd and d log f/d sd = -(1 + u d log g/du)/sd. Without a
        density, or for an outcome that is not finite, the value is DEGENERATE_VALUE.
        """
        outcome = one_per_experiment(y, self.normal.mean.size, "the outcome")
        none = self.normal.degenerate | ~np.isfinite(outcome)
        mean, sd = self.normal.safe()
        u = in_sds(np.where(none, mean, outcome), mean, sd)
        value, d_u, d_standardized = self.partials(u)
        zero = np.zeros_like(u)
        return Sensitivity(
            value=np.where(none, DEGENERATE_VALUE, value - np.log(sd)),
            d_mean=np.where(none, 0.0, -d_u / sd),
            d_sd=np.where(none, 0.0, -(1.0 + u * d_u) / sd),
            d_standardized=np.where(none[:, None], 0.0, d_standardized),
            d_lower=zero,
            d_upper=zero.copy(),
            status=np.where(none, Status.DEGENERATE, self.status).astype(np.int64),
        )

    def _standardized(self, y: ArrayLike) -> tuple[Array, Array]:
        mean, sd = self.normal.safe()
        outcome = by_experiment(y, mean.size, "the outcome")
        return in_sds(outcome, mean[:, None], sd[:, None]), sd[:, None]

    def _or(self, own: Array, normal: Array | float) -> Array:
        """`own` (N, G) with the rows without a density replaced."""
        return np.where(self.normal.degenerate[:, None], normal, own)


class StandardizedDensity(ABC):
    """A density of u = (y - mean)/sd that is written down by moments of u, on the whole line.

    A subclass gives `name`, `order` M and g by `log_density` and `cumulative`, as functions of u
    (N, G) and of the standardized moments c (N, 1, M+1), c[..., 3] being the skewness. Quantiles
    come by inversion. The density must have mean zero and standard deviation one.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """Name for reports."""

    @property
    @abstractmethod
    def order(self) -> int:
        """Number of moments that the density needs."""

    @abstractmethod
    def log_density(self, u: Array, c: Array) -> tuple[Array, Array, Array]:
        """log g (N, G), its derivative (N, G) by u, and (N, G, M+1) by the moments; finite."""

    @abstractmethod
    def cumulative(self, u: Array, c: Array) -> Array:
        """Probability (N, G) of less than u."""

    def fit(self, moments: Moments, lower: ArrayLike, upper: ArrayLike) -> FittedStandardized:  # noqa: ARG002
        """Fit N densities; the range of the outcome is not used.

        Raises InputsError for too few moments.
        """
        check_moments(moments, self.order, self.name)
        normal = FittedGaussian(moments.mean, moments.sd, moments.standardized.shape[1])
        return _Written(self, normal, moments.standardized)


@dataclass(frozen=True)
class _Written(FittedStandardized):
    """A `StandardizedDensity` with the moments of N experiments."""

    choice: StandardizedDensity
    normal: FittedGaussian
    standardized: Array

    @property
    def status(self) -> Codes:
        return self.normal.status

    @property
    def _moments(self) -> Array:
        return self.standardized[:, None, : self.choice.order + 1]

    def log_density(self, u: Array) -> Array:
        return self.choice.log_density(u, self._moments)[0]

    def below(self, u: Array) -> Array:
        return self.choice.cumulative(u, self._moments)

    def partials(self, u: Array) -> tuple[Array, Array, Array]:
        value, d_u, own = self.choice.log_density(u[:, None], self._moments)
        d_standardized = np.zeros(self.standardized.shape)
        d_standardized[:, : own.shape[2]] = own[:, 0]
        return value[:, 0], d_u[:, 0], d_standardized
