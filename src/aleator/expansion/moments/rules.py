"""Gauss rules whose weights keep their digits where high powers of a polynomial are integrated.

The squared component of an eigenvector has an absolute error of 1e-16 or so. An outer node of a
17-point Hermite rule weighs 1e-13, and the eighth power of a polynomial of degree four multiplies
it by more than 1e20: so the nodes are polished and the weights taken from the polynomials.
"""

from __future__ import annotations

import numpy as np

from aleator.polynomials.gauss import gauss
from aleator.polynomials.recurrence import evaluate
from aleator.types import Array

POLISHING_STEPS = 2
"""Newton's method doubles the digits of an eigenvalue that already has most of them."""

SYMMETRY = 1e-13
"""Centers a_k that differ by less than this, relative to the scale of the weight, are one."""


def polished_rule(a: Array, b: Array, degree: int) -> tuple[Array, Array, Array]:
    """Gauss rule exact to `degree`: nodes t (q,), weights w (q,), values p_k(t_j) (q, q).

    q = floor(degree/2) + 1. With S(t) = sum_(k<q) p_k(t)^2 the weights are w_j = 1/S(t_j), and by
    the Christoffel-Darboux formula a step of Newton's method is r(t) p_(q-1)(t)/S(t), where r is
    p_q before it is scaled (Gautschi, Orthogonal Polynomials, 2004, sec. 1.3.3 and 1.4.2).
    `a` and `b` hold at least q recurrence coefficients. Cost O(q^3).

    >>> from aleator.polynomials.recurrence import hermite_recurrence
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


def symmetric(a: Array, b: Array) -> bool:
    """Whether the weight is symmetric about its mean: all a_k are the same.

    >>> from aleator.polynomials.recurrence import hermite_recurrence
    >>> symmetric(*hermite_recurrence(5))
    True
    """
    return bool(np.all(np.abs(a - a[0]) <= SYMMETRY * np.sqrt(np.max(b))))
