"""The normal density with the mean and the standard deviation of the outcome."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from aleator.moments.densities.interface import (
    SMALLEST_SD,
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
from aleator.types import Array, Flags

_LOG_SQRT_2PI = 0.5 * np.log(2.0 * np.pi)


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
        """Name for reports."""
        return "gaussian"

    def fit(
        self,
        moments: Moments,
        lower: ArrayLike,  # noqa: ARG002  one interface for all densities
        upper: ArrayLike,  # noqa: ARG002
    ) -> FittedGaussian:
        """Take the mean and sd (N,) of the moments; lower and upper are not used."""
        check_moments(moments, self.order, self.name)
        return FittedGaussian(moments.mean, moments.sd, moments.standardized.shape[1])


@dataclass(frozen=True)
class FittedGaussian:
    """Normal densities of N experiments; methods as in `FittedDensity`.

    Where sd is not positive the outcome is a point mass at its mean: no density, a cdf with one
    step. Where a moment is not finite a quantile is NaN.
    """

    mean: Array
    sd: Array
    columns: int

    @property
    def degenerate(self) -> Flags:
        """(N,) whether there is no density."""
        finite = np.isfinite(self.mean) & np.isfinite(self.sd)
        scattered: Flags = finite & (self.sd > SMALLEST_SD)
        return ~scattered

    @property
    def status(self) -> Codes:
        """(N,) SOLVED or DEGENERATE."""
        return np.where(self.degenerate, Status.DEGENERATE, Status.SOLVED).astype(np.int64)

    def _standardized(self, y: ArrayLike) -> tuple[Array, Array]:
        """Outcomes u (N, G) in units of sd about the mean, and sd (N, 1), of safe rows."""
        mean, sd = self.safe()
        outcome = by_experiment(y, self.mean.size, "the outcome")
        return in_sds(outcome, mean[:, None], sd[:, None]), sd[:, None]

    def safe(self) -> tuple[Array, Array]:
        """Mean and sd, replaced by 0 and 1 where there is no density."""
        none = self.degenerate
        return np.where(none, 0.0, self.mean), np.where(none, 1.0, self.sd)

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y (N,) or (N, G); -inf for a point mass."""
        u, sd = self._standardized(y)
        value = -0.5 * u**2 - _LOG_SQRT_2PI - np.log(sd)
        value = np.where(self.degenerate[:, None], -np.inf, value)
        return value.reshape(np.shape(y))

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N,) or (N, G)."""
        return np.exp(self.log_pdf(y))

    def cdf(self, y: ArrayLike) -> Array:
        """Probability of an outcome not above y (N,) or (N, G)."""
        u, _ = self._standardized(y)
        step = by_experiment(y, self.mean.size, "the outcome") >= self.mean[:, None]
        return np.where(self.degenerate[:, None], step, ndtr(u)).reshape(np.shape(y))

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,)."""
        mean, sd = self.safe()
        outcome = mean[:, None] + sd[:, None] * ndtri(probabilities(p))
        point = np.where(self.sd <= SMALLEST_SD, self.mean, np.nan)
        return np.where(self.degenerate[:, None], point[:, None], outcome)

    def sensitivity(self, y: ArrayLike) -> Sensitivity:
        """Value for the search at y (N,) with its partial derivatives, cost O(N).

        d log f/d mean = u/sd, d log f/d sd = (u^2 - 1)/sd. Without a density, or for an outcome
        that is not finite, the value is DEGENERATE_VALUE with zero derivatives.
        """
        outcome = one_per_experiment(y, self.mean.size, "the outcome")
        none = self.degenerate | ~np.isfinite(outcome)
        mean, sd = self.safe()
        u = in_sds(np.where(none, mean, outcome), mean, sd)
        value = -0.5 * u**2 - _LOG_SQRT_2PI - np.log(sd)
        zero = np.zeros_like(u)
        return Sensitivity(
            value=np.where(none, DEGENERATE_VALUE, value),
            d_mean=np.where(none, 0.0, u / sd),
            d_sd=np.where(none, 0.0, (u**2 - 1.0) / sd),
            d_standardized=np.zeros((u.size, self.columns)),
            d_lower=zero,
            d_upper=zero.copy(),
            status=np.where(none, Status.DEGENERATE, Status.SOLVED).astype(np.int64),
        )
