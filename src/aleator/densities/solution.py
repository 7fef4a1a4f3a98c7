"""Maximum-entropy densities of standardized outcomes: solved, checked, with their fallback."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from aleator.densities.dual import expectations, gaussian_start, minimize_dual
from aleator.densities.interface import Array, Codes, Status
from aleator.densities.legendre import gauss_rule, legendre_in_powers, panel_rule, realizable

PANELS = 32
"""A power of two; the panels serve the check, the cdf and the quantile."""

PANEL_NODES = 10

LARGEST_RESIDUAL = 1e-6

_BLOCK = 128
"""Experiments solved at once: their exponentials at the nodes fit the cache of one core."""

_NORMAL_MOMENTS = np.array([1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0])


@dataclass(frozen=True)
class Solution:
    """Densities f(u) = exp(multipliers.phi(t(u)) - log_z)/(b - a) on [a, b] of N experiments.

    `mean` (N, M) is E phi and `factor` (N, M, M) the Cholesky factor of the covariance of phi, with
    ones on the diagonal for degrees that are not used. `powers` (N, M+1, M+1) holds phi_k in the
    powers of u. `order_used` is M, 2 for the fallback on the same support, 0 where that fails too;
    a row with 0 holds numbers that are finite and mean nothing.
    """

    a: Array
    b: Array
    multipliers: Array
    log_z: Array
    mean: Array
    factor: Array
    powers: Array
    residual: Array
    order_used: Codes
    status: Codes


def solve(a: Array, b: Array, standardized: Array, nodes: int) -> Solution:
    """Densities on [a, b] (N,) with the standardized moments (N, M+1), each with a status.

    Where the solve of order M fails, order 2 on the same support takes its place; `status` keeps
    the failure. Cost O(N nodes M) a Newton step.
    """
    blocks = [
        _solve_block(a[block], b[block], standardized[block], nodes)
        for block in (slice(i, i + _BLOCK) for i in range(0, max(a.size, 1), _BLOCK))
    ]
    if len(blocks) == 1:
        return blocks[0]
    return Solution(
        **{x.name: np.concatenate([getattr(s, x.name) for s in blocks]) for x in fields(Solution)}
    )


def _solve_block(a: Array, b: Array, standardized: Array, nodes: int) -> Solution:
    best = _attempt(a, b, standardized, nodes)
    failed = np.flatnonzero(best.status)
    if failed.size == 0:
        return best
    best.order_used[failed] = 0
    second = _attempt(a[failed], b[failed], standardized[failed, :3], nodes)
    order = standardized.shape[1] - 1
    works = second.status == Status.SOLVED
    kept, rows = np.flatnonzero(works), failed[works]
    best.multipliers[rows] = 0.0
    best.multipliers[rows, :2] = second.multipliers[kept]
    best.factor[rows] = np.eye(order)
    best.factor[rows, :2, :2] = second.factor[kept]
    best.mean[rows, :2] = second.mean[kept]
    best.log_z[rows] = second.log_z[kept]
    best.order_used[rows] = 2
    law = expectations(best.multipliers[failed], panel_rule(order, PANELS, PANEL_NODES))
    best.residual[failed] = _residual(law.probability, a[failed], b[failed], standardized[failed])
    plain = failed[~works]
    best.residual[plain] = _relative(_NORMAL_MOMENTS[: order + 1], standardized[plain])
    return best


def _attempt(a: Array, b: Array, standardized: Array, nodes: int) -> Solution:
    """Solve one order; what cannot be solved keeps the multipliers of the start and a status."""
    order = standardized.shape[1] - 1
    powers = legendre_in_powers(a, b, order)
    target = (powers @ standardized[:, :, None])[:, :, 0]
    possible = np.flatnonzero(realizable(target))
    status = np.full(a.size, int(Status.NOT_REALIZABLE))
    multipliers = gaussian_start(a, b, order)
    solved, converged = minimize_dual(
        target[possible, 1:], multipliers[possible], gauss_rule(order, nodes)
    )
    multipliers[possible] = solved
    law = expectations(multipliers, panel_rule(order, PANELS, PANEL_NODES))
    residual = _residual(law.probability, a, b, standardized)
    honest = converged & (residual[possible] <= LARGEST_RESIDUAL)
    status[possible] = np.where(honest, Status.SOLVED, Status.NOT_CONVERGED)
    return Solution(
        a=a,
        b=b,
        multipliers=multipliers,
        log_z=law.log_z,
        mean=law.mean,
        factor=law.factor,
        powers=powers,
        residual=residual,
        order_used=np.full(a.size, order),
        status=status,
    )


def _residual(probability: Array, a: Array, b: Array, standardized: Array) -> Array:
    """Distance of the moments of u, summed at the nodes of the independent rule, from those asked.

    Powers of u itself are summed, so that a wrong conversion to Legendre moments shows as well.
    """
    order = standardized.shape[1] - 1
    t = panel_rule(order, PANELS, PANEL_NODES).nodes
    u = 0.5 * (a + b)[:, None] + 0.5 * (b - a)[:, None] * t
    found = np.empty_like(standardized)
    for m in range(order + 1):
        found[:, m] = probability.sum(axis=1)
        probability = probability * u
    return _relative(found, standardized)


def _relative(found: Array, asked: Array) -> Array:
    distance: Array = np.abs(found - asked) / np.maximum(1.0, np.abs(asked))
    largest: Array = distance.max(axis=1)
    return largest
