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

from aleator.moments.densities.interface import Codes
from aleator.moments.densities.maximum_entropy.legendre import (
    Rule,
    cholesky,
    linearization,
    substitute,
)
from aleator.types import Array, Flags

_PASSES = 150

CLOSE = 1e-12
"""Newton decrement (twice the distance in entropy) from which one step reaches rounding."""

_NEAR = 1e-6
"""Newton decrement from which damping only delays."""

_FIRST_DAMPING = 0.02


@dataclass(frozen=True)
class Expectations:
    """Of N laws exp(lambda.phi)/Z: log Z (N,), E phi_1..phi_M (N, M) and the covariance (N, M, M)
    of phi."""

    log_z: Array
    mean: Array
    covariance: Array


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
    covariance = second[:, 1:, 1:] - mean[:, :, None] * mean[:, None, :]
    return Expectations(np.log(z) + top, mean, covariance)


def node_probabilities(multipliers: Array, log_z: Array, rule: Rule) -> Array:
    """Probabilities (N, Q) of the nodes of a rule under exp(multipliers.phi)/Z."""
    probability: Array = np.exp(multipliers @ rule.basis - log_z[:, None]) * rule.weights
    return probability


def gaussian_start(a: Array, b: Array, order: int) -> Array:
    """Multipliers (N, M) of exp(-u^2/2) on [a, b]: the Gaussian of the same mean and sd.

    u = h t + c gives -u^2/2 = -h c t - h^2 t^2/2 + const, and t^2 = 2 phi_2/(3 sqrt 5) + const.
    """
    half, center = 0.5 * (b - a), 0.5 * (a + b)
    start = np.zeros((a.size, order))
    start[:, 0] = -half * center / np.sqrt(3.0)
    start[:, 1] = -(half**2) / (3.0 * np.sqrt(5.0))
    return start


@dataclass
class _Descent:
    """Rows still on their way down: position, value, gradient, Hessian, damping, next step."""

    rows: Codes
    target: Array
    position: Array
    value: Array
    gradient: Array
    hessian: Array
    damping: Array
    step: Array
    decrement: Array
    extra: Array

    def keep(self, stays: Flags) -> None:
        """Drop the rows that have arrived."""
        for name, values in vars(self).items():
            setattr(self, name, values[stays])

    def advance(self, rule: Rule) -> None:
        """Try the step, keep it where the dual falls as promised, and prepare the next one."""
        trial = self.position + self.step
        law = expectations(trial, rule)
        trial_value = law.log_z - _dot(trial, self.target)
        # exponents cancel that are as large as the multipliers allow
        largest = np.abs(trial) @ np.sqrt(2.0 * np.arange(1, trial.shape[1] + 1) + 1.0)
        slack = 1e-15 * (1.0 + np.abs(law.log_z) + largest)
        promised = 0.5 * (self.decrement + self.extra)
        ratio = (self.value - trial_value + slack) / (promised + slack)
        accepted = ratio > 1e-3
        self.position = np.where(accepted[:, None], trial, self.position)
        self.value = np.where(accepted, trial_value, self.value)
        self.gradient = np.where(accepted[:, None], law.mean - self.target, self.gradient)
        self.hessian = np.where(accepted[:, None, None], law.covariance, self.hessian)
        self.damping *= np.where(ratio > 0.7, 0.1, np.where(ratio >= 0.25, 1.0, 4.0))
        identity = np.eye(trial.shape[1])
        factor, _ = cholesky(self.hessian + self.damping[:, None, None] * identity)
        self.step = substitute(factor, -self.gradient)
        self.decrement = -_dot(self.gradient, self.step)
        self.extra = self.damping * _dot(self.step, self.step)
        self._undamp(np.flatnonzero((ratio > 0.7) & (self.decrement < _NEAR)))

    def _undamp(self, near: Codes) -> None:
        """Take the undamped step in these rows, where its decrement too says that the end is near;
        should it fail, the next one is damped."""
        if near.size == 0:
            return
        gradient = self.gradient[near]
        step = substitute(cholesky(self.hessian[near])[0], -gradient)
        decrement = -_dot(gradient, step)
        sure = decrement < _NEAR
        self.step[near[sure]], self.decrement[near[sure]] = step[sure], decrement[sure]
        self.extra[near[sure]] = 0.0


def minimize_dual(target: Array, start: Array, rule: Rule) -> tuple[Array, Flags]:
    """Multipliers (N, M) with E phi = target (N, M), and whether Newton's decrement vanished.

    Newton's method with Levenberg's damping: (H + mu I) step = p - E phi, mu raised where the dual
    falls short of its quadratic model. A full Newton step fits the bulk and lets the exponent
    explode in the tails, which the Hessian does not see; the damping weighs the support evenly
    (phi is orthonormal for the uniform law) and needs half the passes of a line search. A row
    leaves the batch as soon as it has converged. Cost: some 7 passes of O(N Q M) at M = 4.
    """
    answer, converged = start.copy(), np.zeros(start.shape[0], dtype=bool)
    count, order = start.shape
    # a first step of length zero is accepted since the value starts at infinity
    descent = _Descent(
        rows=np.arange(count),
        target=target,
        position=start,
        value=np.full(count, np.inf),
        gradient=np.zeros((count, order)),
        hessian=np.zeros((count, order, order)),
        damping=np.full(count, 10.0 * _FIRST_DAMPING),
        step=np.zeros((count, order)),
        decrement=np.ones(count),
        extra=np.zeros(count),
    )
    for _ in range(_PASSES):
        if descent.rows.size == 0:
            break
        # a trial that overflows is refused
        with np.errstate(over="ignore", invalid="ignore"):
            descent.advance(rule)
        close = descent.decrement < CLOSE
        answer[descent.rows[close]] = (descent.position + descent.step)[close]
        converged[descent.rows[close]] = True
        if close.any():
            descent.keep(~close)
    answer[descent.rows] = descent.position
    return answer, converged


def _dot(x: Array, y: Array) -> Array:
    product: Array = np.einsum("nk,nk->n", x, y)
    return product
