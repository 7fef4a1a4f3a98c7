"""Maximum-entropy densities of standardized outcomes: solved, checked, with their fallback."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from aleator.blocks import blocks
from aleator.moments.densities.interface import Codes
from aleator.moments.densities.maximum_entropy.dual import (
    Expectations,
    expectations,
    gaussian_start,
    minimize_dual,
)
from aleator.moments.densities.maximum_entropy.legendre import (
    Rule,
    cholesky,
    forward,
    gauss_rule,
    legendre_in_powers,
    panel_rule,
    realizable,
)
from aleator.moments.densities.maximum_entropy.nearby import follow, predicted
from aleator.moments.densities.maximum_entropy.support import Support, support_of
from aleator.moments.densities.maximum_entropy.whitened import (
    density_at,
    orthonormal,
    outcomes_at,
    polish,
)
from aleator.status import Status
from aleator.types import Array, Flags

PANELS = 32
"""A power of two; the panels serve the check, the cdf and the quantile."""

_PANEL_NODES = 14
"""At 200 nodes of the solve; more in proportion, so that the check never sees less."""

_FINER = 4
"""Times the nodes of the solve, where its check refutes it: for modes that are narrow."""

_POLISHED = ((2, 3, 1e-7), (6, 8, 1e-6))
"""What is refuted again is polished on so many times the nodes of the check, and checked on the
second multiple: first for digits, then for modes narrower than those nodes lie apart. Nodes too
coarse for a mode mislead a solve and its check alike, so that only the last may leave as much as
the largest residual that counts as solved, 1e-6."""

_UNPOLISHED = 1e-8
"""Largest residual that stands without a finer look."""

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
    that stands for nothing. `exponent` (N, M+1) is multipliers.phi in powers of u, `standardized`
    (N, M+1) the moments asked for. `check` is the rule of the residual, independent of that of the
    solve.
    """

    a: Array
    b: Array
    lower_moves: Flags
    upper_moves: Flags
    reach_slope: Array
    multipliers: Array
    log_z: Array
    mean: Array
    psi: Array
    powers: Array
    exponent: Array
    standardized: Array
    residual: Array
    order_used: Codes
    status: Codes
    check: Rule

    def take(self, rows: slice) -> Solution:
        """Some of the densities."""
        return Solution(*(_taken(getattr(self, field.name), rows) for field in fields(self)))


def solve(
    lower: Array,
    upper: Array,
    standardized: Array,
    least: float,
    nodes: int,
    known: Solution | None = None,
) -> Solution:
    """Densities with the standardized moments (N, M+1) on lower, upper (N,), each with a status.

    Where densities of the same experiments are `known` for moments nearby, they are the start.

    The range, in standard deviations from the mean, is cut at the reach, at least `least`. Where
    the check refutes a solve it is polished on finer nodes in a basis orthonormal under the
    density itself; where that fails too, order M-2, M-4, .. 2 within its own reach takes its place
    and `status` keeps the failure. Cost O(N nodes M) a Newton step.
    """
    parts = [
        _solve_block(
            lower[rows], upper[rows], standardized[rows], least, nodes, known and known.take(rows)
        )
        for rows in blocks(max(lower.size, 1), 1, _BLOCK)
    ]
    if len(parts) == 1:
        return parts[0]
    joined: dict[str, Any] = {
        field.name: np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(Solution)
        if field.name != "check"
    }
    # the finest check serves all
    return Solution(**joined, check=max((part.check for part in parts), key=_size))


def _solve_block(
    lower: Array,
    upper: Array,
    standardized: Array,
    least: float,
    nodes: int,
    known: Solution | None,
) -> Solution:
    best = _attempt(lower, upper, standardized, least, nodes, known)
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
    in_powers, residual = best.in_powers, best.residual
    if np.any(best.status) or finest != _check_nodes(nodes):
        in_powers = legendre_in_powers(support.a, support.b, order)
        residual = _residual(multipliers, check, support.a, support.b, standardized)
        residual[failed] = _relative(_NORMAL_MOMENTS[: order + 1], standardized[failed])
    psi, powers = _orthonormal(support, multipliers, law, check, in_powers)
    unused = np.arange(order + 1) > used[:, None]
    psi[unused], powers[unused] = 0.0, 0.0
    exponent = (multipliers[:, None] @ in_powers[:, 1:])[:, 0]
    return Solution(
        support.a, support.b, support.lower_moves, support.upper_moves, support.slope,
        multipliers, law.log_z, law.mean, psi, powers, exponent, standardized, residual, used,
        best.status, check,
    )  # fmt: skip


def _lower_orders(order: int) -> list[int]:
    """Orders of the fallback: two less at a time, which keeps an even order even, and last 2."""
    return [*range(order - 2, 2, -2), 2] if order > 2 else []


@dataclass(frozen=True)
class _Attempt:
    """Multipliers (N, M) of one order on its support, phi there in powers of u, their status and
    residual (N,), and the nodes in a panel of the finest check that was needed."""

    support: Support
    in_powers: Array
    multipliers: Array
    status: Codes
    residual: Array
    check: int


def _attempt(
    lower: Array,
    upper: Array,
    standardized: Array,
    least: float,
    nodes: int,
    known: Solution | None = None,
) -> _Attempt:
    """Solve one order; solve again on finer nodes, then polish, what the check refutes."""
    order, check = standardized.shape[1] - 1, _check_nodes(nodes)
    support = support_of(lower, upper, standardized, least)
    a, b = support.a, support.b
    in_powers = legendre_in_powers(a, b, order)
    target = (in_powers @ standardized[:, :, None])[:, :, 0]
    possible = realizable(target)
    start = gaussian_start(a, b, order)
    trial = _Trial(
        a, b, standardized, start, np.full(a.size, np.inf), np.flatnonzero(possible)
    )  # fmt: skip

    if known is not None:
        change = standardized - known.standardized
        guess = predicted(known.exponent, known.powers, change, in_powers)
        guess[known.status != Status.SOLVED] = np.nan
        nearby = follow(target[trial.hard, 1:], guess[trial.hard], gauss_rule(order, nodes))
        trial = trial.after(*nearby, check, _UNPOLISHED)
    first = check
    for finer, allowed in ((1, _UNPOLISHED), (_FINER, _POLISHED[0][2])):
        if trial.hard.size > 0:
            check = first if finer == 1 else _POLISHED[0][1] * first
            rule = gauss_rule(order, finer * nodes)
            found = minimize_dual(target[trial.hard, 1:], start[trial.hard], rule)
            trial = trial.after(*found, check, allowed)
    for polished_on, checked_on, allowed in _POLISHED:
        if trial.hard.size > 0:
            check = checked_on * first
            rule = panel_rule(order, PANELS, polished_on * first)
            trial = trial.after(*polish(*trial.rows(), rule), check, allowed)
    status = np.where(possible, Status.SOLVED, Status.NOT_REALIZABLE).astype(np.int64)
    status[trial.hard] = Status.NOT_CONVERGED
    return _Attempt(support, in_powers, trial.multipliers, status, trial.residual, check)


@dataclass(frozen=True)
class _Trial:
    """Multipliers (N, M) so far, their residuals, and the rows `hard` that are not solved yet."""

    a: Array
    b: Array
    standardized: Array
    multipliers: Array
    residual: Array
    hard: Codes

    def rows(self) -> tuple[Array, Array, Array, Array]:
        """The edges, moments and multipliers of the hard rows."""
        hard = self.hard
        return self.a[hard], self.b[hard], self.standardized[hard], self.multipliers[hard]

    def after(self, found: Array, converged: Flags, check: int, allowed: float) -> _Trial:
        """With what was found for the hard rows, where that is nearer to the moments; those whose
        check holds are hard no more."""
        a, b, standardized, _ = self.rows()
        residual = _residual(found, panel_rule(found.shape[1], PANELS, check), a, b, standardized)
        honest = converged & (residual <= allowed)
        taken = honest | (residual < self.residual[self.hard])
        multipliers, smallest = self.multipliers.copy(), self.residual.copy()
        multipliers[self.hard[taken]] = found[taken]
        smallest[self.hard[taken]] = residual[taken]
        return replace(self, multipliers=multipliers, residual=smallest, hard=self.hard[~honest])


def _orthonormal(
    support: Support, multipliers: Array, law: Expectations, check: Rule, in_powers: Array
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
    powers = psi @ in_powers
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


def _check_nodes(nodes: int) -> int:
    """Of a panel, for so many nodes of the solve."""
    return max(_PANEL_NODES, nodes // 15)


def _size(rule: Rule) -> int:
    return rule.nodes.size


def _taken(values: Any, rows: slice) -> Any:
    return values[rows] if isinstance(values, np.ndarray) else values
