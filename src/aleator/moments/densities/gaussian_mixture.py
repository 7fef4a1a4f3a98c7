"""The sum of two normal densities that has the first five moments of the outcome."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aleator.moments.densities.gaussian import FittedGaussian
from aleator.moments.densities.interface import FAILED_SOLVE_PENALTY, Codes, check_moments
from aleator.moments.densities.moments import Moments
from aleator.moments.densities.normal_sum import NormalSum
from aleator.moments.densities.pearson import Mixtures, two_normals, two_scales
from aleator.moments.densities.standardized import FittedStandardized
from aleator.status import Status
from aleator.threads import single_threaded
from aleator.types import Array

SAME = 1e-6
"""Moments that differ by less from those of a normal, or of a symmetric law, are those."""

_STEEPNESS = 10.0

_NORMAL = np.array([1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0])

_EDGEWORTH = np.array([1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0])


@dataclass(frozen=True)
class GaussianMixture:
    """The mixture of two normals with five moments of the outcome (Pearson, 1894).

    f(y) = w_1 Normal(y; m_1, s_1^2) + (1 - w_1) Normal(y; m_2, s_2^2), one of the three densities
    that the paper compares. Several mixtures may have the five moments: roots of Pearson's nonic
    (module `pearson`). The one nearest in the sixth moment is taken, so six are needed. The range
    of the outcome is not used. A skewness and a fifth cumulant under 1e-6 with a kurtosis above 3
    take the mixture of one mean with two variances; moments within 1e-6 of a normal law's are
    the normal law.

    Where no mixture has the moments (a lognormal law, some bounded ones), or only one with a normal
    narrower than a hundredth of the outcome's sd, the status is NO_MIXTURE and the normal density
    stands in. The choice between two mixtures, and their end, are jumps of the likelihood: a search
    by gradient may stop there. Cost: some 0.1 ms an experiment. Raises InputsError for too few
    moments.

    >>> nine = np.array([1.0, 0.0, 1.0, 0.0, 2.5, 0.0, 8.5])  # 1/2 N(-c, 1/2) + 1/2 N(c, 1/2)
    >>> m = Moments(np.array([0.0]), np.array([1.0]), nine[None])
    >>> fitted = GaussianMixture().fit(m, -np.inf, np.inf)
    >>> fitted.parts.means.round(6).tolist(), fitted.parts.variances.round(6).tolist()
    ([[-0.707107, 0.707107]], [[0.5, 0.5]])
    """

    @property
    def order(self) -> int:
        """Number of moments that the density needs: five, and the sixth to choose."""
        return 6

    @property
    def name(self) -> str:
        """Name for reports."""
        return "gaussian mixture"

    @single_threaded
    def fit(
        self,
        moments: Moments,
        lower: ArrayLike,  # noqa: ARG002  one interface for all densities
        upper: ArrayLike,  # noqa: ARG002
    ) -> FittedGaussianMixture:
        """Fit N mixtures; lower and upper are not used."""
        check_moments(moments, self.order, self.name)
        normal = FittedGaussian(moments.mean, moments.sd, moments.standardized.shape[1])
        standardized = moments.standardized[:, :7]
        parts = _normal_parts(standardized.shape[0])
        known = np.isfinite(standardized).all(axis=1) & ~normal.degenerate
        gap = _gap(np.where(known[:, None], standardized, _NORMAL))
        plain = known & (np.abs(gap) < SAME).all(axis=1)
        scales = known & ~plain & (np.abs(gap[:, [0, 2]]) < SAME).all(axis=1) & (gap[:, 1] > 0.0)
        for rows, solve in ((scales, two_scales), (known & ~plain & ~scales, two_normals)):
            _put(parts, np.flatnonzero(rows), solve(standardized[rows]))
        parts.exists[plain] = True
        return FittedGaussianMixture(normal, parts, standardized)


def _gap(standardized: Array) -> Array:
    """Cumulants 3, 4, 5 (N, 3) of the standardized outcome: zero for a normal law."""
    third = standardized[:, 3]
    return np.stack([third, standardized[:, 4] - 3.0, standardized[:, 5] - 10.0 * third], axis=1)


def _normal_parts(count: int) -> Mixtures:
    return Mixtures(
        weights=np.full((count, 2), 0.5),
        means=np.zeros((count, 2)),
        variances=np.ones((count, 2)),
        slopes=np.zeros((count, 5, 4)),
        exists=np.zeros(count, dtype=bool),
    )


def _put(parts: Mixtures, rows: Codes, found: Mixtures) -> None:
    """Write the mixtures that exist into these rows."""
    for name, values in vars(found).items():
        getattr(parts, name)[rows[found.exists]] = values[found.exists]


@dataclass(frozen=True)
class FittedGaussianMixture(FittedStandardized):
    """Mixtures of N experiments; methods as in `FittedDensity`.

    `parts` are the normals in units of sd about the mean, twice the normal density where no
    mixture exists; `normal` serves the experiments without scatter.
    """

    normal: FittedGaussian
    parts: Mixtures
    standardized: Array

    @property
    def status(self) -> Codes:
        """(N,) SOLVED, NO_MIXTURE or DEGENERATE."""
        found = np.where(self.parts.exists, Status.SOLVED, Status.NO_MIXTURE)
        return np.where(self.normal.degenerate, Status.DEGENERATE, found).astype(np.int64)

    @property
    def _sum(self) -> NormalSum:
        return NormalSum(self.parts.weights, self.parts.means, np.sqrt(self.parts.variances))

    def log_density(self, u: Array) -> Array:
        """log g at u (N, G)."""
        return self._sum.log_pdf(u)

    def below(self, u: Array) -> Array:
        """Probability (N, G) of less than u (N, G)."""
        return self._sum.cdf(u)

    def inverse(self, p: Array) -> Array:
        """u (N, P) with probabilities p (P,) below."""
        return self._sum.quantile(p)

    def partials(self, u: Array) -> tuple[Array, Array, Array]:
        """Value (N,) for the search at u (N,), its slope (N,), and (N, M+1) by the moments.

        With s_i the share of normal i in g(u) and z_i = (u - d_i)/sqrt(v_i):
        d log g = (s_1/w_1 - s_2/w_2) dw_1
                  + sum_i s_i (z_i/sqrt(v_i) dd_i + (z_i^2 - 1)/(2 v_i) dv_i),
        and d(w, d, v) by the moments from the implicit function theorem.

        Without a mixture the value is that of the normal density less
        FAILED_SOLVE_PENALTY (1 - exp(-10 g)), g = c_3^2/6 + c_4^2/24 + c_5^2/120 with the cumulants
        c of the standardized outcome: g/2 is what the normal density loses (Edgeworth), and nothing
        is taken from an outcome that is normal.
        """
        value, d_u, by_moment = self._value(u)
        d_standardized = np.zeros((u.size, self.normal.columns))
        d_standardized[:, 3:7] = by_moment
        return value, d_u, d_standardized

    def _value(self, u: Array) -> tuple[Array, Array, Array]:
        """Value (N,) at u (N,), its slope by u (N,) and by the moments 3 to 6 (N, 4)."""
        w, d, v = self.parts.weights, self.parts.means, self.parts.variances
        log_parts = self._sum.parts(u)
        value = self._sum.log_pdf(u[:, None])[:, 0]
        by_weight = np.exp(np.minimum(log_parts - value[:, None], -np.log(w)))
        share = w * by_weight
        z = (u[:, None] - d) / np.sqrt(v)
        by_mean = share * z / np.sqrt(v)
        by_variance = 0.5 * share * (z**2 - 1.0) / v
        by_parts = np.concatenate(
            [by_weight[:, :1] - by_weight[:, 1:], by_mean, by_variance], axis=1
        )
        penalty, by_moment = self._penalty()
        by_moment = np.einsum("ni,nim->nm", by_parts, self.parts.slopes) - by_moment
        return value - penalty, -by_mean.sum(axis=1), by_moment

    def _penalty(self) -> tuple[Array, Array]:
        """(N,), zero where a mixture exists, and its slopes (N, 4) by the moments 3 to 6."""
        known = np.asarray(np.isfinite(self.standardized).all(axis=1))
        gap = _gap(np.where(known[:, None], self.standardized, _NORMAL))
        kept = np.exp(-_STEEPNESS * np.minimum(gap**2 @ _EDGEWORTH, 100.0))
        slope = 2.0 * FAILED_SOLVE_PENALTY * _STEEPNESS * kept[:, None] * gap * _EDGEWORTH
        by_moment = np.zeros((gap.shape[0], 4))
        by_moment[:, :3] = slope
        # the fifth cumulant falls by ten times the third moment
        by_moment[:, 0] -= 10.0 * slope[:, 2]
        absent = ~self.parts.exists
        penalty = FAILED_SOLVE_PENALTY * np.where(known, 1.0 - kept, 1.0)
        return np.where(absent, penalty, 0.0), np.where(absent[:, None], by_moment, 0.0)
