"""Polynomials orthonormal under a density itself, and Newton's method in them, for hard targets.

In the Legendre basis the covariance of a density that is narrow, or has two modes, on a wide
support loses its digits: its condition number grows like the 2M-th power of the support over the
modes. In polynomials psi_k orthonormal under the present density f (re-orthogonalized at each
step, as in Abramov, J. Comput. Phys. 226 (2007) 621) the Hessian of the dual is the identity,
E_f psi_k = 0, and the step is the expectation that the moments ask for:

    lambda.phi += sum_k delta_k psi_k,   delta_k = P_k . c,   P_k the coefficients in powers of u.

They come from the three-term recurrence on the nodes (Stieltjes; Gautschi 2004, sec. 2.2), which
never forms a moment of order above M. Levenberg's damping mu adds the uniform law to the measure
of orthogonality, so that the step is bounded where the density has no mass yet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.moments.densities.maximum_entropy.legendre import Rule
from aleator.types import Array, Flags

_PASSES = 150
_FIRST_DAMPING = 0.01

_CLOSE = 1e-16
"""Promised fall of the dual, half the squared distance in its own metric, that is none."""

_ROUNDING = 1e-14
"""Of the fall of the dual, a sum over the nodes."""

_NEGLIGIBLE = -500.0
"""Logarithm of a density over its top under which it only costs time, as denormal numbers do."""

_UNDAMPED = 1e-6
"""Damping under which a promise is that of Newton's own step."""


@dataclass(frozen=True)
class Orthonormal:
    """psi_0..psi_M of N measures: `values` (M+1, N, Q) at the nodes, their coefficients in
    phi_0..phi_M `legendre` and in 1, u, ..u^M `powers`, both (N, M+1, M+1) and triangular."""

    values: Array
    legendre: Array
    powers: Array


def orthonormal(probability: Array, u: Array, a: Array, b: Array, order: int) -> Orthonormal:
    """Polynomials orthonormal under the probabilities (N, Q) of the outcomes u (N, Q).

    beta_(k+1) psi_(k+1) = (u - alpha_k) psi_k - beta_k psi_(k-1), on nodes and coefficients alike;
    u = h t + c acts on coefficients by t phi_j = s_(j+1) phi_(j+1) + s_j phi_(j-1),
    s_j = j/sqrt(4 j^2 - 1). Cost O(N Q M).
    """
    count = a.size
    half, center = 0.5 * (b - a), 0.5 * (a + b)
    j = np.arange(1, order + 1)
    coupling = j / np.sqrt(4.0 * j**2 - 1.0)
    values = np.ones((order + 1, *u.shape))
    legendre, powers = np.zeros((2, count, order + 1, order + 1))
    legendre[:, 0, 0] = powers[:, 0, 0] = 1.0
    beta = np.zeros(count)
    for k in range(order):
        alpha = _mean(probability, values[k] ** 2 * u)
        previous = max(k - 1, 0)
        raised = (u - alpha[:, None]) * values[k] - beta[:, None] * values[previous]
        by_t = np.zeros((count, order + 1))
        by_t[:, 1:] = coupling * legendre[:, k, :-1]
        by_t[:, :-1] += coupling * legendre[:, k, 1:]
        in_phi = half[:, None] * by_t + (center - alpha)[:, None] * legendre[:, k]
        in_phi -= beta[:, None] * legendre[:, previous]
        in_u = -alpha[:, None] * powers[:, k] - beta[:, None] * powers[:, previous]
        in_u[:, 1:] += powers[:, k, :-1]
        beta = np.maximum(np.sqrt(_mean(probability, raised**2)), 1e-150)
        values[k + 1] = raised / beta[:, None]
        legendre[:, k + 1] = in_phi / beta[:, None]
        powers[:, k + 1] = in_u / beta[:, None]
    return Orthonormal(values, legendre, powers)


def outcomes_at(rule: Rule, a: Array, b: Array) -> Array:
    """Outcomes u (N, Q) at the nodes of a rule."""
    u: Array = 0.5 * (a + b)[:, None] + 0.5 * (b - a)[:, None] * rule.nodes
    return u


def density_at(multipliers: Array, rule: Rule) -> Array:
    """Probabilities (N, Q) of the nodes, normalized on them."""
    exponent = multipliers @ rule.basis
    exponent -= exponent.max(axis=1)[:, None]
    np.maximum(exponent, _NEGLIGIBLE, out=exponent)
    probability = rule.weights * np.exp(exponent)
    probability /= probability.sum(axis=1)[:, None]
    return np.asarray(probability)


def polish(
    a: Array, b: Array, standardized: Array, start: Array, rule: Rule
) -> tuple[Array, Flags]:
    """Multipliers (N, M) in phi with the standardized moments, and whether they were reached.

    Cost O(N Q M) a step, some 10 times that of `minimize_dual`, and 10 to 100 steps. It fails
    where the density is narrower than the nodes of the rule lie apart.
    """
    multipliers, converged = start.copy(), np.zeros(a.size, dtype=bool)
    damping = np.full(a.size, _FIRST_DAMPING)
    active = np.arange(a.size)
    for _ in range(_PASSES):
        if active.size == 0:
            break
        # a trial that overflows is refused
        with np.errstate(all="ignore"):
            step, predicted, ratio = _trial(
                a[active], b[active], standardized[active],
                multipliers[active], damping[active], rule,
            )  # fmt: skip
        accepted = ratio > 1e-3
        multipliers[active[accepted]] += step[accepted]
        arrived = accepted & (predicted < _CLOSE) & (damping[active] < _UNDAMPED)
        damping[active] *= np.where(ratio > 0.7, 0.1, np.where(ratio >= 0.25, 1.0, 4.0))
        converged[active[arrived]] = True
        active = active[~arrived]
    return multipliers, converged


def _trial(
    a: Array, b: Array, standardized: Array, multipliers: Array, damping: Array, rule: Rule
) -> tuple[Array, Array, Array]:
    """Damped step (N, M), the fall of the dual that it promises (N,), and the part that is true."""
    order = multipliers.shape[1]
    density = density_at(multipliers, rule)
    mu = damping[:, None]
    measure = (density + mu * rule.weights) / (1.0 + mu)
    psi = orthonormal(measure, outcomes_at(rule, a, b), a, b, order)
    asked = np.einsum("nkm,nm->nk", psi.powers, standardized)[:, 1:]
    found = np.einsum("nq,knq->nk", density, psi.values[1:])
    delta = (asked - found) / (1.0 + mu)
    change = np.einsum("nk,knq->nq", delta, psi.values[1:])
    top = change.max(axis=1)
    log_z = np.log(_mean(density, np.exp(change - top[:, None]))) + top
    fall = np.einsum("nk,nk->n", delta, asked) - log_z
    predicted = 0.5 * (1.0 + damping) * np.einsum("nk,nk->n", delta, delta)
    ratio = (fall + _ROUNDING) / (predicted + _ROUNDING)
    step = np.einsum("nk,nkj->nj", delta, psi.legendre[:, 1:, 1:])
    return step, predicted, ratio


def _mean(probability: Array, values: Array) -> Array:
    mean: Array = np.einsum("nq,nq->n", probability, values)
    return mean
