"""Gauss rules from recurrence coefficients, and their tensor product."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from aleator.polynomials import hermite_recurrence

Array = NDArray[np.float64]


def gauss(a: Array, b: Array) -> tuple[Array, Array]:
    """Nodes and weights (..., q) of the q-point Gauss rule, exact to degree 2q - 1.

    The nodes are the eigenvalues of the Jacobi matrix of the recurrence coefficients a, b
    (..., q); a weight is the squared first component of an eigenvector (Golub and Welsch, 1969).
    The weights sum to one. Cost O(q^3).

    >>> t, w = gauss(*hermite_recurrence(3))
    >>> t.round(6).tolist(), w.round(6).tolist()
    ([-1.732051, -0.0, 1.732051], [0.166667, 0.666667, 0.166667])
    """
    q = a.shape[-1]
    jacobi = np.zeros((*a.shape, q))
    rows = np.arange(q)
    jacobi[..., rows, rows] = a
    off = np.sqrt(b[..., 1:])
    jacobi[..., rows[1:], rows[:-1]] = off
    jacobi[..., rows[:-1], rows[1:]] = off
    nodes, vectors = np.linalg.eigh(jacobi)
    return nodes, vectors[..., 0, :] ** 2


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


def tensor(sizes: tuple[int, ...]) -> NDArray[np.int64]:
    """Indices (J, n) of all combinations of one-dimensional nodes, J = product of sizes.

    >>> tensor((2, 2)).tolist()
    [[0, 0], [0, 1], [1, 0], [1, 1]]
    """
    return np.indices(sizes).reshape(len(sizes), -1).T


def _frozen(arrays: tuple[Array, Array]) -> tuple[Array, Array]:
    for array in arrays:
        array.setflags(write=False)
    return arrays
