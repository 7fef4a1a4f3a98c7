"""Pearson's equations: the mixtures of two normals that have five given moments.

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

A root p < 0 with v_1, v_2 > 0 is a mixture. Where m_3 = k_5 = 0 < k_4 the only one has p = 0: both
normals share their mean, a fourth moment leaves one of their family free, and the sixth takes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.types import Array, Flags

LARGEST_ERROR = 1e-8
"""Distance of a moment recomputed from the mixture, above which a root is not one."""

SMALLEST_PART = 1e-2
"""A normal narrower than this part of the outcome's sd is a spike, not a density.

So the density gains at most log(100) = 4.6 over the normal one: less than the penalty."""

_POLISHES = 12


@dataclass(frozen=True)
class Mixtures:
    """Weights, means and variances (N, 2) of the normals, in units of the outcome's sd about its
    mean; `slopes` (N, 5, 4): the derivatives of w_1, d_1, d_2, v_1, v_2 by the standardized moments
    3 to 6; `exists` (N,)."""

    weights: Array
    means: Array
    variances: Array
    slopes: Array
    exists: Flags


def mixture_moments(weights: Array, means: Array, variances: Array) -> Array:
    """Moments 0..6 (..., 7) about zero of sums of two normals (..., 2).

    >>> half = np.array([0.5, 0.5])
    >>> mixture_moments(half, np.array([-1.0, 1.0]), np.array([1.0, 1.0])).tolist()
    [1.0, 0.0, 2.0, 0.0, 10.0, 0.0, 76.0]
    """
    d, v = means, variances
    powers = [np.ones_like(d), d]
    for m in range(1, 6):
        # E x^(m+1) = d E x^m + m v E x^(m-1) of a normal law
        powers.append(d * powers[m] + m * v * powers[m - 1])
    return np.asarray(np.einsum("...j,...jm->...m", weights, np.stack(powers, axis=-1)))


def two_normals(standardized: Array) -> Mixtures:
    """The mixture (N,) with the standardized moments 3, 4, 5 that is nearest in the sixth.

    `standardized` (N, 7), finite. All nine roots of the nonic are found as eigenvalues of its
    companion matrix and polished by Newton's method on F_4, F_5. Cost: some 0.1 ms a row.
    """
    m3, k4, k5 = _cumulants(standardized)
    p, r = _polish(*_starts(m3, k4, k5), m3[:, None], k4[:, None], k5[:, None])
    with np.errstate(all="ignore"):
        weights, means, variances = _parts(p, r, m3[:, None])
        moments = mixture_moments(weights, means, variances)
        asked = standardized[:, None, 1:6]
        error = np.abs(moments[..., 1:6] - asked) / np.maximum(1.0, np.abs(asked))
        valid = (p < 0.0) & (variances >= SMALLEST_PART**2).all(axis=2)
        valid &= error.max(axis=2) <= LARGEST_ERROR
        sixth = np.abs(moments[..., 6] - standardized[:, None, 6])
        best = np.argmin(np.where(valid, sixth, np.inf), axis=1)
        rows = np.arange(best.size)
        slopes = _slopes(p[rows, best], r[rows, best], m3, k4, k5)
    exists = valid[rows, best] & np.isfinite(slopes).all(axis=(1, 2))
    return Mixtures(weights[rows, best], means[rows, best], variances[rows, best], slopes, exists)


def two_scales(standardized: Array) -> Mixtures:
    """The mixture of two normals of the same mean with the moments 4 and 6, odd ones zero.

    With n_2 = m_4/3, n_3 = m_6/15 the variances are the nodes of the Gauss rule with moments
    1, 1, n_2, n_3: the roots of v^2 - e v + (e - n_2), e = (n_3 - n_2)/(n_2 - 1).
    """
    n2, n3 = standardized[:, 4] / 3.0, standardized[:, 6] / 15.0
    with np.errstate(all="ignore"):
        e = (n3 - n2) / (n2 - 1.0)
        root = np.sqrt((e - 2.0) ** 2 + 4.0 * (n2 - 1.0))
        v = np.stack([0.5 * (e - root), 0.5 * (e + root)], axis=1)
        by_n2 = -(1.0 + e) / (n2 - 1.0)
        by_n3 = 1.0 / (n2 - 1.0)
        # (2 v - e) dv = (v - 1) de + dn2
        sign = np.stack([-root, root], axis=1)
        d_v = np.zeros((n2.size, 2, 4))
        d_v[:, :, 1] = ((v - 1.0) * by_n2[:, None] + 1.0) / sign / 3.0
        d_v[:, :, 3] = (v - 1.0) * by_n3[:, None] / sign / 15.0
        first = (v[:, 1] - 1.0) / root
        d_root = d_v[:, 1] - d_v[:, 0]
        d_first = (d_v[:, 1] - first[:, None] * d_root) / root[:, None]
    slopes = np.zeros((n2.size, 5, 4))
    slopes[:, 0], slopes[:, 3:] = d_first, d_v
    exists = np.isfinite(slopes).all(axis=(1, 2)) & (v >= SMALLEST_PART**2).all(axis=1)
    exists &= n2 > 1.0
    return Mixtures(np.stack([first, 1.0 - first], axis=1), np.zeros_like(v), v, slopes, exists)


def _cumulants(standardized: Array) -> tuple[Array, Array, Array]:
    m3 = standardized[:, 3]
    return m3, standardized[:, 4] - 3.0, standardized[:, 5] - 10.0 * m3


def _starts(m3: Array, k4: Array, k5: Array) -> tuple[Array, Array]:
    """Real parts p (N, 18) of the nine roots, each with both r of F_4."""
    zero = np.zeros_like(m3)
    ours = np.stack([2.0 * m3**3, 6.0 * m3 * k4, 3.0 * k5, -8.0 * m3])
    divisor = np.stack([4.0 * m3**2, 3.0 * k4, zero, zero + 2.0])
    rest = np.stack([m3**2, 3.0 * k4, zero, zero + 6.0])
    mixed = _product(_product(ours, 2.0 * ours + 4.0 * m3 * divisor), np.ones((1, m3.size)))
    cubic = _product(rest, _product(divisor, divisor))
    coefficients = -cubic
    coefficients[: mixed.shape[0]] += mixed
    companion = np.zeros((m3.size, 9, 9))
    companion[:, np.arange(1, 9), np.arange(8)] = 1.0
    # the leading coefficient is -24
    companion[:, :, 8] = (coefficients[:9] / 24.0).T
    p = np.linalg.eigvals(companion).real
    half = np.sqrt(np.maximum(1.5 * _column(m3**2) + 1.5 * _column(k4) * p + 3.0 * p**3, 0.0))
    return np.tile(p, 2), np.concatenate([-_column(m3) + half, -_column(m3) - half], axis=1)


def _product(a: Array, b: Array) -> Array:
    """Product of polynomials with coefficients (degree+1, N), the constant first."""
    out = np.zeros((a.shape[0] + b.shape[0] - 1, a.shape[1]))
    for i in range(a.shape[0]):
        out[i : i + b.shape[0]] += a[i] * b
    return out


def _column(values: Array) -> Array:
    return values[:, None]


def _equations(
    p: Array, r: Array, m3: Array, k4: Array, k5: Array
) -> tuple[tuple[Array, Array], tuple[Array, Array], tuple[Array, Array]]:
    """(F_4, F_5), and their derivatives by p and by r."""
    return (
        (
            2.0 * r**2 + 4.0 * m3 * r - 6.0 * p**3 - 3.0 * k4 * p - m3**2,
            2.0 * r**3 - (5.0 * m3**2 + 4.0 * p**3) * r + 20.0 * m3 * p**3 - 3.0 * k5 * p**2,
        ),
        (
            -18.0 * p**2 - 3.0 * k4,
            -12.0 * p**2 * r + 60.0 * m3 * p**2 - 6.0 * k5 * p,
        ),
        (
            4.0 * r + 4.0 * m3,
            6.0 * r**2 - 5.0 * m3**2 - 4.0 * p**3,
        ),
    )


def _polish(p: Array, r: Array, m3: Array, k4: Array, k5: Array) -> tuple[Array, Array]:
    with np.errstate(all="ignore"):
        for _ in range(_POLISHES):
            f, by_p, by_r = _equations(p, r, m3, k4, k5)
            determinant = by_p[0] * by_r[1] - by_r[0] * by_p[1]
            step_p = (f[0] * by_r[1] - f[1] * by_r[0]) / determinant
            step_r = (f[1] * by_p[0] - f[0] * by_p[1]) / determinant
            moves = np.isfinite(step_p) & np.isfinite(step_r)
            p, r = np.where(moves, p - step_p, p), np.where(moves, r - step_r, r)
    return p, r


def _parts(p: Array, r: Array, m3: Array) -> tuple[Array, Array, Array]:
    """Weights, means, variances (..., 2), the mean below zero first."""
    s = r / p
    root = np.sqrt(s**2 - 4.0 * p)
    # the larger root of d^2 - s d + p first, so that nothing cancels
    large = 0.5 * (s + np.where(s < 0.0, -root, root))
    small = p / large
    means = np.stack([np.minimum(large, small), np.maximum(large, small)], axis=-1)
    weights = np.stack([means[..., 1], -means[..., 0]], axis=-1) / root[..., None]
    slope = -(m3 + r) / (3.0 * p)
    return weights, means, (1.0 + p)[..., None] + slope[..., None] * means


def _slopes(p: Array, r: Array, m3: Array, k4: Array, k5: Array) -> Array:
    """(N, 5, 4) by the implicit function theorem on F_4, F_5."""
    means = _parts(p, r, m3)[1]
    _, by_p, by_r = _equations(p, r, m3, k4, k5)
    zero = np.zeros_like(p)
    # columns: standardized moments 3, 4, 5, 6; the third moves k_5 as well
    f4 = np.stack([4.0 * r - 2.0 * m3, -3.0 * p, zero, zero], axis=1)
    f5 = np.stack([20.0 * p**3 - 10.0 * m3 * r + 30.0 * p**2, zero, -3.0 * p**2, zero], axis=1)
    determinant = _column(by_p[0] * by_r[1] - by_r[0] * by_p[1])
    dp = -(f4 * _column(by_r[1]) - f5 * _column(by_r[0])) / determinant
    dr = -(f5 * _column(by_p[0]) - f4 * _column(by_p[1])) / determinant
    s, p, r = _column(r / p), _column(p), _column(r)
    ds = (dr - s * dp) / p
    third = np.array([1.0, 0.0, 0.0, 0.0])
    slope = -(_column(m3) + r) / (3.0 * p)
    dslope = -(third + dr) / (3.0 * p) - slope * dp / p
    d = [_column(means[:, i]) for i in range(2)]
    dd = [(d[i] * ds - dp) / (2.0 * d[i] - s) for i in range(2)]
    dw = (d[1] * dd[0] - d[0] * dd[1]) / (d[1] - d[0]) ** 2
    dv = [dp + slope * dd[i] + d[i] * dslope for i in range(2)]
    return np.stack([dw, *dd, *dv], axis=1)
