"""Exact partial derivatives of a maximum-entropy log-density, and its continuation outside.

Let the basis be a fixed function of u, phi_k(u) = phi_k(t(u)) for the present edges, so that only
the limits of integration move with the edges. The multipliers solve F(lambda, c, a, b) = 0,

    F = E phi - C c,   E g = int_a^b g exp(lambda.phi) du / int_a^b exp(lambda.phi) du,

with c the standardized moments and C the rows of phi in powers of u. With H = dF/dlambda the
covariance of phi and f the density,

    dF/db = f(b) (phi(b) - E phi),  dF/da = -f(a) (phi(a) - E phi),  dF/dc = -C,

hence dlambda/dc = H^-1 C, dlambda/db = -H^-1 f(b) (phi(b) - E phi), and for a the opposite sign.
In the polynomials psi orthonormal under f, psi_k = sum_j T_kj (phi_j - E phi_j), k > 0, the inverse
is H^-1 = T^T T, so that v.H^-1 v' = sum_k (T v)_k (T v')_k and T C are the coefficients of psi in
the powers of u.
Since log f(u) = lambda.phi(u) - log int exp(lambda.phi), and the logarithm of the integral changes
by E phi.dlambda + f(b) db - f(a) da,

    d log f(u) = (phi(u) - E phi).dlambda - f(b) db + f(a) da   at fixed u.

Outside the support the search sees, with e the nearest edge, D = u - e, g = (log f)'(e),

    value = log f(e) + k g D - D^2/2,   k = 1 where the density falls outward at e, else 0.

It is continuous, never above log f(e), and pulls the outcome back. The multipliers move it by
v.dlambda - f(b) db + f(a) da with v = phi(e) - E phi + k D phi'(e); the edge itself moves it by
(1 - k) g + k D lambda.phi''(e) + D, the outcome by k g - D. Inside, e = u and D = 0: the same v
serves, the edges do not act directly, and the outcome moves the value by g.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.moments.densities.maximum_entropy.legendre import legendre
from aleator.moments.densities.maximum_entropy.solution import Solution
from aleator.types import Array, Flags

TOUCH = 1e-12
"""An outcome beyond an edge by less than this part of half the support lies on the edge."""


@dataclass(frozen=True)
class Partials:
    """Value (N,) in units of u, its partials by u, a, b (N,) and by the standardized moments
    (N, M+1), and whether u lies outside the support."""

    value: Array
    d_u: Array
    d_a: Array
    d_b: Array
    d_standardized: Array
    outside: Flags


def partials(solution: Solution, u: Array) -> Partials:
    """Value for the search at u (N,) and its partials; cost O(N M^2)."""
    s = solution
    order = s.multipliers.shape[1]
    half = 0.5 * (s.b - s.a)
    edge = np.clip(u, s.a, s.b)
    t = np.clip((edge - 0.5 * (s.a + s.b)) / half, -1.0, 1.0)
    beyond = u - edge
    phi, slope, curvature = (
        legendre(t, order, derivative) / half[:, None] ** derivative for derivative in range(3)
    )
    g = _dot(s.multipliers, slope[:, 1:])
    inside = beyond == 0.0
    falls = np.where(g * beyond < 0.0, 1.0, 0.0)
    log_f = _dot(s.multipliers, phi[:, 1:]) - s.log_z - np.log(2.0 * half)
    # v in the orthonormal polynomials: those of degree 0 vanish in it
    w = np.einsum("nkj,nj->nk", s.psi[:, 1:], phi + (falls * beyond)[:, None] * slope)
    d_a, d_b = (
        side * np.exp(s.multipliers @ end[1:] - s.log_z) / (2.0 * half)
        * (1.0 + _dot(w, s.psi[:, 1:] @ end))
        for side, end in zip((1.0, -1.0), legendre(np.array([-1.0, 1.0]), order), strict=True)
    )  # fmt: skip
    by_edge = (1.0 - falls) * g + falls * beyond * _dot(s.multipliers, curvature[:, 1:]) + beyond
    powers = np.einsum("nk,nki->ni", w, s.powers[:, 1:])
    powers[:, :3] = 0.0
    return Partials(
        value=log_f + falls * g * beyond - 0.5 * beyond**2,
        d_u=np.where(inside, g, falls * g - beyond),
        d_a=d_a + np.where(beyond < 0.0, by_edge, 0.0),
        d_b=d_b + np.where(beyond > 0.0, by_edge, 0.0),
        d_standardized=powers,
        outside=np.abs(beyond) > TOUCH * half,
    )


def _dot(x: Array, y: Array) -> Array:
    product: Array = np.einsum("nk,nk->n", x, y)
    return product
