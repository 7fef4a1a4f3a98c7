"""The sum of two normal densities that has the first five moments of the outcome, to compare.

Of an outcome of mean 0 and variance 1, let the normals have means d_1 < 0 < d_2, weights w_i and
variances v_i. With p = d_1 d_2 and r = p (d_1 + d_2) the first three moments say

    w_1 = d_2/(d_2 - d_1),  v_i = 1 + p + b d_i,  b = -(m_3 + r)/(3 p),

and with the cumulants k_4 = m_4 - 3, k_5 = m_5 - 10 m_3 the fourth and the fifth say

    F_4 = 2 r^2 + 4 m_3 r - 6 p^3 - 3 k_4 p - m_3^2 = 0,
    F_5 = 2 r^3 - (5 m_3^2 + 4 p^3) r + 20 m_3 p^3 - 3 k_5 p^2 = 0.

F_5 reduced by F_4 is linear in r, D r = R with D = 4 m_3^2 + 3 k_4 p + 2 p^3 and
R = 2 m_3^3 + 6 m_3 k_4 p + 3 k_5 p^2 - 8 m_3 p^3; put into F_4 it leaves Pearson's nonic in p
(Phil. Trans. R. Soc. A 185, 1894, pp. 71-110):

    2 R^2 + 4 m_3 R D - (m_3^2 + 3 k_4 p + 6 p^3) D^2 = 0.

A root p < 0 with v_1, v_2 > 0 is a mixture; of several the nearest in the sixth moment is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from aleator.core.status import Status
from aleator.core.types import Array
from aleator.laws.law import invert
from aleator.moments.moments import Moments

NARROWEST = 1e-2  # a normal narrower than this part of the outcome's sd is a spike, no density


@dataclass(frozen=True)
class TwoNormals:
    """The mixture of two normals with five moments, chosen by the sixth (paper, Fig. 6)."""

    order = 6
    name = "two normals"

    def fit(self, moments: Moments, lower: ArrayLike, upper: ArrayLike) -> FittedTwoNormals:  # noqa: ARG002
        """Fit N mixtures; the range of the outcome is not used."""
        parts = np.stack([two_normals(m) for m in moments.standardized[:, :7]])
        sd = moments.sd[:, None]
        return FittedTwoNormals(
            parts[:, 0], moments.mean[:, None] + sd * parts[:, 1], sd * np.sqrt(parts[:, 2])
        )


@dataclass(frozen=True)
class FittedTwoNormals:
    """Mixtures of N experiments: weights, means and sds (N, 2), NaN where there is none."""

    weights: Array
    means: Array
    sds: Array

    @property
    def status(self) -> NDArray[np.int64]:
        """(N,) SOLVED, or NOT_REALIZABLE where no mixture has the moments."""
        none = np.isnan(self.means[:, 0])
        return np.where(none, Status.NOT_REALIZABLE, Status.SOLVED).astype(np.int64)

    def log_pdf(self, y: ArrayLike) -> Array:
        """The logarithm of the density."""
        with np.errstate(divide="ignore"):
            return np.log(self.pdf(y))

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N, G)."""
        z = (np.asarray(y)[:, :, None] - self.means[:, None]) / self.sds[:, None]
        normal = np.exp(-0.5 * z**2) / (self.sds[:, None] * np.sqrt(2.0 * np.pi))
        return np.asarray(np.einsum("ngj,nj->ng", normal, self.weights))

    def cdf(self, y: ArrayLike) -> Array:
        """Probability (N, G) of an outcome below y (N, G)."""
        z = (np.asarray(y)[:, :, None] - self.means[:, None]) / self.sds[:, None]
        return np.asarray(np.einsum("ngj,nj->ng", ndtr(z), self.weights))

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) with probabilities p (P,) below."""
        asked = np.broadcast_to(np.asarray(p, dtype=float), (len(self.means), np.size(p)))
        low = (self.means - 9.0 * self.sds).min(axis=1)[:, None] + 0.0 * asked
        high = (self.means + 9.0 * self.sds).max(axis=1)[:, None] + 0.0 * asked
        return invert(self.cdf, self.pdf, asked, low, high)


def two_normals(standardized: Array) -> Array:
    """Weights, means and variances (3, 2) from standardized moments (7,); NaN where none exists."""
    m3, k4 = standardized[3], standardized[4] - 3.0
    k5 = standardized[5] - 10.0 * m3
    rest = Polynomial([2.0 * m3**3, 6.0 * m3 * k4, 3.0 * k5, -8.0 * m3])
    divisor = Polynomial([4.0 * m3**2, 3.0 * k4, 0.0, 2.0])
    last = Polynomial([m3**2, 3.0 * k4, 0.0, 6.0])
    nonic = 2.0 * rest**2 + 4.0 * m3 * rest * divisor - last * divisor**2
    best, gap = np.full((3, 2), np.nan), np.inf
    for root in nonic.roots().real:
        # both r of F_4
        half = np.sqrt(max(1.5 * m3**2 + 1.5 * k4 * root + 3.0 * root**3, 0.0))
        for start in (-m3 + half, -m3 - half):
            p, r = _polished(root, start, m3, k4, k5)
            found = _parts(p, r, m3)
            moments = mixture_moments(*found)
            error = np.abs(moments - standardized) / np.maximum(1.0, np.abs(standardized))
            sixth = abs(moments[6] - standardized[6])
            wide = p < 0.0 and np.all(found[2] >= NARROWEST**2)
            if wide and np.all(error[1:6] <= 1e-8) and sixth < gap:
                best, gap = found, sixth
    return best


def mixture_moments(weights: Array, means: Array, variances: Array) -> Array:
    """Moments 0..6 (7,) about zero of a sum of two normals (2,).

    >>> half = np.array([0.5, 0.5])
    >>> mixture_moments(half, np.array([-1.0, 1.0]), np.array([1.0, 1.0])).tolist()
    [1.0, 0.0, 2.0, 0.0, 10.0, 0.0, 76.0]
    """
    powers = [np.ones(2), means]
    for m in range(1, 6):
        # E x^(m+1) = d E x^m + m v E x^(m-1) of a normal law
        powers.append(means * powers[m] + m * variances * powers[m - 1])
    return np.asarray(np.stack(powers) @ weights)


def _polished(p: float, r: float, m3: float, k4: float, k5: float) -> tuple[float, float]:
    """Newton's method on F_4 and F_5."""
    with np.errstate(all="ignore"):
        for _ in range(12):
            f = [
                2.0 * r**2 + 4.0 * m3 * r - 6.0 * p**3 - 3.0 * k4 * p - m3**2,
                2.0 * r**3 - (5.0 * m3**2 + 4.0 * p**3) * r + 20.0 * m3 * p**3 - 3.0 * k5 * p**2,
            ]
            by_p = [-18.0 * p**2 - 3.0 * k4, -12.0 * p**2 * r + 60.0 * m3 * p**2 - 6.0 * k5 * p]
            by_r = [4.0 * r + 4.0 * m3, 6.0 * r**2 - 5.0 * m3**2 - 4.0 * p**3]
            determinant = by_p[0] * by_r[1] - by_r[0] * by_p[1]
            step_p = np.divide(f[0] * by_r[1] - f[1] * by_r[0], determinant)
            step_r = np.divide(f[1] * by_p[0] - f[0] * by_p[1], determinant)
            if not (np.isfinite(step_p) and np.isfinite(step_r)):
                break
            p, r = p - step_p, r - step_r
    return p, r


def _parts(p: float, r: float, m3: float) -> Array:
    """Weights, means, variances (3, 2), the mean below zero first; NaN where there are none."""
    with np.errstate(all="ignore"):
        p, r = np.float64(p), np.float64(r)
        s = r / p
        root = np.sqrt(s**2 - 4.0 * p)
        # the larger root of d^2 - s d + p first, so that nothing cancels
        large = 0.5 * (s + (-root if s < 0.0 else root))
        means = np.sort([large, p / large])
        weights = np.array([means[1], -means[0]]) / root
        return np.stack([weights, means, 1.0 + p - (m3 + r) / (3.0 * p) * means])
