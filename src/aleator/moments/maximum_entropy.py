"""The density of largest entropy that has the given moments on a bounded support."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from aleator.core.blocks import blocks
from aleator.core.status import Status
from aleator.core.threads import single_threaded
from aleator.core.types import Array, Flags
from aleator.errors import InputsError
from aleator.laws.law import invert
from aleator.moments.densities import (
    Codes,
    DensityPartials,
    FittedGaussian,
    FittedStandardized,
    check_moments,
    in_sds,
    range_end,
)
from aleator.moments.entropy_solver import SETTINGS, Solution, density_at, solve
from aleator.moments.legendre import dot, legendre
from aleator.moments.moments import Moments


@dataclass(frozen=True)
class MaximumEntropy:
    """The density of largest entropy with the first M moments, on a bounded support.

    f(y) = exp(sum_k lambda_k phi_k(t))/Z (paper, appendix "Maximum entropy distribution"). phi_k
    are Legendre polynomials of degree 1..M on the support [a, b] of u = (y - mean)/sd. The support
    is the physical range of the outcome, cut at r standard deviations on either side of the mean; r
    is at least `reach` and grows smoothly with heavy tails, so that their moments can be matched
    (`reach_of`). The paper takes the whole real line, where odd M, or M = 4 with a kurtosis above
    that of the normal, have no solution. On a bounded support every M has a solution if the moments
    are realizable. `order` M is 2..8, and `nodes` is the number of Gauss-Legendre nodes of the
    solve.

    A kurtosis above 3 makes a small bump at an edge r or -r. Raises InputsError for an inadmissible
    choice. Cost: some 7 Newton steps of O(N nodes M); for difficult moments at M of 6 and more,
    some 100 times that. A fit fails in three cases: the moments are not realizable; they are so
    close to that boundary that the density is a set of spikes; or eight moments of heavy tails
    leave no digits (a third of the cubics of a normal variable with a kurtosis of 10 to 20), for
    which reason orders above 8 are not allowed. Then the status says so, and a density of M-2
    moments takes its place.

    >>> m = Moments(np.array([1.0]), np.array([3.0**-0.5]), np.array([[1.0, 0.0, 1.0, 0.0, 1.8]]))
    >>> fitted = MaximumEntropy(order=4).fit(m, [0.0], [2.0])  # the moments of the uniform law
    >>> fitted.pdf([[0.0, 0.5, 2.0, 2.1]]).round(9).tolist()
    [[0.5, 0.5, 0.5, 0.0]]
    """

    order: int = 4
    reach: float = 8.0
    nodes: int = 200

    def __post_init__(self) -> None:
        if not 2 <= self.order <= 8:
            raise InputsError(
                f"maximum entropy of order {self.order}: the order is not in 2..8",
                "take 4, the usual choice",
            )
        if not (np.isfinite(self.reach) and self.reach > 0.0):
            raise InputsError(
                f"maximum entropy with reach {self.reach}: not positive and finite",
                "take 8 standard deviations, the usual choice",
            )
        if self.nodes < 4 * self.order:
            raise InputsError(
                f"maximum entropy of order {self.order} with {self.nodes} nodes: too few",
                "take 200 nodes, the usual choice",
            )

    @property
    def name(self) -> str:
        """Name of the density in reports."""
        return f"maximum entropy, {self.order} moments"

    @single_threaded
    def fit(self, moments: Moments, lower: ArrayLike, upper: ArrayLike) -> FittedMaximumEntropy:
        """Fit N densities on the physical ranges lower, upper (N,), each possibly infinite.

        Raises InputsError for too few moments or a wrong shape. A mean outside its range, or
        moments that no density on the support has, raise nothing and are reported by the status.
        """
        check_moments(moments, self.order, self.name)
        mean, sd = FittedGaussian(moments).safe()
        lower = in_sds(range_end(lower, mean.size, "lower"), mean, sd)
        upper = in_sds(range_end(upper, mean.size, "upper"), mean, sd)
        standardized = moments.standardized[:, : self.order + 1]
        # A mean that is NaN or outside the range gets moments that no density can have.
        usable = (lower < 0.0) & (upper > 0.0) & np.isfinite(standardized).all(axis=1)
        # These impossible moments are 1, 0, a second moment of -1, and zeros.
        none = np.array([1.0, 0.0, -1.0, *np.zeros(self.order - 2)])
        standardized = np.where(usable[:, None], standardized, none)
        lower, upper = np.where(usable, lower, -np.inf), np.where(usable, upper, np.inf)
        found = solve(lower, upper, standardized, self.reach, self.nodes)
        return FittedMaximumEntropy(moments, found)


@dataclass(frozen=True)
class FittedMaximumEntropy(FittedStandardized):
    """Maximum-entropy densities of N experiments, with the methods of `FittedDensity`.

    The normal density takes the place where neither the chosen order nor a lower one was solved.
    """

    moments: Moments
    solution: Solution

    @property
    def status(self) -> Codes:
        """The `Status` code (N,) of each solve with the chosen number of moments."""
        return np.where(self.degenerate, Status.DEGENERATE, self.solution.status).astype(np.int64)

    @property
    def _normal(self) -> Flags:
        """Whether the normal density takes the place of the solved one, (N, 1)."""
        return np.asarray((self.solution.order_used == 0)[:, None])

    def log_density(self, u: Array) -> Array:
        """Log-density of the standardized outcome at u (N, G); -inf outside the support."""
        t = self._on_support(u)
        scale = np.log(self.solution.b - self.solution.a)[:, None]
        value = log_density(self.solution, np.clip(t, -1.0, 1.0)) - scale
        value = np.where(np.abs(t) <= 1.0 + SETTINGS.touch, value, -np.inf)
        value = np.where(np.isnan(t), np.nan, value)
        return np.where(self._normal, FittedGaussian(self.moments).log_density(u), value)

    def below(self, u: Array) -> Array:
        """Probability (N, G) of a standardized outcome below u (N, G), exact to rounding."""
        value = cumulative(self.solution, np.clip(self._on_support(u), -1.0, 1.0))
        return np.where(self._normal, ndtr(u), value)

    def inverse(self, p: Array) -> Array:
        """Quantiles u (N, P) of the standardized outcomes for the probabilities p (P,)."""
        a, b = self.solution.a[:, None], self.solution.b[:, None]
        t = inverse(self.solution, np.broadcast_to(p, (a.size, p.size)))
        return np.where(self._normal, ndtri(p), 0.5 * (a + b) + 0.5 * (b - a) * t)

    def partials(self, u: Array) -> DensityPartials:
        """The value that a search uses for log g at u (N,), with its partials. Cost O(N M^2).

        The formulas are derived in `support_partials`. An edge set by the physical range is
        a = (lower - mean)/sd, and moves with the mean and the sd; an edge at the half-width of
        `reach_of` moves with the standardized moments. Outside the support a concave continuation
        takes the place of -inf. A failed solve has the value of its fallback minus the penalty.
        """
        s, normal = self.solution, self._normal[:, 0]
        plain, own = FittedGaussian(self.moments).partials(u), support_partials(s, u)
        d_a = np.where(s.lower_moves, own.d_a, 0.0)
        d_b = np.where(s.upper_moves, own.d_b, 0.0)
        # Edges that the physical range has not set move with the standardized moments.
        by_reach = (own.d_b - d_b) - (own.d_a - d_a)
        moved = own.d_standardized + by_reach[:, None] * s.reach_slope
        moved[:, :3] = 0.0
        columns = np.zeros(self.moments.standardized.shape)
        columns[:, : moved.shape[1]] = moved
        outside = np.where(own.outside & ~normal, Status.OUTSIDE_SUPPORT, Status.SOLVED)
        failed = s.status != Status.SOLVED
        value = np.where(normal, plain.value, own.value)
        return DensityPartials(
            value=value - np.where(failed, SETTINGS.penalty, 0.0),
            d_mean=np.where(normal, plain.d_mean, -(own.d_u + d_a + d_b)),
            d_sd=np.where(normal, plain.d_sd, -(u * own.d_u + s.a * d_a + s.b * d_b)),
            d_standardized=np.where(normal[:, None], 0.0, columns),
            status=np.where(failed, s.status, outside).astype(np.int64),
        )

    def _on_support(self, u: Array) -> Array:
        """Standardized outcomes u (N, G) as coordinates t, with -1 and 1 at the support's edges."""
        a, b = self.solution.a[:, None], self.solution.b[:, None]
        return np.asarray((2.0 * u - a - b) / (b - a))


def log_density(solution: Solution, t: Array) -> Array:
    """Logarithm of the density at t (N, ...), relative to the uniform law on [-1, 1]."""
    multipliers = solution.multipliers
    shape = (-1, *[1] * (t.ndim - 1))
    below, here = np.ones_like(t), t
    total = np.broadcast_to(-solution.log_z.reshape(shape), t.shape)
    for k in range(1, multipliers.shape[1] + 1):
        total = total + np.sqrt(2.0 * k + 1.0) * multipliers[:, k - 1].reshape(shape) * here
        below, here = here, ((2 * k + 1) * t * here - k * below) / (k + 1)
    return total


def cumulative(solution: Solution, t: Array) -> Array:
    """Probability (N, G) of the interval [-1, t], for t (N, G).

    It is the sum over the whole intervals of the check rule below t, and a Gauss-Legendre integral
    over the part of the interval in which t lies.
    """
    below, edges = _below_panels(solution), solution.check.edges
    panel = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, edges.size - 2)
    value = np.take_along_axis(below, panel, axis=1) + _part(solution, panel, t)
    return np.clip(value, 0.0, 1.0)


def inverse(solution: Solution, p: Array, largest: int = 10**6) -> Array:
    """Quantiles t (N, G) for the probabilities p (N, G).

    Bisection finds the interval of the check rule, then Newton's method the quantile within it.
    About `largest` exponentials are evaluated at once. Cost: some six evaluations of the cdf.
    """
    below, edges, t = _below_panels(solution), solution.check.edges, np.empty(p.shape)
    for part in blocks(p.shape[1], _part_nodes(solution) * max(1, p.shape[0]), largest):
        panel = _panel_of(below, p[:, part])
        t[:, part] = invert(
            partial(_part, solution, panel),
            lambda t: 0.5 * np.exp(log_density(solution, t)),
            p[:, part] - np.take_along_axis(below, panel, axis=1),
            edges[panel],
            edges[panel + 1],
        )
    return np.where(p <= 0.0, -1.0, np.where(p >= 1.0, 1.0, t))


def _below_panels(solution: Solution) -> Array:
    """Probability below each end of the check rule's intervals, one column for each end."""
    probability = density_at(solution.multipliers, solution.check)
    panels = solution.check.edges.size - 1
    masses = probability.reshape(probability.shape[0], panels, -1).sum(axis=2)
    below = np.zeros((masses.shape[0], panels + 1))
    np.cumsum(masses, axis=1, out=below[:, 1:])
    return below


def _panel_of(below: Array, p: Array) -> Codes:
    """The number (N, G) of the interval in which the cdf reaches p (N, G), by bisection."""
    panel = np.zeros(p.shape, dtype=np.int64)
    step = (below.shape[1] - 1) // 2
    while step:
        further = np.take_along_axis(below, panel + step, axis=1) <= p
        panel = np.where(further, panel + step, panel)
        step //= 2
    return panel


def _part(solution: Solution, panel: Codes, t: Array) -> Array:
    """Probability (N, G) between the left end of the interval number `panel` and t."""
    x, w = np.polynomial.legendre.leggauss(_part_nodes(solution))
    left = solution.check.edges[panel]
    width = t - left
    points = left[..., None] + 0.5 * width[..., None] * (x + 1.0)
    return 0.25 * width * (np.exp(log_density(solution, points)) @ w)


def _part_nodes(solution: Solution) -> int:
    return solution.check.nodes.size // (solution.check.edges.size - 1) + 2


@dataclass(frozen=True)
class SupportPartials:
    """The log-density of u that a search uses, with its partial derivatives.

    `value` (N,) is the log-density or its continuation; `d_u`, `d_a`, `d_b` (N,) are the partials
    by u and the edges of the support, `d_standardized` (N, M+1) those by the standardized moments.
    `outside` (N,) says whether u lies outside the support.
    """

    value: Array
    d_u: Array
    d_a: Array
    d_b: Array
    d_standardized: Array
    outside: Flags


def support_partials(solution: Solution, u: Array) -> SupportPartials:
    """The log-density that a search uses at u (N,), with its partials; cost O(N M^2).

    Let the basis be a fixed function of u, phi_k(u) = phi_k(t(u)) for the present edges a, b of the
    support, so that only the limits of integration move with the edges. The multipliers lambda
    solve F(lambda, c, a, b) = 0,

        F = E phi - C c,   E g = int_a^b g exp(lambda.phi) du / int_a^b exp(lambda.phi) du,

    with c the standardized moments and C the rows of phi in powers of u. With H = dF/dlambda the
    covariance of phi and f the density,

        dF/db = f(b) (phi(b) - E phi),  dF/da = -f(a) (phi(a) - E phi),  dF/dc = -C,

    hence dlambda/dc = H^-1 C, dlambda/db = -H^-1 f(b) (phi(b) - E phi), and for a the opposite
    sign. In the polynomials psi orthonormal under f, psi_k = sum_j T_kj (phi_j - E phi_j), k > 0,
    the inverse is H^-1 = T^T T, so that v.H^-1 v' = sum_k (T v)_k (T v')_k and T C are the
    coefficients of psi in the powers of u. Since log f(u) = lambda.phi(u) - log int
    exp(lambda.phi), and the logarithm of the integral changes by E phi.dlambda + f(b) db - f(a) da,

        d log f(u) = (phi(u) - E phi).dlambda - f(b) db + f(a) da   at fixed u.

    Outside the support the value is, with e the nearest edge, D = u - e and g = (log f)'(e),

        value = log f(e) + k g D - D^2/2,   k = 1 where the density falls outward at e, else 0.

    It is continuous, never above log f(e), and falls with the distance from the support. Through
    the multipliers it changes by v.dlambda - f(b) db + f(a) da with v = phi(e) - E phi + k D
    phi'(e). Its derivative by the edge e itself is (1 - k) g + k D lambda.phi''(e) + D, and by the
    outcome u it is k g - D. Inside the support e = u and D = 0: v has the same form, the edges have
    no direct effect, and the derivative by u is g.
    """
    s = solution
    order = s.multipliers.shape[1]
    half = 0.5 * (s.b - s.a)
    edge = np.clip(u, s.a, s.b)
    t = np.clip((edge - 0.5 * (s.a + s.b)) / half, -1.0, 1.0)
    beyond = u - edge
    phi, slope, curvature = (
        legendre(t, order, derivative) / half[:, None] ** derivative for derivative in range(3)
    )
    g = dot(s.multipliers, slope[:, 1:])
    inside = beyond == 0.0
    falls = np.where(g * beyond < 0.0, 1.0, 0.0)
    log_f = dot(s.multipliers, phi[:, 1:]) - s.log_z - np.log(2.0 * half)
    # The coefficients of v in the orthonormal polynomials; degree 0 does not occur in it.
    w = np.einsum("nkj,nj->nk", s.psi[:, 1:], phi + (falls * beyond)[:, None] * slope)
    d_a, d_b = (
        side * np.exp(s.multipliers @ end[1:] - s.log_z) / (2.0 * half)
        * (1.0 + dot(w, s.psi[:, 1:] @ end))
        for side, end in zip((1.0, -1.0), legendre(np.array([-1.0, 1.0]), order), strict=True)
    )  # fmt: skip
    by_edge = (1.0 - falls) * g + falls * beyond * dot(s.multipliers, curvature[:, 1:]) + beyond
    powers = np.einsum("nk,nki->ni", w, s.powers[:, 1:])
    powers[:, :3] = 0.0
    return SupportPartials(
        value=log_f + falls * g * beyond - 0.5 * beyond**2,
        d_u=np.where(inside, g, falls * g - beyond),
        d_a=d_a + np.where(beyond < 0.0, by_edge, 0.0),
        d_b=d_b + np.where(beyond > 0.0, by_edge, 0.0),
        d_standardized=powers,
        outside=np.abs(beyond) > SETTINGS.touch * half,
    )
