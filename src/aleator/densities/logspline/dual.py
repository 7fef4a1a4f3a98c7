"""Coefficients of a batch of log-splines: Newton on the penalized dual.

With p = E B the expectations asked for, the coefficients minimize the convex
log Z(theta) - theta.p + (lambda/2) theta.P theta, Z = int_0^1 exp(theta.B) dt, P = `roughness`. The
gradient is E_theta B - p + lambda P theta, the Hessian Cov_theta B + lambda P. P vanishes on the
polynomials of degree two only, whose expectations on a bounded support any density has: so there
is a minimum. The splines sum to one, hence a constant added to theta changes nothing: a matrix of
equal entries, added to the Hessian, keeps it where it started.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.densities.logspline.splines import SplineRule, from_band, roughness, spline_rule
from aleator.types import Array, Flags

_PASSES = 100

_DECREMENT = 1e-16
"""Newton decrement (twice the distance in entropy) at which a row has arrived."""

_BLOCK = 128

_LARGEST_EXPONENT = 600.0
"""Of a row that did not arrive."""


@dataclass(frozen=True)
class DualAnswer:
    """Of N rows: theta (N, L), log Z (N,), E B (N, L), Hessian (N, L, L), whether it arrived."""

    coefficients: Array
    log_z: Array
    mean: Array
    hessian: Array
    converged: Flags


def minimize_penalized_dual(expected: Array, start: Array, smoothing: float) -> DualAnswer:
    """Minimize from start (N, K+3) for the expectations (N, K+3); cost some ten steps O(N K^3)."""
    blocks = [
        _minimize(expected[i : i + _BLOCK], start[i : i + _BLOCK], smoothing)
        for i in range(0, max(expected.shape[0], 1), _BLOCK)
    ]
    if len(blocks) == 1:
        return blocks[0]
    return DualAnswer(
        *(
            np.concatenate([getattr(block, name) for block in blocks])
            for name in DualAnswer.__dataclass_fields__
        )
    )


def residual(coefficients: Array, log_z: Array, expected: Array, smoothing: float) -> Array:
    """Largest |E B - p| (N,) less what the smoothing explains, by another rule."""
    rule = spline_rule(coefficients.shape[1] - 3, extra=3)
    exponent = coefficients @ rule.basis.T - log_z[:, None]
    probability = np.exp(np.minimum(exponent, _LARGEST_EXPONENT)) * rule.weights
    missed = probability @ rule.basis - expected
    penalty = smoothing * coefficients @ roughness(coefficients.shape[1] - 3)
    return np.asarray(np.abs(missed + penalty).max(axis=1))


def _minimize(expected: Array, start: Array, smoothing: float) -> DualAnswer:
    size = start.shape[1]
    rule, penalty = spline_rule(size - 3), smoothing * roughness(size - 3)
    theta = start - start.mean(axis=1, keepdims=True)
    converged = np.zeros(theta.shape[0], dtype=bool)
    length = np.ones(theta.shape[0])
    log_z, mean, hessian = _expectations(theta, rule, penalty)
    for _ in range(_PASSES):
        rows = np.flatnonzero(~converged)
        if rows.size == 0:
            break
        own = theta[rows]
        gradient = mean[rows] - expected[rows] + own @ penalty
        step = -np.linalg.solve(hessian[rows], gradient[:, :, None])[:, :, 0]
        decrement = -np.einsum("nl,nl->n", gradient, step)
        trial = own + length[rows, None] * step
        new = _expectations(trial, rule, penalty)
        fall = _dual(own, log_z[rows], expected[rows], penalty) - _dual(
            trial, new[0], expected[rows], penalty
        )
        slack = 1e-14 * (1.0 + np.abs(own).max(axis=1))
        taken = fall >= 1e-4 * length[rows] * decrement - slack
        kept = rows[taken]
        theta[kept], log_z[kept], mean[kept], hessian[kept] = (
            part[taken] for part in (trial, *new)
        )
        converged[rows] = taken & (decrement < _DECREMENT)
        length[rows] = np.where(taken, np.minimum(1.0, 4.0 * length[rows]), 0.4 * length[rows])
    return DualAnswer(theta, log_z, mean, hessian, converged)


def _dual(theta: Array, log_z: Array, expected: Array, penalty: Array) -> Array:
    rough = 0.5 * np.einsum("nl,nl->n", theta @ penalty, theta)
    return np.asarray(log_z - np.einsum("nl,nl->n", theta, expected) + rough)


def _expectations(theta: Array, rule: SplineRule, penalty: Array) -> tuple[Array, Array, Array]:
    """log Z (N,), E B (N, L), and the Hessian (N, L, L) with its constant."""
    exponent = theta @ rule.basis.T
    top = exponent.max(axis=1)
    probability = np.exp(exponent - top[:, None]) * rule.weights
    z = probability.sum(axis=1)
    probability /= z[:, None]
    mean = probability @ rule.basis
    covariance = from_band(probability @ rule.products) - mean[:, :, None] * mean[:, None, :]
    return np.log(z) + top, mean, covariance + penalty + 1.0 / theta.shape[1]
