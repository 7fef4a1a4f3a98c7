"""Orthonormal polynomials by their three-term recurrence.

Every family is known by the coefficients of
    sqrt(b_(k+1)) p_(k+1)(t) = (t - a_k) p_k(t) - sqrt(b_k) p_(k-1)(t),   p_0 = 1,
for a weight that integrates to one (Gautschi, Orthogonal Polynomials, 2004, sec. 1.3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def hermite_recurrence(count: int) -> tuple[Array, Array]:
    """Recurrence coefficients a (count,), b (count,) of the Hermite family, weight N(0, 1).

    a_k = 0 and b_k = k, with b_0 = 1.

    >>> hermite_recurrence(3)[1].tolist()
    [1.0, 1.0, 2.0]
    """
    return np.zeros(count), np.maximum(np.arange(count, dtype=float), np.arange(count) == 0)


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
