"""Orthogonal polynomials of one variable by their three-term recurrence, and their Gauss rules.

A family of polynomials is given by the coefficients a_k and b_k of
    sqrt(b_(k+1)) p_(k+1)(t) = (t - a_k) p_k(t) - sqrt(b_k) p_(k-1)(t),   p_0 = 1,
for a weight that integrates to one (Gautschi, Orthogonal Polynomials, 2004, sec. 1.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array, Indices

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
    """Recurrence coefficients of the generalized Laguerre family, for a standardized gamma law.

    The variable t = (g - k)/sqrt(k) has mean 0 and sd 1, where g has a gamma law of shape k = 1/c^2
    and c = `variation` is its coefficient of variation. Then a_n = 2 n c and b_n = n (1 + (n - 1)
    c^2) (Gautschi, table 1.1, shifted and scaled). There is no cancellation for large k; c = 0
    gives the Hermite family. A complex c serves derivatives by a complex step.

    >>> laguerre_recurrence(3, 1.0)[0].tolist()      # exponential law: 2 n + 1, less its mean 1
    [0.0, 2.0, 4.0]
    """
    n, c = np.arange(count), np.asarray(variation)
    b = np.asarray(n * (1.0 + (n - 1) * c**2))
    b[0] = 1.0
    return np.asarray(2.0 * n * c), b


def jacobi_recurrence(count: int, p: Value, q: Value) -> tuple[Coefficients, Coefficients]:
    """Recurrence coefficients of the Jacobi family, for a standardized beta law.

    The beta law has density x^(p-1) (1-x)^(q-1)/B(p, q) on [0, 1], p, q > 0. The variable is (x - E
    x)/sd x, with mean 0 and sd 1. With s = p + q and t = 2 x - 1, a_n = -(sd t)^-1 4 n (p - q)(n +
    s - 1)/(s (2n+s-2)(2n+s)), where sd t = sqrt(4 p q/(s^2 (s + 1))) (Gautschi, table 1.1, shifted
    and scaled so that there is no cancellation for large p and q). Complex p, q serve derivatives
    by a complex step.

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
    """Recurrence coefficients a and b (count,) of a family, and their derivatives (count, k).

    The derivatives are those by the k parameters of the family. A complex step of 1e-30 makes them
    exact to rounding; the family must be analytic in its parameters.

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
    """Recurrence coefficients for the discrete weight on points t, by the Stieltjes procedure.

    a_k = <t p_k, p_k>, and b_k is the squared norm of p_k before it is scaled (Gautschi, sec. 2.2).
    `t` and `weights` are (..., Q) with weights that sum to one along the last axis; the
    coefficients a and b are (..., count). `count` must be well below Q; orthogonality is lost
    otherwise. Cost O(count Q).

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
    """Whether the weight is symmetric about its mean: all a_k are the same, to rounding.

    >>> symmetric(*hermite_recurrence(5))
    True
    """
    return bool(np.all(np.abs(a - a[0]) <= 1e-13 * np.sqrt(np.max(b))))


def gauss(a: Array, b: Array) -> tuple[Array, Array]:
    """Nodes and weights (..., q) of the q-point Gauss rule, exact to degree 2q - 1.

    The nodes are the eigenvalues of the Jacobi matrix of the recurrence coefficients a, b
    (..., q); a weight is the squared first component of an eigenvector (Golub and Welsch, 1969).
    The weights sum to one. Cost O(q^3).

    >>> t, w = gauss(*hermite_recurrence(3))
    >>> t.round(6).tolist(), w.round(6).tolist()
    ([-1.732051, -0.0, 1.732051], [0.166667, 0.666667, 0.166667])
    """
    nodes, vectors = np.linalg.eigh(_tridiagonal(a, np.sqrt(b[..., 1:])))
    return nodes, vectors[..., 0, :] ** 2


def gauss_with_gradient(
    a: Array, b: Array, da: Array, db: Array
) -> tuple[Array, Array, Array, Array]:
    """The q-point Gauss rule and its exact derivatives by k parameters.

    Returns nodes (q,), weights (q,), and the derivatives of both (q, k). `da` and `db` (q, k) are
    the derivatives of the recurrence coefficients a and b (q,). For a symmetric matrix J with
    eigenvectors v_i and simple eigenvalues t_i, dt_i = v_i' dJ v_i and dv_i = sum_(j != i) v_j
    (v_j' dJ v_i)/(t_i - t_j). A Jacobi matrix has simple eigenvalues (Golub and Welsch, 1969). Cost
    O(k q^3).

    >>> a, b = hermite_recurrence(2)                   # scaled by c: nodes c and -c, weights stay
    >>> parts = gauss_with_gradient(a, b, np.zeros((2, 1)), np.array([[0.0], [2.0]]))
    >>> parts[2].round(6).ravel().tolist(), (parts[3] + 0.0).round(6).ravel().tolist()
    ([-1.0, 1.0], [0.0, 0.0])
    """
    nodes, vectors = np.linalg.eigh(_tridiagonal(a, np.sqrt(b[1:])))
    off = 0.5 * db[1:] / np.sqrt(b[1:, None])
    change = np.stack([_tridiagonal(d, o) for d, o in zip(da.T, off.T, strict=True)])
    coupled = vectors.T @ change @ vectors
    gaps = nodes[None, :] - nodes[:, None]
    np.fill_diagonal(gaps, np.inf)
    first = vectors[0]
    dfirst = np.einsum("j,kji->ik", first, coupled / gaps)
    dnodes = np.diagonal(coupled, axis1=1, axis2=2).T
    return nodes, first**2, dnodes, 2.0 * first[:, None] * dfirst


def polished_rule(a: Array, b: Array, degree: int) -> tuple[Array, Array, Array]:
    """Gauss rule exact to `degree`: nodes t (q,), weights w (q,), values p_k(t_j) (q, q).

    The weights keep their relative accuracy, which matters where high powers of a polynomial are
    integrated. `gauss` takes a weight from the squared component of an eigenvector, with an
    absolute error of about 1e-16. But an outer node of a 17-point Hermite rule has the weight
    1e-13, and the eighth power of a polynomial of degree four multiplies it by more than 1e20. So
    here the nodes are improved by Newton's method, and the weights are computed from the
    polynomials.

    q = floor(degree/2) + 1. With S(t) = sum_(k<q) p_k(t)^2 the weights are w_j = 1/S(t_j). By the
    Christoffel-Darboux formula a step of Newton's method is r(t) p_(q-1)(t)/S(t), where r is p_q
    before it is scaled (Gautschi, Orthogonal Polynomials, 2004, sec. 1.3.3 and 1.4.2). `a` and `b`
    hold at least q recurrence coefficients. Cost O(q^3).

    >>> t, w, p = polished_rule(*hermite_recurrence(3), 4)
    >>> t.round(6).tolist(), w.round(6).tolist()
    ([-1.732051, 0.0, 1.732051], [0.166667, 0.666667, 0.166667])
    """
    q = degree // 2 + 1
    t = np.asarray(gauss(a[:q], b[:q])[0], dtype=float)
    for _ in range(2):  # Each Newton step doubles the correct digits, and most are correct before.
        p = evaluate(a, b, t, q - 1)
        below = np.sqrt(b[q - 1]) * p[:, q - 2] if q > 1 else 0.0
        t = t - ((t - a[q - 1]) * p[:, -1] - below) * p[:, -1] / np.sum(p**2, axis=1)
    p = evaluate(a, b, t, q - 1)
    return t + 0.0, 1.0 / np.sum(p**2, axis=1), p


def _tridiagonal(diagonal: Array, off: Array) -> Array:
    """Tridiagonal matrices (..., q, q) from diagonals (..., q) and off-diagonals (..., q - 1)."""
    q = diagonal.shape[-1]
    matrix = np.zeros((*diagonal.shape, q))
    rows = np.arange(q)
    matrix[..., rows, rows] = diagonal
    matrix[..., rows[1:], rows[:-1]] = off
    matrix[..., rows[:-1], rows[1:]] = off
    return matrix


@lru_cache
def gauss_hermite(q: int) -> tuple[Array, Array]:
    """The q-point Gauss rule of the standard normal law; read-only arrays (q,), (q,).

    >>> t, w = gauss_hermite(5)
    >>> round(float(w @ t**8), 9)
    105.0
    """
    return _frozen(gauss(*hermite_recurrence(q)))


@lru_cache
def gauss_legendre(q: int) -> tuple[Array, Array]:
    """The q-point Gauss rule of the uniform law on [-1, 1]; weights sum to one.

    >>> t, w = gauss_legendre(2)
    >>> round(float(w @ t**2), 12)
    0.333333333333
    """
    t, w = np.polynomial.legendre.leggauss(q)
    return _frozen((t, w / 2.0))


def tensor(sizes: tuple[int, ...]) -> Indices:
    """Index tuples (J, n) of a tensor product of n one-dimensional rules, J = product of sizes.

    >>> tensor((2, 2)).tolist()
    [[0, 0], [0, 1], [1, 0], [1, 1]]
    """
    return np.indices(sizes).reshape(len(sizes), -1).T


def _frozen(arrays: tuple[Array, Array]) -> tuple[Array, Array]:
    for array in arrays:
        array.setflags(write=False)
    return arrays
