"""Legendre polynomials on the support of a maximum-entropy density, and how far that reaches.

phi_k(t) = sqrt(2k + 1) P_k(t), orthonormal for the uniform law on t in [-1, 1]. In this basis the
covariance that the solver inverts stays well conditioned, which powers of u do not offer.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from aleator.core.types import Array, Flags


def legendre(t: Array, degree: int, derivative: int = 0) -> Array:
    """Values (..., degree+1) of the derivative of phi_0..phi_degree at t (...).

    Three-term recurrence (k+1) P_(k+1) = (2k+1) t P_k - k P_(k-1); derivatives by
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
    """Nodes t (Q,) on [-1, 1], weights (Q,) that sum to one, phi_1..phi_M (M, Q) at the nodes,
    and w phi_0..phi_2M (Q, 2M+1), by which one product gives every expectation needed. `edges`
    (panels+1,) are those of the panels that it is made of."""

    nodes: Array
    weights: Array
    basis: Array
    weighted: Array
    edges: Array


@lru_cache
def gauss_rule(order: int, nodes: int) -> LegendreRule:
    """Gauss-Legendre rule on the whole support: exact to degree 2 nodes - 1."""
    t, w = np.polynomial.legendre.leggauss(nodes)
    return _rule(t, 0.5 * w, order, np.array([-1.0, 1.0]))


@lru_cache
def panel_rule(order: int, panels: int, nodes: int) -> LegendreRule:
    """Gauss-Legendre rule on each panel: nodes that `gauss_rule` does not have.

    The edges at -cos(pi j/panels) are equal in angle, so that a bump whose width is a thousandth
    of the support is seen where it may be, at an edge.
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

    `factor` names g: "1", "1-t", "1+t" or "1-t^2". The product of the expectations (N, degree+1)
    with it is the batch of matrices E[g phi_i phi_j]. Exact where the degrees fit.
    """
    t, w = np.polynomial.legendre.leggauss(rows + degree + 2)
    g = {"1": np.ones_like(t), "1-t": 1.0 - t, "1+t": 1.0 + t, "1-t^2": 1.0 - t**2}[factor]
    phi = legendre(t, rows - 1)
    tensor = np.einsum("q,qi,qj,qk->kij", 0.5 * w * g, phi, phi, legendre(t, degree))
    return np.asarray(tensor.reshape(degree + 1, rows * rows))


def legendre_in_powers(a: Array, b: Array, order: int) -> Array:
    """Coefficients (N, M+1, M+1) of phi_k(t(u)) in the powers of u, t affine on [a, b].

    The recurrence of `legendre` on coefficients. Row k is the Taylor series of phi_k about the
    mean u = 0, whose terms stay moderate since b - a >= 2 wherever a law with variance one exists.
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
    E[(1-t) phi_i phi_j] and E[(1+t) phi_i phi_j] (i, j <= m) must be positive definite. They are
    Hankel matrices in another basis. Those with a pivot under 1e-13 lie on the boundary.

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
    """Sums (N,) over the rows of x y, both (N, Q)."""
    return np.asarray(np.einsum("nk,nk->n", x, y))


def cholesky(matrices: Array) -> tuple[Array, Array]:
    """Lower factors (M, M, N) of symmetric matrices (N, M, M), and the smallest pivot (N,) of each.

    What stands above the diagonal is without meaning. The batch is the last axis of the factors,
    so that every operation runs along it. A pivot at the level of rounding is replaced by that
    level: a matrix that is not positive definite spoils neither its own row with NaN nor the batch
    with an exception.
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
    """The physical range lower < 0 < upper (N,) in standard deviations, cut at the reach.

    The edges a, b (N,), which of them the range has set (N,), and the slope of the reach (N, M+1).
    """
    width, slope = reach_of(standardized, least)
    lower_set, upper_set = lower > -width, upper < width
    a, b = np.where(lower_set, lower, -width), np.where(upper_set, upper, width)
    return a, b, lower_set, upper_set, slope


def reach_of(
    standardized: Array, least: float, widening: float = 2.0, smallest_pivot: float = 1e-13
) -> tuple[Array, Array]:
    """Reach r (N,) for the standardized moments (N, M+1), and dr/dc (N, M+1); cost O(N M^3).

    Where no physical range ends it, how far a density reaches is a smooth function of its moments.
    The moments c_0..c_M of a law of u on [-r, r] obey, for every polynomial q (Krein and Nudelman,
    the truncated moment problem),

        M = 2m:    E[(r^2 - u^2) q^2] > 0, degree below m:    r^2 > eigenvalues of X = A^-1 B,
        M = 2m+1:  E[(r +- u) q^2] > 0, degree not above m:   r > |eigenvalues| of X = A^-1 B,

    with the Hankel matrices A = (c_(i+j)), and B = (c_(i+j+2)) for even M, (c_(i+j+1)) for odd M.
    The sum of these squares, s = tr X or tr X^2, is above the largest and, unlike it,
    differentiable: r(c)^2 = sqrt(least^4 + (2 s)^2). `widening` is this 2: the least that some law
    needs has no density, and with twice its square an edge may also be fixed. For the normal law s
    is m^2 at M = 2m, which leaves r at `least`; for the cube of a normal variable it is 47 at M = 4
    and 268 at M = 6, so that its moments lie within 11 and 23 standard deviations.

    ds = tr(A^-1 dB) - tr(X A^-1 dA) for even M, 2 tr(X A^-1 dB) - 2 tr(X^2 A^-1 dA) for odd M.
    Moments that no law on the real line has get `least` and slope zero.

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
    """A^-1 R (N, m, m) for the factors of A, a column of R (N, m, m) at a time."""
    columns = [substitute(factor, right[:, :, j]) for j in range(right.shape[2])]
    return np.stack(columns, axis=2)
