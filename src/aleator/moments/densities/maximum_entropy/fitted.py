"""Fitted maximum-entropy densities in the unit of the outcome."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aleator.moments.densities.gaussian import FittedGaussian
from aleator.moments.densities.interface import (
    FAILED_SOLVE_PENALTY,
    Codes,
    Sensitivity,
    by_experiment,
    in_sds,
    one_per_experiment,
    probabilities,
)
from aleator.moments.densities.maximum_entropy.distribution import cumulative, inverse, log_density
from aleator.moments.densities.maximum_entropy.partials import TOUCH, partials
from aleator.moments.densities.maximum_entropy.solution import Solution
from aleator.status import Status
from aleator.types import Array, Flags


@dataclass(frozen=True)
class FittedMaximumEntropy:
    """Maximum-entropy densities of N experiments; methods as in `FittedDensity`.

    `normal` stands in where neither the order asked for nor a lower one could be solved.
    """

    normal: FittedGaussian
    solution: Solution

    @property
    def status(self) -> Codes:
        """(N,) how the solve of the order asked for ended."""
        return np.where(self.normal.degenerate, Status.DEGENERATE, self.solution.status).astype(
            np.int64
        )

    @property
    def _bounded(self) -> Flags:
        bounded: Flags = (self.solution.order_used > 0) & ~self.normal.degenerate
        return bounded

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y (N,) or (N, G); -inf outside the support."""
        t, sd = self._on_support(y)
        scale = np.log(sd * (self.solution.b - self.solution.a))[:, None]
        value = log_density(self.solution, np.clip(t, -1.0, 1.0)) - scale
        value = np.where(np.abs(t) <= 1.0 + TOUCH, value, -np.inf)
        value = np.where(np.isnan(t), np.nan, value)
        return self._or_normal(value, np.shape(y), lambda: self.normal.log_pdf(y))

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N,) or (N, G); 0 outside the support."""
        return np.exp(self.log_pdf(y))

    def cdf(self, y: ArrayLike) -> Array:
        """Probability of an outcome not above y (N,) or (N, G), to rounding."""
        t, _ = self._on_support(y)
        value = cumulative(self.solution, np.clip(t, -1.0, 1.0))
        return self._or_normal(value, np.shape(y), lambda: self.normal.cdf(y))

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,)."""
        p = probabilities(p)
        t = inverse(self.solution, np.broadcast_to(p, (self.normal.mean.size, p.size)))
        return self._or_normal(self._outcome(t), t.shape, lambda: self.normal.quantile(p))

    def sensitivity(self, y: ArrayLike) -> Sensitivity:
        """Value for the search at y (N,) with its partial derivatives, cost O(N M^2).

        With u = (y - mean)/sd: log f_Y(y) = value(u, a, b, c) - log sd. An edge of the physical
        range is a = (lower - mean)/sd, an edge at the reach a function of c. Outside the support a
        concave continuation, derived in `partials`, takes the place of -inf. A failed solve has
        the value of its fallback less FAILED_SOLVE_PENALTY; no density at all has
        DEGENERATE_VALUE and zero derivatives.
        """
        outcome = one_per_experiment(y, self.normal.mean.size, "the outcome")
        plain = self.normal.sensitivity(outcome)
        none = plain.status == Status.DEGENERATE
        mean, sd = self.normal.safe()
        u = in_sds(np.where(none, mean, outcome), mean, sd)
        own = partials(self.solution, u)
        d_a = np.where(self.solution.lower_moves, own.d_a, 0.0)
        d_b = np.where(self.solution.upper_moves, own.d_b, 0.0)
        # what does not move with the range moves with the reach
        by_reach = (own.d_b - d_b) - (own.d_a - d_a)
        moved = own.d_standardized + by_reach[:, None] * self.solution.reach_slope
        moved[:, :3] = 0.0
        scaled = u * own.d_u + self.solution.a * d_a + self.solution.b * d_b
        columns = np.zeros_like(plain.d_standardized)
        columns[:, : moved.shape[1]] = moved
        bounded = self._bounded & ~none
        status = np.where(own.outside & bounded, Status.OUTSIDE_SUPPORT, Status.SOLVED)
        failed = self.solution.status != Status.SOLVED
        status = np.where(failed, self.solution.status, status)
        value = np.where(bounded, own.value - np.log(sd), plain.value)
        return Sensitivity(
            value=value - np.where(failed & ~none, FAILED_SOLVE_PENALTY, 0.0),
            d_mean=np.where(bounded, -(own.d_u + d_a + d_b) / sd, plain.d_mean),
            d_sd=np.where(bounded, -(1.0 + scaled) / sd, plain.d_sd),
            d_standardized=np.where(bounded[:, None], columns, 0.0),
            d_lower=np.where(bounded, d_a / sd, 0.0),
            d_upper=np.where(bounded, d_b / sd, 0.0),
            status=np.where(none, Status.DEGENERATE, status).astype(np.int64),
        )

    def _on_support(self, y: ArrayLike) -> tuple[Array, Array]:
        """Outcomes as t (N, G), -1 and 1 at the edges, and sd (N,) of safe rows."""
        mean, sd = self.normal.safe()
        u = in_sds(by_experiment(y, mean.size, "the outcome"), mean[:, None], sd[:, None])
        a, b = self.solution.a[:, None], self.solution.b[:, None]
        return (2.0 * u - a - b) / (b - a), sd

    def _outcome(self, t: Array) -> Array:
        mean, sd = self.normal.safe()
        a, b = self.solution.a[:, None], self.solution.b[:, None]
        return mean[:, None] + sd[:, None] * (0.5 * (a + b) + 0.5 * (b - a) * t)

    def _or_normal(self, own: Array, shape: tuple[int, ...], normal: Callable[[], Array]) -> Array:
        """`own` in this shape, with the rows where the normal density stands in replaced."""
        own = own.reshape(shape)
        bounded = self._bounded
        if bounded.all():
            return own
        return np.where(bounded.reshape(-1, *[1] * (own.ndim - 1)), own, normal())
