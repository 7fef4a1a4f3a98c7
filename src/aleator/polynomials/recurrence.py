"""Orthonormal polynomials by their three-term recurrence.

Every family is known by the coefficients of
    sqrt(b_(k+1)) p_(k+1)(t) = (t - a_k) p_k(t) - sqrt(b_k) p_(k-1)(t),   p_0 = 1,
for a weight that integrates to one (Gautschi, Orthogonal Polynomials, 2004, sec. 1.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from aleator.types import Array

SYMMETRY = 1e-13
"""Centers a_k that differ by less than this, relative to the scale of the weight, are one."""

Value = float | complex
Coefficients = NDArray[np.float64] | NDArray[np.complex128]


def hermite_recurrence(count: int) -> tuple[Array, Array]:
    """Recurrence coefficients a (count,), b (count,) of the Hermite family, weight N(0, 1).

    a_k = 0 and b_k = k, with b_0 = 1.

    >>> hermite_recurrence(3)[1].tolist()
    [1.0, 1.0, 2.0]
    """
    return np.zeros(count), np.maximum(np.arange(count, dtype=float), np.arange(count) == 0)


def legendre_recurrence(count: int) -> tuple[Array, Array]:
    """Recurrence coefficients a (count,), b (count,) of the Legendre family, uniform on [-1, 1].

    a_k = 0 and b_k = k^2/(4 k^2 - 1), with b_0 = 1.

    >>> legendre_recurrence(3)[1].round(6).tolist()
    [1.0, 0.333333, 0.266667]
    """
    k = np.arange(1, count, dtype=float)
    return np.zeros(count), np.concatenate([np.ones(1), k**2 / (4.0 * k**2 - 1.0)])


def laguerre_recurrence(count: int, variation: Value) -> tuple[Coefficients, Coefficients]:
    """The generalized Laguerre family in the gamma law's own units: its weight has mean 0 and sd 1.

    t = (g - k)/sqrt(k) with g of a gamma law of shape k = 1/variation^2 has a_n = 2 n c and
    b_n = n (1 + (n - 1) c^2), c = `variation` (Gautschi, table 1.1, shifted and scaled). Nothing
    cancels for large k: c = 0 is the Hermite family. Complex c serves derivatives by a complex
    step.

    >>> laguerre_recurrence(3, 1.0)[0].tolist()      # exponential law: 2 n + 1, less its mean 1
    [0.0, 2.0, 4.0]
    """
    n, c = np.arange(count), np.asarray(variation)
    b = np.asarray(n * (1.0 + (n - 1) * c**2))
    b[0] = 1.0
    return np.asarray(2.0 * n * c), b


def jacobi_recurrence(count: int, p: Value, q: Value) -> tuple[Coefficients, Coefficients]:
    """The Jacobi family in the beta law's own units: its weight has mean 0 and sd 1.

    The beta law has density x^(p-1) (1-x)^(q-1)/B(p, q) on [0, 1], p, q > 0. With s = p + q, in
    the coordinate (x - E x)/sd x, a_n = -(sd t)^-1 4 n (p - q)(n + s - 1)/(s (2n+s-2)(2n+s)) with
    sd t = sqrt(4 p q/(s^2 (s + 1))) (Gautschi, table 1.1, shifted and scaled so that nothing
    cancels for large p and q). Complex p, q serve derivatives by a complex step.

    >>> legendre = legendre_recurrence(4)[1]
    >>> bool(np.allclose(jacobi_recurrence(4, 1.0, 1.0)[1][1:], 3.0 * legendre[1:]))
    True
    """
    s = p + q
    n = np.arange(1, count, dtype=float)
    variance = 4.0 * p * q / (s**2 * (s + 1.0))
    shift = -4.0 * n * (p - q) * (n + s - 1.0) / (s * (2.0 * n + s - 2.0) * (2.0 * n + s))
    m = n[1:]
    above = 4.0 * m * (m + p - 1.0) * (m + q - 1.0) * (m + s - 2.0)
    below = (2.0 * m + s - 2.0) ** 2 * (2.0 * m + s - 1.0) * (2.0 * m + s - 3.0)
    a = np.concatenate([np.zeros(1), shift / np.sqrt(variance)])
    b = np.concatenate([np.ones(min(count, 2)), above / (below * variance)])
    return a, b


def recurrence_with_gradient(
    family: Callable[..., tuple[Coefficients, Coefficients]],
    count: int,
    parameters: Sequence[float],
) -> tuple[Array, Array, Array, Array]:
    """A family's coefficients (count,), (count,) and derivatives (count, k) by its k parameters.

    A complex step of 1e-30 makes the derivatives exact to rounding; the family must be analytic.

    >>> recurrence_with_gradient(laguerre_recurrence, 3, [0.5])[2].tolist()
    [[0.0], [2.0], [4.0]]
    """
    a, b = family(count, *parameters)
    da, db = np.empty((count, len(parameters))), np.empty((count, len(parameters)))
    for k in range(len(parameters)):
        moved = [value + 1e-30j * (i == k) for i, value in enumerate(parameters)]
        da[:, k], db[:, k] = (np.imag(part) / 1e-30 for part in family(count, *moved))
    return np.real(a), np.real(b), da, db


def stieltjes(t: Array, weights: Array, count: int) -> tuple[Array, Array]:
    """Recurrence coefficients of the weights on the points t, by the Stieltjes procedure.

    a_k = <t p_k, p_k> and b_k = |the next polynomial before scaling|^2 (Gautschi, sec. 2.2).
    `t` and `weights` are (..., Q) with weights that sum to one along the last axis; returns
    a (..., count), b (..., count). Needs count well below Q; orthogonality is lost otherwise.
    Cost O(count Q).

    >>> t, w = np.polynomial.legendre.leggauss(50)
    >>> a, b = stieltjes(t, w / 2, 3)            # Legendre: b_k = k^2/(4 k^2 - 1)
    >>> bool(np.allclose(b[1:], [1 / 3, 4 / 15]))
    True
    """
    a = np.zeros((*t.shape[:-1], count))
    b = np.ones((*t.shape[:-1], count))
    previous = np.zeros_like(t)
    current = np.ones_like(t)
    for k in range(count):
        a[..., k] = np.sum(weights * t * current**2, axis=-1)
        if k + 1 == count:
            break
        scale = np.sqrt(b[..., k, None]) if k else 0.0
        following = (t - a[..., k, None]) * current - scale * previous
        b[..., k + 1] = np.sum(weights * following**2, axis=-1)
        previous, current = current, following / np.sqrt(b[..., k + 1, None])
    return a, b


def evaluate(a: Array, b: Array, t: Array, degree: int) -> Array:
    """Orthonormal polynomials p_0..p_degree at t (J,), as (J, degree + 1).

    `a` and `b` hold at least degree + 1 recurrence coefficients.

    >>> a, b = hermite_recurrence(3)
    >>> evaluate(a, b, np.array([2.0]), 2).round(6).tolist()  # 1, t, (t^2 - 1)/sqrt(2)
    [[1.0, 2.0, 2.12132]]
    """
    values = np.ones((t.size, degree + 1))
    for k in range(degree):
        previous = np.sqrt(b[k]) * values[:, k - 1] if k else 0.0
        values[:, k + 1] = ((t - a[k]) * values[:, k] - previous) / np.sqrt(b[k + 1])
    return values


def symmetric(a: Array, b: Array) -> bool:
    """Whether the weight is symmetric about its mean: all a_k are the same.

    >>> symmetric(*hermite_recurrence(5))
    True
    """
    return bool(np.all(np.abs(a - a[0]) <= SYMMETRY * np.sqrt(np.max(b))))
