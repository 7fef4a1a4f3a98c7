"""The solver of maximum-entropy densities: it solves, checks, and falls back to fewer moments.

The density is exp(lambda.phi(t))/Z with Legendre polynomials phi_1..phi_M, orthonormal on [-1, 1].
Given the expectations p that E phi is to have, the multipliers lambda minimize the convex dual
function log Z(lambda) - lambda.p with Z = (1/2) int exp(lambda.phi) dt (paper, appendix "Maximum
entropy distribution", with the other sign of lambda). Its gradient is E phi - p, and its Hessian is
the covariance of phi. Products phi_i phi_j are sums of phi_k, k <= 2M, so that one matrix product
gives the value, gradient and Hessian of all experiments.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.status import Status
from aleator.core.types import Array, Flags
from aleator.moments.densities import Codes
from aleator.moments.legendre import (
    LegendreRule,
    cholesky,
    dot,
    forward,
    gauss_rule,
    legendre_in_powers,
    linearization,
    panel_rule,
    realizable,
    substitute,
    support_of,
)


@dataclass(frozen=True)
class EntropySettings:
    """Settings of the maximum-entropy solver, chosen by tests/moments/test_maximum_entropy.py.

    `panels` (a power of two) is the number of intervals of the piecewise Gauss-Legendre rule that
    is used for the check, the cdf and the quantile. Each interval has `panel_nodes` nodes if the
    solve has 200 nodes, and more in proportion. A check fails if the moments of the density miss
    the given ones by more than `exact`. Such a density is refined (`polish`) in two attempts. Each
    entry of `polished` gives for one attempt the nodes of its solve and of its check, as multiples
    of the nodes above, and the miss that is allowed. The first attempt gains digits, the second
    resolves modes narrower than the distance of the nodes. Nodes that are too coarse for a mode
    would mislead both a solve and its check, so that only the last attempt may miss by 1e-6.

    Newton's method takes at most `passes` steps, with an initial Levenberg `damping`. The steps are
    undamped once the Newton decrement is below `near`, and end once it is below `close`, where one
    more step is exact to rounding. `block` experiments are solved at once, so that their numbers
    fit the cache of a core.

    `penalty` is subtracted from the log-density that a search uses where a density could not be
    solved. It is a factor e^5 = 150 in likelihood, more than a fallback plausibly gains over the
    density that it replaces, so that the search avoids such places. An outcome outside the support
    by less than `touch` times half its width counts as lying on its edge.
    """

    panels: int = 32
    panel_nodes: int = 14
    exact: float = 1e-8
    polished: tuple[tuple[int, int, float], ...] = ((2, 3, 1e-7), (6, 8, 1e-6))
    passes: int = 150
    damping: float = 0.02
    near: float = 1e-6
    close: float = 1e-12
    block: int = 128
    penalty: float = 5.0
    touch: float = 1e-12


SETTINGS = EntropySettings()


@dataclass(frozen=True)
class Expectations:
    """The expectations under N densities exp(lambda.phi)/Z.

    `log_z` (N,) is log Z, `mean` (N, M) is E phi_1..E phi_M, `covariance` (N, M, M) is that of phi.
    """

    log_z: Array
    mean: Array
    covariance: Array


def expectations(multipliers: Array, rule: LegendreRule) -> Expectations:
    """Expectations under exp(multipliers.phi)/Z by a quadrature rule.

    The largest exponent is subtracted first, against overflow.
    """
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


def gaussian_start(a: Array, b: Array, order: int) -> Array:
    """Starting multipliers (N, M): those of the standard normal density exp(-u^2/2) on [a, b].

    With u = h t + c, -u^2/2 = -h c t - h^2 t^2/2 + const, and t^2 = 2 phi_2/(3 sqrt 5) + const.
    """
    half, center = 0.5 * (b - a), 0.5 * (a + b)
    start = np.zeros((a.size, order))
    start[:, 0] = -half * center / np.sqrt(3.0)
    start[:, 1] = -(half**2) / (3.0 * np.sqrt(5.0))
    return start


@dataclass
class _Descent:
    """The state of Newton's method for the experiments that have not converged.

    For each experiment: its row, the expectations `target`, the multipliers `position`, the dual
    function with gradient and Hessian there, the damping, the next step, its Newton decrement, and
    the part `extra` of the promised fall that is due to the damping.
    """

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
        """Keep only the experiments marked in `stays`; the others have converged."""
        for name, values in vars(self).items():
            setattr(self, name, values[stays])

    def advance(self, rule: LegendreRule, near: float) -> None:
        """Try the step, accept it where the dual function falls, and prepare the next one."""
        trial = self.position + self.step
        law = expectations(trial, rule)
        trial_value = law.log_z - dot(trial, self.target)
        # The rounding error of the dual grows with the largest exponent, which cancels in it.
        largest = np.abs(trial) @ np.sqrt(2.0 * np.arange(1, trial.shape[1] + 1) + 1.0)
        slack = 1e-15 * (1.0 + np.abs(law.log_z) + largest)
        promised = 0.5 * (self.decrement + self.extra)
        ratio = (self.value - trial_value + slack) / (promised + slack)
        accepted = ratio > 0.0
        self.position = np.where(accepted[:, None], trial, self.position)
        self.value = np.where(accepted, trial_value, self.value)
        self.gradient = np.where(accepted[:, None], law.mean - self.target, self.gradient)
        self.hessian = np.where(accepted[:, None, None], law.covariance, self.hessian)
        self.damping *= damping_factor(ratio)
        identity = np.eye(trial.shape[1])
        factor, _ = cholesky(self.hessian + self.damping[:, None, None] * identity)
        self.step = substitute(factor, -self.gradient)
        self.decrement = -dot(self.gradient, self.step)
        self.extra = self.damping * dot(self.step, self.step)
        rows = np.flatnonzero((ratio > 0.5) & (self.decrement < near))
        if rows.size == 0:
            return
        # Near the minimum the undamped step is taken, if its decrement confirms that the minimum is
        # near. If that step fails, the next one is damped.
        gradient = self.gradient[rows]
        step = substitute(cholesky(self.hessian[rows])[0], -gradient)
        decrement = -dot(gradient, step)
        sure = decrement < near
        self.step[rows[sure]], self.decrement[rows[sure]] = step[sure], decrement[sure]
        self.extra[rows[sure]] = 0.0


def damping_factor(ratio: Array, fair: float = 0.25, less: float = 0.1) -> Array:
    """Factor of Levenberg's damping, from the `ratio` of the actual to the promised fall."""
    return np.where(ratio > 1.0 - fair, less, np.where(ratio >= fair, 1.0, 4.0))


def minimize_dual(
    target: Array, start: Array, rule: LegendreRule, settings: EntropySettings = SETTINGS
) -> tuple[Array, Flags]:
    """Multipliers (N, M) with E phi = target (N, M), and whether each solve converged (N,).

    Newton's method with Levenberg's damping solves (H + mu I) step = p - E phi, where mu is raised
    if the dual function falls less than its quadratic model. A full Newton step fits the bulk of
    the density, but can let the exponent explode in the tails, where the Hessian has no weight. The
    damping weighs the support evenly (phi is orthonormal for the uniform law) and needs half the
    steps of a line search. An experiment leaves the batch as soon as it has converged. Cost: some
    7 steps of O(N Q M) at M = 4, for Q nodes.
    """
    answer, converged = start.copy(), np.zeros(start.shape[0], dtype=bool)
    count, order = start.shape
    # The first step has length zero. It is accepted because the value starts at infinity.
    descent = _Descent(
        rows=np.arange(count),
        target=target,
        position=start,
        value=np.full(count, np.inf),
        gradient=np.zeros((count, order)),
        hessian=np.zeros((count, order, order)),
        damping=np.full(count, 10.0 * settings.damping),
        step=np.zeros((count, order)),
        decrement=np.ones(count),
        extra=np.zeros(count),
    )
    for _ in range(settings.passes):
        if descent.rows.size == 0:
            break
        # A trial step whose value overflows is refused.
        with np.errstate(over="ignore", invalid="ignore"):
            descent.advance(rule, settings.near)
        close = descent.decrement < settings.close
        answer[descent.rows[close]] = (descent.position + descent.step)[close]
        converged[descent.rows[close]] = True
        if close.any():
            descent.keep(~close)
    answer[descent.rows] = descent.position
    return answer, converged


@dataclass(frozen=True)
class Orthonormal:
    """The polynomials psi_0..psi_M that are orthonormal under each of N densities.

    `values` (M+1, N, Q) are their values at the nodes; `legendre` and `powers`, both (N, M+1, M+1)
    and triangular, are their coefficients in phi_0..phi_M and in 1, u, .., u^M.
    """

    values: Array
    legendre: Array
    powers: Array


def orthonormal(probability: Array, u: Array, a: Array, b: Array, order: int) -> Orthonormal:
    """Polynomials orthonormal under the probabilities (N, Q) of the outcomes u (N, Q).

    They follow from their recurrence (Stieltjes; Gautschi 2004, sec. 2.2),
    beta_(k+1) psi_(k+1) = (u - alpha_k) psi_k - beta_k psi_(k-1), which is applied to the values at
    the nodes and to the coefficients. In coefficients, u = h t + c multiplies by
    t phi_j = s_(j+1) phi_(j+1) + s_j phi_(j-1), s_j = j/sqrt(4 j^2 - 1). Cost O(N Q M).
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
        alpha = dot(probability, values[k] ** 2 * u)
        previous = max(k - 1, 0)
        raised = (u - alpha[:, None]) * values[k] - beta[:, None] * values[previous]
        by_t = np.zeros((count, order + 1))
        by_t[:, 1:] = coupling * legendre[:, k, :-1]
        by_t[:, :-1] += coupling * legendre[:, k, 1:]
        in_phi = half[:, None] * by_t + (center - alpha)[:, None] * legendre[:, k]
        in_phi -= beta[:, None] * legendre[:, previous]
        in_u = -alpha[:, None] * powers[:, k] - beta[:, None] * powers[:, previous]
        in_u[:, 1:] += powers[:, k, :-1]
        beta = np.maximum(np.sqrt(dot(probability, raised**2)), 1e-150)
        values[k + 1] = raised / beta[:, None]
        legendre[:, k + 1] = in_phi / beta[:, None]
        powers[:, k + 1] = in_u / beta[:, None]
    return Orthonormal(values, legendre, powers)


def outcomes_at(rule: LegendreRule, a: Array, b: Array) -> Array:
    """Standardized outcomes u (N, Q) at the nodes of a rule, on the supports [a, b] (N,)."""
    return np.asarray(0.5 * (a + b)[:, None] + 0.5 * (b - a)[:, None] * rule.nodes)


def density_at(multipliers: Array, rule: LegendreRule) -> Array:
    """Probabilities (N, Q) of the nodes of a rule under the densities; each row sums to one."""
    exponent = multipliers @ rule.basis
    exponent -= exponent.max(axis=1)[:, None]
    np.maximum(exponent, -500.0, out=exponent)  # Smaller numbers would be denormal, and slow.
    probability = rule.weights * np.exp(exponent)
    probability /= probability.sum(axis=1)[:, None]
    return np.asarray(probability)


def polish(
    a: Array,
    b: Array,
    standardized: Array,
    start: Array,
    rule: LegendreRule,
    settings: EntropySettings = SETTINGS,
    rounding: float = 1e-16,
    undamped: float = 1e-6,
) -> tuple[Array, Flags]:
    """Refined multipliers (N, M) for densities whose first solve was inexact; whether converged.

    In the Legendre basis the covariance loses its digits if the density is narrow, or has two
    modes, on a wide support: its condition number grows like the 2M-th power of the ratio of the
    support's width to that of a mode. Therefore polynomials psi_k are used that are orthonormal
    under the present density f, computed anew at each step (Abramov, J. Comput. Phys. 226 (2007)
    621). In them the Hessian of the dual is the identity and E_f psi_k = 0. The Newton step is
    lambda.phi += sum_k delta_k psi_k with delta_k = P_k . c, where P_k are the coefficients of
    psi_k in powers of u and c the standardized moments. Levenberg's damping mu adds the uniform law
    to f, so that the step is bounded where f has no mass yet. An experiment has converged if the
    promised fall of the dual is rounding and the step is practically undamped.

    Cost O(N Q M) per step, some 10 times that of `minimize_dual`, for 10 to 100 steps. It fails
    where the density is narrower than the distance of the nodes.
    """
    multipliers, converged = start.copy(), np.zeros(a.size, dtype=bool)
    damping = np.full(a.size, settings.damping)
    active = np.arange(a.size)
    for _ in range(settings.passes):
        if active.size == 0:
            break
        # A trial step whose value overflows is refused.
        with np.errstate(all="ignore"):
            step, predicted, ratio = _trial(
                a[active], b[active], standardized[active],
                multipliers[active], damping[active], rule,
            )  # fmt: skip
        accepted = ratio > 0.0
        multipliers[active[accepted]] += step[accepted]
        arrived = accepted & (predicted < rounding) & (damping[active] < undamped)
        damping[active] *= damping_factor(ratio)
        converged[active[arrived]] = True
        active = active[~arrived]
    return multipliers, converged


def _trial(
    a: Array,
    b: Array,
    standardized: Array,
    multipliers: Array,
    damping: Array,
    rule: LegendreRule,
    rounding: float = 1e-14,
) -> tuple[Array, Array, Array]:
    """One damped Newton step of `polish`, and how well the dual function agrees with it.

    Returns the step (N, M), the promised fall of the dual (N,), and the actual over the promised
    fall (N,).
    """
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
    log_z = np.log(dot(density, np.exp(change - top[:, None]))) + top
    fall = dot(delta, asked) - log_z
    predicted = 0.5 * (1.0 + damping) * dot(delta, delta)
    ratio = (fall + rounding) / (predicted + rounding)
    step = np.einsum("nk,nkj->nj", delta, psi.legendre[:, 1:, 1:])
    return step, predicted, ratio


# ---------------------------------------------------------------------------- solution


@dataclass(frozen=True)
class Solution:
    """Solved densities f(u) = exp(multipliers.phi(t(u)) - log_z)/(b - a) of N experiments.

    `a`, `b` (N,) are the edges of the support, in standard deviations from the mean. `lower_moves`
    and `upper_moves` (N,) say whether the physical range has set a and b. Any other edge lies at -r
    or r with the half-width r of `reach_of`, whose derivatives by the standardized moments are
    `reach_slope` (N, M+1). `psi` and `powers` (N, M+1, M+1) are the coefficients of the polynomials
    orthonormal under f, in phi_0..phi_M and in powers of u. With T = psi without row and column 0,
    the inverse covariance of phi is T^T T. `order_used` (N,) is the number of moments that the
    density matches: M, or fewer after a fallback, with the multipliers filled up by zeros. It is 0
    where no density could be solved; the numbers of that row must not be used. `residual` (N,) is
    how much the density misses the given moments, computed by the rule `check`, which is not that
    of the solve. `status` (N,) holds `Status` codes.
    """

    a: Array
    b: Array
    lower_moves: Flags
    upper_moves: Flags
    reach_slope: Array
    multipliers: Array
    log_z: Array
    psi: Array
    powers: Array
    order_used: Codes
    residual: Array
    status: Codes
    check: LegendreRule

    def with_fallback(self, rows: Codes, lower: Solution, check: LegendreRule) -> Solution:
        """This solution, with densities of a lower order in `rows` where these could be solved."""
        kept = np.flatnonzero(lower.order_used)
        changed = {}
        for name in _ARRAYS[:-2]:
            own, other = getattr(self, name).copy(), getattr(lower, name)[kept]
            own[rows[kept]] = 0
            own[(rows[kept], *(slice(size) for size in other.shape[1:]))] = other
            changed[name] = own
        return replace(self, **changed, check=check)


_ARRAYS = [field.name for field in fields(Solution) if field.name != "check"]


def solve(
    lower: Array,
    upper: Array,
    standardized: Array,
    least: float,
    nodes: int,
    settings: EntropySettings = SETTINGS,
) -> Solution:
    """Maximum-entropy densities with standardized moments (N, M+1), each with a status.

    `lower`, `upper` (N,) are the physical range in standard deviations from the mean; the support
    is this range, cut at a half-width of at least `least` (`reach_of`). Where the check of a solve
    fails it is refined by `polish`. Where that fails too, a density of the first M-2 moments takes
    its place, or of M-4, .. 2, on the support for these; `status` keeps the failure. Cost
    O(N nodes M) per Newton step.
    """
    parts = [
        _solve_block(lower[rows], upper[rows], standardized[rows], least, nodes, settings)
        for rows in blocks(max(lower.size, 1), 1, settings.block)
    ]
    if len(parts) == 1:
        return parts[0]
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
    # The finest rule of any block serves as the check of all.
    return Solution(**joined, check=max((part.check for part in parts), key=_size))


def _solve_block(
    lower: Array,
    upper: Array,
    standardized: Array,
    least: float,
    nodes: int,
    settings: EntropySettings,
) -> Solution:
    order = standardized.shape[1] - 1
    a, b, lower_moves, upper_moves, slope = support_of(lower, upper, standardized, least)
    in_powers = legendre_in_powers(a, b, order)
    multipliers, residual, status, finest = _multipliers(
        a, b, standardized, in_powers, nodes, settings
    )
    multipliers[status != Status.SOLVED] = 0.0
    check = panel_rule(order, settings.panels, finest)
    law = expectations(multipliers, check)
    psi, powers = _orthonormal(a, b, multipliers, law, check, in_powers)
    used = np.where(status == Status.SOLVED, order, 0)
    solution = Solution(
        a, b, lower_moves, upper_moves, slope, multipliers, law.log_z, psi, powers, used, residual,
        status, check,
    )  # fmt: skip
    failed = np.flatnonzero(status)
    if failed.size == 0 or order == 2:
        return solution
    fewer = max(order - 2, 2)
    rows = lower[failed], upper[failed], standardized[failed, : fewer + 1]
    second = _solve_block(*rows, least, nodes, settings)
    finest = max(finest, _size(second.check) // settings.panels)
    return solution.with_fallback(failed, second, panel_rule(order, settings.panels, finest))


def _multipliers(
    a: Array,
    b: Array,
    standardized: Array,
    in_powers: Array,
    nodes: int,
    settings: EntropySettings,
) -> tuple[Array, Array, Codes, int]:
    """Multipliers (N, M) for all given moments on the supports [a, b].

    Returns the multipliers, how much they miss the moments (N,), their status (N,), and the number
    of nodes per interval of the finest check that was needed.
    """
    order, panels = standardized.shape[1] - 1, settings.panels
    target = (in_powers @ standardized[:, :, None])[:, :, 0]
    possible = realizable(target)
    start = gaussian_start(a, b, order)
    answer, residual = start.copy(), np.full(a.size, np.inf)
    hard = np.flatnonzero(possible)
    first = check = max(settings.panel_nodes, nodes // 15)

    def judge(found: Array, converged: Flags, allowed: float) -> Codes:
        """Keep multipliers that are better than before; return the rows whose check still fails."""
        rule = panel_rule(order, panels, check)
        missed = _residual(found, rule, a[hard], b[hard], standardized[hard])
        honest = converged & (missed <= allowed)
        taken = honest | (missed < residual[hard])
        answer[hard[taken]], residual[hard[taken]] = found[taken], missed[taken]
        return hard[~honest]

    if hard.size > 0:
        rule = gauss_rule(order, nodes)
        hard = judge(*minimize_dual(target[hard, 1:], start[hard], rule, settings), settings.exact)
    for polished_on, checked_on, allowed in settings.polished:
        if hard.size > 0:
            check, rule = checked_on * first, panel_rule(order, panels, polished_on * first)
            rows = a[hard], b[hard], standardized[hard], answer[hard]
            hard = judge(*polish(*rows, rule, settings), allowed)
    status = np.where(possible, Status.SOLVED, Status.NOT_REALIZABLE).astype(np.int64)
    status[hard] = Status.NOT_CONVERGED
    return answer, residual, status, check


def _orthonormal(
    a: Array,
    b: Array,
    multipliers: Array,
    law: Expectations,
    check: LegendreRule,
    in_powers: Array,
    smallest_pivot: float = 1e-8,
) -> tuple[Array, Array]:
    """Coefficients of the polynomials orthonormal under each density, in phi and in powers of u.

    Both are (N, M+1, M+1). They come from the Cholesky factors of the covariance of phi, or from
    the recurrence of the polynomials where these factors have lost half their digits.
    """
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
    lost = np.flatnonzero(pivot < smallest_pivot)
    if lost.size > 0:
        density = density_at(multipliers[lost], check)
        exact = orthonormal(density, outcomes_at(check, a[lost], b[lost]), a[lost], b[lost], order)
        psi[lost], powers[lost] = exact.legendre, exact.powers
    return psi, powers


def _residual(
    multipliers: Array, check: LegendreRule, a: Array, b: Array, standardized: Array
) -> Array:
    """How much each density misses its standardized moments, by the rule `check` (N,).

    It is the largest difference over the orders, relative for moments above one. The moments are
    sums of powers of u, so that an error in the conversion to Legendre moments would show as well.
    """
    u, probability = outcomes_at(check, a, b), density_at(multipliers, check)
    found = np.empty_like(standardized)
    for m in range(standardized.shape[1]):
        found[:, m] = probability.sum(axis=1)
        probability = probability * u
    distance = np.abs(found - standardized) / np.maximum(1.0, np.abs(standardized))
    return np.asarray(distance.max(axis=1))


def _size(rule: LegendreRule) -> int:
    return int(rule.nodes.size)
