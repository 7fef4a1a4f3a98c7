"""Maximum-entropy densities of standardized outcomes: solved, checked, with their fallback."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from aleator.densities.dual import expectations, gaussian_start, minimize_dual, node_probabilities
from aleator.densities.interface import Array, Codes, Mask, Status
from aleator.densities.legendre import (
    Rule,
    gauss_rule,
    legendre_in_powers,
    panel_rule,
    realizable,
)

PANELS = 32
"""A power of two; the panels serve the check, the cdf and the quantile."""

_PANEL_NODES = 10
"""At 200 nodes of the solve; more in proportion, so that the check never sees less."""

_FINER = 4
"""A solve that its check refutes is tried again with so many times the nodes."""

LARGEST_RESIDUAL = 1e-6

_BLOCK = 128
"""Experiments solved at once: their exponentials at the nodes fit the cache of one core."""

_NORMAL_MOMENTS = np.array([1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0])


@dataclass(frozen=True)
class Solution:
    """Densities f(u) = exp(multipliers.phi(t(u)) - log_z)/(b - a) on [a, b] of N experiments.

    `mean` (N, M) is E phi and `covariance` (N, M, M) that of phi, with an identity for degrees that
    are not used. `powers` (N, M+1, M+1) holds phi_k in the powers of u. `order_used` (N,) is M, 2
    for the fallback on the same support, 0 where that fails too: then the row is a uniform law
    that stands for nothing. `check` is the rule of the residual, independent of that of the solve.
    """

    a: Array
    b: Array
    multipliers: Array
    log_z: Array
    mean: Array
    covariance: Array
    powers: Array
    residual: Array
    order_used: Codes
    status: Codes
    check: Rule


def solve(a: Array, b: Array, standardized: Array, nodes: int) -> Solution:
    """Densities on [a, b] (N,) with the standardized moments (N, M+1), each with a status.

    Where the check refutes a solve, finer nodes are tried; where that fails too, order 2 on the
    same support takes its place and `status` keeps the failure. Cost O(N nodes M) a Newton step.
    """
    blocks = [
        _solve_block(a[block], b[block], standardized[block], nodes)
        for block in (slice(i, i + _BLOCK) for i in range(0, max(a.size, 1), _BLOCK))
    ]
    if len(blocks) == 1:
        return blocks[0]
    joined: dict[str, Any] = {
        field.name: np.concatenate([getattr(block, field.name) for block in blocks])
        for field in fields(Solution)
        if field.name != "check"
    }
    # the finest check serves all
    return Solution(**joined, check=max((block.check for block in blocks), key=_size))


def _solve_block(a: Array, b: Array, standardized: Array, nodes: int) -> Solution:
    best = _attempt(a, b, standardized, nodes)
    failed = np.flatnonzero(best.status == Status.NOT_CONVERGED)
    if failed.size > 0:
        # narrow modes that the nodes did not see
        fine = _attempt(a[failed], b[failed], standardized[failed], _FINER * nodes)
        _put(best, failed, fine, fine.status == Status.SOLVED)
        best = replace(best, check=fine.check)
    failed = np.flatnonzero(best.status)
    if failed.size > 0:
        _fall_back(best, failed, standardized[failed], nodes)
    return best


def _put(best: Solution, rows: Codes, other: Solution, works: Mask) -> None:
    """Write the rows of another solution that work into these rows."""
    for field in fields(Solution):
        if field.name != "check":
            getattr(best, field.name)[rows[works]] = getattr(other, field.name)[works]


def _fall_back(best: Solution, failed: Codes, standardized: Array, nodes: int) -> None:
    """Order 2 in the rows that failed, and a uniform law of order 0 where that fails too."""
    order = standardized.shape[1] - 1
    second = _attempt(best.a[failed], best.b[failed], standardized[:, :3], nodes)
    kept = np.flatnonzero(second.status == Status.SOLVED)
    rows = failed[kept]
    best.multipliers[failed], best.mean[failed], best.log_z[failed] = 0.0, 0.0, 0.0
    best.covariance[failed] = np.eye(order)
    best.order_used[failed] = 0
    best.multipliers[rows, :2] = second.multipliers[kept]
    best.mean[rows, :2] = second.mean[kept]
    best.covariance[rows, :2, :2] = second.covariance[kept]
    best.log_z[rows] = second.log_z[kept]
    best.order_used[rows] = 2
    best.residual[failed] = _relative(_NORMAL_MOMENTS[: order + 1], standardized)
    best.residual[rows] = _residual(
        node_probabilities(best.multipliers[rows], best.log_z[rows], best.check),
        best.check.nodes,
        best.a[rows],
        best.b[rows],
        standardized[kept],
    )


def _attempt(a: Array, b: Array, standardized: Array, nodes: int) -> Solution:
    """Solve one order; what cannot be solved keeps the multipliers of the start and a status."""
    order = standardized.shape[1] - 1
    check = panel_rule(order, PANELS, max(_PANEL_NODES, nodes // 20))
    powers = legendre_in_powers(a, b, order)
    target = (powers @ standardized[:, :, None])[:, :, 0]
    possible = np.flatnonzero(realizable(target))
    status = np.full(a.size, int(Status.NOT_REALIZABLE))
    multipliers = gaussian_start(a, b, order)
    multipliers[possible], converged = minimize_dual(
        target[possible, 1:], multipliers[possible], gauss_rule(order, nodes)
    )
    law = expectations(multipliers, check)
    probability = node_probabilities(multipliers, law.log_z, check)
    residual = _residual(probability, check.nodes, a, b, standardized)
    honest = converged & (residual[possible] <= LARGEST_RESIDUAL)
    status[possible] = np.where(honest, Status.SOLVED, Status.NOT_CONVERGED)
    return Solution(
        a=a,
        b=b,
        multipliers=multipliers,
        log_z=law.log_z,
        mean=law.mean,
        covariance=law.covariance,
        powers=powers,
        residual=residual,
        order_used=np.full(a.size, order),
        status=status,
        check=check,
    )


def _residual(probability: Array, t: Array, a: Array, b: Array, standardized: Array) -> Array:
    """Distance of the moments of u, summed at the nodes t of the check, from those asked for.

    Powers of u itself are summed, so that a wrong conversion to Legendre moments shows as well.
    """
    u = 0.5 * (a + b)[:, None] + 0.5 * (b - a)[:, None] * t
    found = np.empty_like(standardized)
    for m in range(standardized.shape[1]):
        found[:, m] = probability.sum(axis=1)
        probability = probability * u
    return _relative(found, standardized)


def _relative(found: Array, asked: Array) -> Array:
    distance: Array = np.abs(found - asked) / np.maximum(1.0, np.abs(asked))
    largest: Array = distance.max(axis=1)
    return largest


def _size(rule: Rule) -> int:
    return rule.nodes.size
