"""Maximum-entropy densities of standardized outcomes: solved, checked, with their fallback."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from aleator.densities.dual import Expectations, expectations, gaussian_start, minimize_dual
from aleator.densities.interface import Array, Codes, Status
from aleator.densities.legendre import (
    Rule,
    cholesky,
    forward,
    gauss_rule,
    legendre_in_powers,
    panel_rule,
    realizable,
)
from aleator.densities.whitened import density_at, orthonormal, outcomes_at, polish

PANELS = 32
"""A power of two; the panels serve the check, the cdf and the quantile."""

_PANEL_NODES = 10
"""At 200 nodes of the solve; more in proportion, so that the check never sees less."""

_FINER = 3
"""A solve that its check refutes is polished on so many times the nodes of the check, and checked
on one time more."""

LARGEST_RESIDUAL = 1e-6

_LARGEST_UNPOLISHED = 1e-8
"""Nodes too coarse for a narrow mode mislead the solve and its check alike, so that a residual
which is not far below what is allowed is a reason to look with finer nodes."""

_SMALLEST_PIVOT = 1e-8
"""Pivot of the covariance of phi under which its factors have lost half their digits."""

_BLOCK = 128
"""Experiments solved at once: their exponentials at the nodes fit the cache of one core."""

_NORMAL_MOMENTS = np.array([1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0])


@dataclass(frozen=True)
class Solution:
    """Densities f(u) = exp(multipliers.phi(t(u)) - log_z)/(b - a) on [a, b] of N experiments.

    `mean` (N, M) is E phi. `psi` and `powers` (N, M+1, M+1) hold the polynomials orthonormal under
    f, in phi_0..phi_M and in the powers of u; rows of degrees that are not used are zero, so that
    H^-1 = T^T T with T = psi without row and column 0. `order_used` (N,) is M or that of the
    fallback on the same support, 0 where none could be solved: then the row is a uniform law
    that stands for nothing. `check` is the rule of the residual, independent of that of the solve.
    """

    a: Array
    b: Array
    multipliers: Array
    log_z: Array
    mean: Array
    psi: Array
    powers: Array
    residual: Array
    order_used: Codes
    status: Codes
    check: Rule


@dataclass(frozen=True)
class _Rules:
    """Quadrature of one order: of the solve, of its check, of the polish, and of its check."""

    solve: Rule
    check: Rule
    polish: Rule
    fine: Rule

    @classmethod
    def of(cls, order: int, nodes: int) -> _Rules:
        """Rules for so many nodes of the solve."""
        each = max(_PANEL_NODES, nodes // 20)
        return cls(
            gauss_rule(order, nodes),
            panel_rule(order, PANELS, each),
            panel_rule(order, PANELS, _FINER * each),
            panel_rule(order, PANELS, (_FINER + 1) * each),
        )


def solve(a: Array, b: Array, standardized: Array, nodes: int) -> Solution:
    """Densities on [a, b] (N,) with the standardized moments (N, M+1), each with a status.

    Where the check refutes a solve it is polished on finer nodes in a basis orthonormal under the
    density itself; where that fails too, order M-2, M-4, .. 2 on the same support takes its place
    and `status` keeps the failure. Cost O(N nodes M) a Newton step.
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
    order = standardized.shape[1] - 1
    rules = _Rules.of(order, nodes)
    multipliers, status, polished = _attempt(a, b, standardized, rules)
    used = np.where(status == Status.SOLVED, order, 0)
    failed = np.flatnonzero(status)
    for lower in _lower_orders(order):
        if failed.size == 0:
            break
        found, codes, hard = _attempt(
            a[failed], b[failed], standardized[failed, : lower + 1], _Rules.of(lower, nodes)
        )
        kept = codes == Status.SOLVED
        rows, failed = failed[kept], failed[~kept]
        multipliers[rows] = 0.0
        multipliers[rows, :lower] = found[kept]
        used[rows] = lower
        polished |= hard
    multipliers[failed] = 0.0
    check = rules.fine if polished else rules.check
    law = expectations(multipliers, check)
    psi, powers = _orthonormal(a, b, multipliers, law, rules)
    unused = np.arange(order + 1) > used[:, None]
    psi[unused], powers[unused] = 0.0, 0.0
    residual = _residual_of(multipliers, np.arange(a.size), check, a, b, standardized)
    residual[failed] = _relative(_NORMAL_MOMENTS[: order + 1], standardized[failed])
    return Solution(
        a, b, multipliers, law.log_z, law.mean, psi, powers, residual, used, status, check
    )  # fmt: skip


def _lower_orders(order: int) -> list[int]:
    """Orders of the fallback: two less at a time, which keeps an even order even, and last 2."""
    return [*range(order - 2, 2, -2), 2] if order > 2 else []


def _attempt(a: Array, b: Array, standardized: Array, rules: _Rules) -> tuple[Array, Codes, bool]:
    """Multipliers (N, M) and status (N,) of one order, and whether a row had to be polished."""
    order = standardized.shape[1] - 1
    target = (legendre_in_powers(a, b, order) @ standardized[:, :, None])[:, :, 0]
    rows = np.flatnonzero(realizable(target))
    status = np.full(a.size, int(Status.NOT_REALIZABLE))
    multipliers = gaussian_start(a, b, order)
    multipliers[rows], converged = minimize_dual(target[rows, 1:], multipliers[rows], rules.solve)
    residual = _residual_of(multipliers, rows, rules.check, a, b, standardized)
    honest = converged & (residual <= _LARGEST_UNPOLISHED)
    status[rows[honest]] = Status.SOLVED
    hard = rows[~honest]
    if hard.size > 0:
        multipliers[hard], converged = polish(
            a[hard], b[hard], standardized[hard], multipliers[hard], rules.polish
        )
        residual = _residual_of(multipliers, hard, rules.fine, a, b, standardized)
        honest = converged & (residual <= LARGEST_RESIDUAL)
        status[hard] = np.where(honest, Status.SOLVED, Status.NOT_CONVERGED)
    return multipliers, status, hard.size > 0


def _residual_of(
    multipliers: Array, rows: Codes, check: Rule, a: Array, b: Array, standardized: Array
) -> Array:
    """Residual of the densities of these rows, by a rule of other nodes."""
    density = density_at(multipliers[rows], check)
    return _residual(density, check, a[rows], b[rows], standardized[rows])


def _orthonormal(
    a: Array, b: Array, multipliers: Array, law: Expectations, rules: _Rules
) -> tuple[Array, Array]:
    """Coefficients (N, M+1, M+1) of the polynomials orthonormal under the densities, in phi and in
    the powers of u: from the factors of the covariance, or by recurrence where these fail."""
    count, order = multipliers.shape
    factor, pivot = cholesky(law.covariance)
    psi = np.zeros((count, order + 1, order + 1))
    psi[:, 0, 0] = 1.0
    for k in range(order):
        unit = np.zeros((count, order))
        unit[:, k] = 1.0
        psi[:, 1:, k + 1] = forward(factor, unit)
    psi[:, 1:, 0] = -np.einsum("nkj,nj->nk", psi[:, 1:, 1:], law.mean)
    powers = psi @ legendre_in_powers(a, b, order)
    lost = np.flatnonzero(pivot < _SMALLEST_PIVOT)
    if lost.size > 0:
        exact = orthonormal(
            density_at(multipliers[lost], rules.fine),
            outcomes_at(rules.fine, a[lost], b[lost]), a[lost], b[lost], order,
        )  # fmt: skip
        psi[lost], powers[lost] = exact.legendre, exact.powers
    return psi, powers


def _residual(probability: Array, check: Rule, a: Array, b: Array, standardized: Array) -> Array:
    """Distance of the moments of u, summed at the nodes of the check, from those asked for.

    Powers of u itself are summed, so that a wrong conversion to Legendre moments shows as well.
    """
    u = outcomes_at(check, a, b)
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
