"""Multipliers of a batch of maximum-entropy densities: Newton on the dual.

With phi_k orthonormal on t in [-1, 1] and targets p = E phi, the multipliers minimize the convex
dual log Z(lambda) - lambda.p, Z = (1/2) int exp(lambda.phi) dt (paper, appendix "Maximum entropy
distribution", with the other sign of lambda). Its gradient is E phi - p and its Hessian is the
covariance of phi. Products phi_i phi_j are sums of phi_k, k <= 2M, so that one product of the
exponentials with a table gives value, gradient and Hessian of all experiments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.densities.interface import Array, Mask
from aleator.densities.legendre import Rule, cholesky, linearization, substitute

_ITERATIONS = 200
_SMALLEST_STEP = 1e-9
_CLOSE = 1e-6
"""Newton decrement from which one more full step reaches rounding (it is squared, 1e-12)."""


@dataclass(frozen=True)
class Expectations:
    """Of N laws exp(lambda.phi)/Z: log Z (N,), E phi_1..phi_M (N, M), the Cholesky factor
    (N, M, M) of the covariance of phi, and the probabilities (N, Q) of the nodes."""

    log_z: Array
    mean: Array
    factor: Array
    probability: Array


def expectations(multipliers: Array, rule: Rule) -> Expectations:
    """Expectations under exp(multipliers.phi)/Z by a rule; the exponent is shifted by its top."""
    order = multipliers.shape[1]
    exponent = multipliers @ rule.basis
    top = exponent.max(axis=1)
    exponent -= top[:, None]
    density = np.exp(exponent, out=exponent)
    sums = density @ rule.weighted
    z = sums[:, 0].copy()
    sums /= z[:, None]
    second = (sums @ linearization(order + 1, "1", 2 * order)).reshape(-1, order + 1, order + 1)
    mean = sums[:, 1 : order + 1]
    factor, _ = cholesky(second[:, 1:, 1:] - mean[:, :, None] * mean[:, None, :])
    return Expectations(np.log(z) + top, mean, factor, density * (rule.weights / z[:, None]))


def gaussian_start(a: Array, b: Array, order: int) -> Array:
    """Multipliers (N, M) of exp(-u^2/2) on [a, b]: the Gaussian of the same mean and sd.

    u = h t + c gives -u^2/2 = -h c t - h^2 t^2/2 + const, and t^2 = 2 phi_2/(3 sqrt 5) + const.
    """
    half, center = 0.5 * (b - a), 0.5 * (a + b)
    start = np.zeros((a.size, order))
    start[:, 0] = -half * center / np.sqrt(3.0)
    start[:, 1] = -(half**2) / (3.0 * np.sqrt(5.0))
    return start


def minimize_dual(target: Array, start: Array, rule: Rule) -> tuple[Array, Mask]:
    """Multipliers (N, M) with E phi = target (N, M), and whether Newton's decrement vanished.

    Damped Newton; a row leaves the batch as soon as it has converged or cannot descend. Cost: some
    8 passes over (N, Q) exponentials. Slow, or not converged, where the target is close to the
    boundary of what is realizable.
    """
    answer, converged = start.copy(), np.zeros(start.shape[0], dtype=bool)
    rows = np.arange(start.shape[0])
    # the first pass, a step of length zero, is accepted since the value starts at infinity
    position, value = start, np.full(rows.size, np.inf)
    direction, slope, step = np.zeros_like(start), np.zeros(rows.size), np.ones(rows.size)
    for _ in range(_ITERATIONS):
        trial = position + step[:, None] * direction
        law = expectations(trial, rule)
        trial_value = law.log_z - np.einsum("nk,nk->n", trial, target)
        slack = 1e-13 * (1.0 + np.abs(trial_value))
        accepted = trial_value <= value + 1e-4 * step * slope + slack
        newton = substitute(law.factor, target - law.mean)
        decrement = np.einsum("nk,nk->n", newton, target - law.mean)
        position = np.where(accepted[:, None], trial, position)
        direction = np.where(accepted[:, None], newton, direction)
        value = np.where(accepted, trial_value, value)
        slope = np.where(accepted, -decrement, slope)
        step = np.where(accepted, 1.0, 0.4 * step)
        close = accepted & (decrement < _CLOSE**2)
        leaves = close | (step < _SMALLEST_STEP)
        if not leaves.any():
            continue
        position[close] += newton[close]
        answer[rows[leaves]], converged[rows[close]] = position[leaves], True
        stays = ~leaves
        if not stays.any():
            return answer, converged
        rows, target, position, direction, value, slope, step = (
            x[stays] for x in (rows, target, position, direction, value, slope, step)
        )
    answer[rows] = position
    return answer, converged
