"""Legendre polynomials on the support of a maximum-entropy density, and the width of the support.

The polynomials phi_k(t) = sqrt(2k + 1) P_k(t) are orthonormal for the uniform law on [-1, 1]. In
this basis the covariance matrix that the solver inverts is well conditioned; in powers of the
standardized outcome u it is not. t is u mapped linearly from the support [a, b] to [-1, 1].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from aleator.core.types import Array, Flags


def legendre(t: Array, degree: int, derivative: int = 0) -> Array:
    """Values (..., degree+1) of phi_0..phi_degree at t (...), or of a derivative of them.

    `derivative` is the order of the derivative, 0 for the polynomials themselves. The values come
    from (k+1) P_(k+1) = (2k+1) t P_k - k P_(k-1), the derivatives from
    P'_(k+1) = P'_(k-1) + (2k+1) P_k.

    >>> legendre(np.array([1.0]), 2).round(6).tolist()  # sqrt(2k + 1)
    [[1.0, 1.732051, 2.236068]]
    """
    values = np.zeros((*t.shape, degree + 1))
    values[..., 0] = 1.0
    if degree > 0:
        values[..., 1] = t
    for k in range(1, degree):
        values[..., k + 1] = ((2 * k + 1) * t * values[..., k] - k * values[..., k - 1]) / (k + 1)
    for _ in range(derivative):
        below, values = values, np.zeros_like(values)
        for k in range(degree):
            values[..., k + 1] = (2 * k + 1) * below[..., k]
            if k > 0:
                values[..., k + 1] += values[..., k - 1]
    scale: Array = np.sqrt(2.0 * np.arange(degree + 1) + 1.0)
    return values * scale


@dataclass(frozen=True)
class LegendreRule:
    """A quadrature rule on [-1, 1], with the Legendre polynomials at its nodes.

    `nodes` (Q,) are values of t; `weights` w (Q,) sum to one; `basis` (M, Q) holds phi_1..phi_M at
    the nodes. `weighted` (Q, 2M+1) holds w phi_0..w phi_2M: a density at the nodes times this
    matrix gives its Legendre moments. `edges` are the ends of the intervals of a piecewise rule.
    """

    nodes: Array
    weights: Array
    basis: Array
    weighted: Array
    edges: Array


@lru_cache
def gauss_rule(order: int, nodes: int) -> LegendreRule:
    """One Gauss-Legendre rule on the whole support, exact up to degree 2 nodes - 1."""
    t, w = np.polynomial.legendre.leggauss(nodes)
    return _rule(t, 0.5 * w, order, np.array([-1.0, 1.0]))


@lru_cache
def panel_rule(order: int, panels: int, nodes: int) -> LegendreRule:
    """A piecewise Gauss-Legendre rule: `panels` intervals of [-1, 1] with `nodes` nodes each.

    Its nodes differ from those of `gauss_rule`, so that it can check a solve. The intervals end at
    -cos(pi j/panels) and are narrow near -1 and 1, where the density may have a bump as narrow as a
    thousandth of the support.
    """
    x, w = np.polynomial.legendre.leggauss(nodes)
    edges = -np.cos(np.pi * np.arange(panels + 1) / panels)
    edges[0], edges[-1] = -1.0, 1.0
    left, width = edges[:-1, None], np.diff(edges)[:, None]
    t, weights = np.ravel(left + 0.5 * width * (x + 1.0)), np.ravel(0.25 * width * w)
    return _rule(t, weights, order, edges)


def _rule(t: Array, w: Array, order: int, edges: Array) -> LegendreRule:
    phi = legendre(t, 2 * order)
    basis = np.ascontiguousarray(phi[:, 1 : order + 1].T)
    return LegendreRule(t, w, basis, w[:, None] * phi, edges)


@lru_cache
def linearization(rows: int, factor: str, degree: int) -> Array:
    """Coefficients (degree+1, rows*rows) of g(t) phi_i phi_j, i, j < rows, in phi_0..phi_degree.

    `factor` names g: "1", "1-t", "1+t" or "1-t^2". Expectations E phi_k (N, degree+1) times these
    coefficients are the matrices E[g phi_i phi_j], one row for each law. They are exact if `degree`
    is not below that of g phi_i phi_j.
    """
    t, w = np.polynomial.legendre.leggauss(rows + degree + 2)
    g = {"1": np.ones_like(t), "1-t": 1.0 - t, "1+t": 1.0 + t, "1-t^2": 1.0 - t**2}[factor]
    phi = legendre(t, rows - 1)
    tensor = np.einsum("q,qi,qj,qk->kij", 0.5 * w * g, phi, phi, legendre(t, degree))
    return np.asarray(tensor.reshape(degree + 1, rows * rows))


def legendre_in_powers(a: Array, b: Array, order: int) -> Array:
    """Coefficients (N, M+1, M+1) of phi_k(t(u)) in the powers of u, for supports [a, b] (N,).

    t(u) maps [a, b] linearly to [-1, 1]. The recurrence of `legendre` is applied to coefficients.
    Row k is the Taylor series of phi_k about the mean u = 0. Its terms stay moderate, because
    b - a >= 2 for every law with variance one.
    """
    slope, offset = 2.0 / (b - a), -(a + b) / (b - a)
    c = np.zeros((a.size, order + 1, order + 1))
    c[:, 0, 0] = 1.0
    for k in range(order):
        raised = np.zeros_like(c[:, 0])
        raised[:, 1:] = slope[:, None] * c[:, k, :-1]
        raised += offset[:, None] * c[:, k]
        c[:, k + 1] = (2 * k + 1) * raised / (k + 1)
        if k > 0:
            c[:, k + 1] -= k * c[:, k - 1] / (k + 1)
    scale: Array = np.sqrt(2.0 * np.arange(order + 1) + 1.0)
    return c * scale[:, None]


def realizable(expected: Array, smallest_pivot: float = 1e-13) -> Flags:
    """Whether some density on [-1, 1] has the expectations E phi_0..phi_M (N, M+1).

    The truncated moment problem on an interval (Krein and Nudelman): for M = 2m the matrices
    E[phi_i phi_j] (i, j <= m) and E[(1-t^2) phi_i phi_j] (i, j < m), for M = 2m+1 the matrices
    E[(1-t) phi_i phi_j] and E[(1+t) phi_i phi_j] (i, j <= m) must be positive definite. A matrix
    with a pivot of its Cholesky factorization below `smallest_pivot` counts as not definite.

    >>> realizable(np.array([[1.0, 0.0, 0.0], [1.0, 1.8, 0.0]])).tolist()  # uniform; E t > 1
    [True, False]
    """
    order = expected.shape[1] - 1
    half = order // 2
    tests = [("1-t", half + 1), ("1+t", half + 1)]
    if order % 2 == 0:
        tests = [("1", half + 1), ("1-t^2", half)]
    possible = np.ones(expected.shape[0], dtype=bool)
    for factor, rows in tests:
        matrices = expected @ linearization(rows, factor, order)
        _, pivot = cholesky(matrices.reshape(-1, rows, rows))
        possible &= pivot > smallest_pivot
    return possible


def dot(x: Array, y: Array) -> Array:
    """The inner product (N,) of each row of x (N, Q) with the same row of y (N, Q)."""
    return np.asarray(np.einsum("nk,nk->n", x, y))


def cholesky(matrices: Array) -> tuple[Array, Array]:
    """Lower factors (M, M, N) of symmetric matrices (N, M, M), and the smallest pivot (N,) of each.

    The numbers above the diagonal have no meaning. The N matrices are the last axis of the factors,
    so that every operation runs along it. A pivot below the rounding error is replaced by the
    rounding error: a matrix that is not positive definite gives no NaN and raises nothing; the
    smallest pivot reports it.
    """
    factor = np.array(matrices.transpose(1, 2, 0), order="C")
    diagonal = np.einsum("jjn->jn", factor)
    floor = 1e-15 * np.abs(diagonal) + 1e-30
    smallest = diagonal[0].copy()
    for j in range(factor.shape[0]):
        np.minimum(smallest, diagonal[j], out=smallest)
        root = np.sqrt(np.maximum(diagonal[j], floor[j]))
        diagonal[j] = root
        column = factor[j + 1 :, j]
        column /= root
        factor[j + 1 :, j + 1 :] -= column[:, None] * column
    return factor, smallest


def forward(factor: Array, right: Array) -> Array:
    """Solutions (N, M) of L x = right (N, M) for the factors L (M, M, N) of `cholesky`."""
    x = np.array(right.T, order="C")
    for j in range(x.shape[0]):
        x[j] /= factor[j, j]
        x[j + 1 :] -= factor[j + 1 :, j] * x[j]
    return x.T


def substitute(factor: Array, right: Array) -> Array:
    """Solutions (N, M) of L L^T x = right (N, M) for the factors L (M, M, N) of `cholesky`."""
    x = forward(factor, right).T
    for j in reversed(range(x.shape[0])):
        x[j] /= factor[j, j]
        x[:j] -= factor[j, :j] * x[j]
    return x.T


def support_of(
    lower: Array, upper: Array, standardized: Array, least: float
) -> tuple[Array, Array, Flags, Flags, Array]:
    """The support [a, b] of N densities, in standard deviations from the mean.

    It is the physical range `lower` < 0 < `upper` (N,), cut at -r and r with the half-width r of
    `reach_of`. Returns a and b (N,), whether the physical range has set a (N,) and b (N,), and
    dr/dc (N, M+1).
    """
    width, slope = reach_of(standardized, least)
    lower_set, upper_set = lower > -width, upper < width
    a, b = np.where(lower_set, lower, -width), np.where(upper_set, upper, width)
    return a, b, lower_set, upper_set, slope


def reach_of(
    standardized: Array, least: float, widening: float = 2.0, smallest_pivot: float = 1e-13
) -> tuple[Array, Array]:
    """Half-width r (N,) of an unlimited support, from the standardized moments c (N, M+1); dr/dc.

    Where no physical range limits it, the support is [-r, r] standard deviations about the mean,
    and r is a smooth function of the moments. dr/dc is (N, M+1); the cost is O(N M^3). The moments
    c_0..c_M of a law of u on [-r, r] satisfy, for every polynomial q (Krein and Nudelman, the
    truncated moment problem),

        M = 2m:    E[(r^2 - u^2) q^2] > 0, degree below m:    r^2 > eigenvalues of X = A^-1 B,
        M = 2m+1:  E[(r +- u) q^2] > 0, degree not above m:   r > |eigenvalues| of X = A^-1 B,

    with the Hankel matrices A = (c_(i+j)), and B = (c_(i+j+2)) for even M, (c_(i+j+1)) for odd M.
    Let s = tr X for even M and s = tr X^2 for odd M: s is not below the bound on r^2 and, unlike
    the largest eigenvalue, it is differentiable. The half-width is r^2 = sqrt(least^4 + (2 s)^2);
    the 2 is `widening`. At the bound itself only point masses have the moments, and twice s leaves
    room for a density, even where the physical range fixes one edge. For the normal law s = m^2 at
    M = 2m, which leaves r near `least`. For the cube of a normal variable s is 47 at M = 4 and 268
    at M = 6, so that r is 11 and 23 standard deviations.

    The derivative is ds = tr(A^-1 dB) - tr(X A^-1 dA) for even M and
    ds = 2 tr(X A^-1 dB) - 2 tr(X^2 A^-1 dA) for odd M. Moments that no law on the real line has
    get r = `least` and derivative zero.

    >>> r, slope = reach_of(np.array([[1.0, 0.0, 1.0, 0.0, 3.0]]), 8.0)  # (8^4 + (2 * 4)^2)^(1/4)
    >>> float(r[0]), slope[0, 3:].round(6).tolist()
    (8.031068, [0.0, 0.015444])
    """
    odd = standardized.shape[1] % 2 == 0
    size, shift = (standardized.shape[1] - 1) // 2 + odd, 1 if odd else 2
    place = np.add.outer(np.arange(size), np.arange(size))
    factor, pivot = cholesky(standardized[:, place])
    x = _solve(factor, standardized[:, place + shift])
    inverse = _solve(factor, np.broadcast_to(np.eye(size), x.shape))
    by_b, by_a = (2.0 * x @ inverse, -2.0 * x @ x @ inverse) if odd else (inverse, -x @ inverse)
    total = np.trace(x @ x if odd else x, axis1=1, axis2=2)
    usable = (pivot > smallest_pivot) & (total > 0.0)
    total = np.where(usable, total, 0.0)
    squared = np.hypot(least**2, widening * total)
    width = np.sqrt(squared)
    slope = np.zeros_like(standardized)
    for i in range(size):
        for j in range(size):
            slope[:, i + j + shift] += by_b[:, i, j]
            slope[:, i + j] += by_a[:, i, j]
    by_total = 0.5 * widening**2 * total / (width * squared)
    return width, np.where(usable[:, None], by_total[:, None] * slope, 0.0)


def _solve(factor: Array, right: Array) -> Array:
    """A^-1 R (N, m, m) from the Cholesky factors of A and the right-hand sides R (N, m, m)."""
    columns = [substitute(factor, right[:, :, j]) for j in range(right.shape[2])]
    return np.stack(columns, axis=2)
