"""Maximum-entropy densities of standardized outcomes: solved, checked, with their fallback."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from aleator.densities.dual import Expectations, expectations, gaussian_start, minimize_dual
from aleator.densities.interface import Array, Codes, Mask, Status
from aleator.densities.legendre import (
    Rule,
    cholesky,
    forward,
    gauss_rule,
    legendre_in_powers,
    panel_rule,
    realizable,
)
from aleator.densities.reach import Support, support_of
from aleator.densities.whitened import density_at, orthonormal, outcomes_at, polish

PANELS = 32
"""A power of two; the panels serve the check, the cdf and the quantile."""

_PANEL_NODES = 10
"""At 200 nodes of the solve; more in proportion, so that the check never sees less."""

_FINER = ((3, 4), (8, 10))
"""A solve that its check refutes is polished on so many times the nodes of the check, and checked
on the second multiple: first for digits, then for modes narrower than those nodes lie apart."""

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
    lower_moves: Mask
    upper_moves: Mask
    reach_slope: Array
    multipliers: Array
    log_z: Array
    mean: Array
    psi: Array
    powers: Array
    residual: Array
    order_used: Codes
    status: Codes
    check: Rule


def solve(lower: Array, upper: Array, standardized: Array, least: float, nodes: int) -> Solution:
    """Densities with the standardized moments (N, M+1) on lower, upper (N,), each with a status.

    The range, in standard deviations from the mean, is cut at the reach, at least `least`. Where
    the check refutes a solve it is polished on finer nodes in a basis orthonormal under the
    density itself; where that fails too, order M-2, M-4, .. 2 within its own reach takes its place
    and `status` keeps the failure. Cost O(N nodes M) a Newton step.
    """
    blocks = [
        _solve_block(lower[block], upper[block], standardized[block], least, nodes)
        for block in (slice(i, i + _BLOCK) for i in range(0, max(lower.size, 1), _BLOCK))
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


def _solve_block(
    lower: Array, upper: Array, standardized: Array, least: float, nodes: int
) -> Solution:
    best = _attempt(lower, upper, standardized, least, nodes)
    order = standardized.shape[1] - 1
    multipliers, finest = best.multipliers, best.check
    used = np.where(best.status == Status.SOLVED, order, 0)
    support = best.support
    failed = np.flatnonzero(best.status)
    multipliers[failed] = 0.0
    for fewer in _lower_orders(order):
        if failed.size == 0:
            break
        second = _attempt(
            lower[failed], upper[failed], standardized[failed, : fewer + 1], least, nodes
        )
        kept = second.status == Status.SOLVED
        rows, failed = failed[kept], failed[~kept]
        multipliers[rows, :fewer] = second.multipliers[kept]
        used[rows] = fewer
        support = support.replaced(rows, second.support, kept)
        finest = max(finest, second.check)
    check = panel_rule(order, PANELS, finest)
    law = expectations(multipliers, check)
    psi, powers = _orthonormal(support, multipliers, law, check)
    unused = np.arange(order + 1) > used[:, None]
    psi[unused], powers[unused] = 0.0, 0.0
    residual = _residual(multipliers, check, support.a, support.b, standardized)
    residual[failed] = _relative(_NORMAL_MOMENTS[: order + 1], standardized[failed])
    return Solution(
        support.a, support.b, support.lower_moves, support.upper_moves, support.slope,
        multipliers, law.log_z, law.mean, psi, powers, residual, used, best.status, check,
    )  # fmt: skip


def _lower_orders(order: int) -> list[int]:
    """Orders of the fallback: two less at a time, which keeps an even order even, and last 2."""
    return [*range(order - 2, 2, -2), 2] if order > 2 else []


@dataclass(frozen=True)
class _Attempt:
    """Multipliers (N, M) of one order on its support, their status (N,), and the nodes in a panel
    of the finest check that was needed."""

    support: Support
    multipliers: Array
    status: Codes
    check: int


def _attempt(lower: Array, upper: Array, standardized: Array, least: float, nodes: int) -> _Attempt:
    """Solve one order, polish what its check refutes, and polish again on finer nodes."""
    order, each = standardized.shape[1] - 1, max(_PANEL_NODES, nodes // 20)
    support = support_of(lower, upper, standardized, least)
    a, b = support.a, support.b
    target = (legendre_in_powers(a, b, order) @ standardized[:, :, None])[:, :, 0]
    hard = np.flatnonzero(realizable(target))
    status = np.full(a.size, int(Status.NOT_REALIZABLE))
    status[hard] = Status.NOT_CONVERGED
    multipliers = gaussian_start(a, b, order)
    multipliers[hard], converged = minimize_dual(
        target[hard, 1:], multipliers[hard], gauss_rule(order, nodes)
    )
    check, allowed = each, _LARGEST_UNPOLISHED
    for polished_on, checked_on in (*_FINER, (0, 0)):
        rule = panel_rule(order, PANELS, check)
        residual = _residual(multipliers[hard], rule, a[hard], b[hard], standardized[hard])
        honest = converged & (residual <= allowed)
        status[hard[honest]] = Status.SOLVED
        hard = hard[~honest]
        if hard.size == 0 or polished_on == 0:
            break
        check, allowed = checked_on * each, LARGEST_RESIDUAL
        multipliers[hard], converged = polish(
            a[hard], b[hard], standardized[hard], multipliers[hard],
            panel_rule(order, PANELS, polished_on * each),
        )  # fmt: skip
    return _Attempt(support, multipliers, status, check)


def _orthonormal(
    support: Support, multipliers: Array, law: Expectations, check: Rule
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
    powers = psi @ legendre_in_powers(support.a, support.b, order)
    lost = np.flatnonzero(pivot < _SMALLEST_PIVOT)
    if lost.size > 0:
        a, b = support.a[lost], support.b[lost]
        density = density_at(multipliers[lost], check)
        exact = orthonormal(density, outcomes_at(check, a, b), a, b, order)
        psi[lost], powers[lost] = exact.legendre, exact.powers
    return psi, powers


def _residual(multipliers: Array, check: Rule, a: Array, b: Array, standardized: Array) -> Array:
    """Distance of the moments of u, summed at the nodes of the check, from those asked for.

    Powers of u itself are summed, so that a wrong conversion to Legendre moments shows as well.
    """
    u, probability = outcomes_at(check, a, b), density_at(multipliers, check)
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
