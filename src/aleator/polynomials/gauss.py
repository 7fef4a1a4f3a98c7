"""Gauss rules from recurrence coefficients, and their tensor product."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from aleator.polynomials.recurrence import evaluate, hermite_recurrence
from aleator.types import Array, Indices

POLISHING_STEPS = 2
"""Newton's method doubles the digits of an eigenvalue that already has most of them."""


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
    """The q-point Gauss rule and its exact derivatives: nodes, weights (q,), and both (q, k).

    `da` and `db` (q, k) are the derivatives of the recurrence coefficients. For a symmetric
    matrix J with eigenvectors v_i and simple eigenvalues t_i,
    dt_i = v_i' dJ v_i and dv_i = sum_(j != i) v_j (v_j' dJ v_i)/(t_i - t_j); a Jacobi matrix has
    simple eigenvalues (Golub and Welsch, 1969). Cost O(k q^3).

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

    Its weights keep their digits where high powers of a polynomial are integrated. The squared
    component of an eigenvector, as `gauss` takes it, has an absolute error of 1e-16 or so. An outer
    node of a 17-point Hermite rule weighs 1e-13, and the eighth power of a polynomial of degree
    four multiplies it by more than 1e20. So the nodes are polished and the weights taken from the
    polynomials.

    q = floor(degree/2) + 1. With S(t) = sum_(k<q) p_k(t)^2 the weights are w_j = 1/S(t_j), and by
    the Christoffel-Darboux formula a step of Newton's method is r(t) p_(q-1)(t)/S(t), where r is
    p_q before it is scaled (Gautschi, Orthogonal Polynomials, 2004, sec. 1.3.3 and 1.4.2).
    `a` and `b` hold at least q recurrence coefficients. Cost O(q^3).

    >>> t, w, p = polished_rule(*hermite_recurrence(3), 4)
    >>> t.round(6).tolist(), w.round(6).tolist()
    ([-1.732051, 0.0, 1.732051], [0.166667, 0.666667, 0.166667])
    """
    q = degree // 2 + 1
    t = np.asarray(gauss(a[:q], b[:q])[0], dtype=float)
    for _ in range(POLISHING_STEPS):
        p = evaluate(a, b, t, q - 1)
        below = np.sqrt(b[q - 1]) * p[:, q - 2] if q > 1 else 0.0
        t = t - ((t - a[q - 1]) * p[:, -1] - below) * p[:, -1] / np.sum(p**2, axis=1)
    p = evaluate(a, b, t, q - 1)
    return t + 0.0, 1.0 / np.sum(p**2, axis=1), p


def _tridiagonal(diagonal: Array, off: Array) -> Array:
    """The symmetric matrices (..., q, q) of a diagonal (..., q) and the one beside it."""
    q = diagonal.shape[-1]
    matrix = np.zeros((*diagonal.shape, q))
    rows = np.arange(q)
    matrix[..., rows, rows] = diagonal
    matrix[..., rows[1:], rows[:-1]] = off
    matrix[..., rows[:-1], rows[1:]] = off
    return matrix


@lru_cache(maxsize=64)
def gauss_hermite(q: int) -> tuple[Array, Array]:
    """The q-point Gauss rule of the standard normal law; read-only arrays (q,), (q,).

    >>> t, w = gauss_hermite(5)
    >>> round(float(w @ t**8), 9)
    105.0
    """
    return _frozen(gauss(*hermite_recurrence(q)))


@lru_cache(maxsize=64)
def gauss_legendre(q: int) -> tuple[Array, Array]:
    """The q-point Gauss rule of the uniform law on [-1, 1]; weights sum to one.

    >>> t, w = gauss_legendre(2)
    >>> round(float(w @ t**2), 12)
    0.333333333333
    """
    t, w = np.polynomial.legendre.leggauss(q)
    return _frozen((t, w / 2.0))


def tensor(sizes: tuple[int, ...]) -> Indices:
    """Indices (J, n) of all combinations of one-dimensional nodes, J = product of sizes.

    >>> tensor((2, 2)).tolist()
    [[0, 0], [0, 1], [1, 0], [1, 1]]
    """
    return np.indices(sizes).reshape(len(sizes), -1).T


def _frozen(arrays: tuple[Array, Array]) -> tuple[Array, Array]:
    for array in arrays:
        array.setflags(write=False)
    return arrays
