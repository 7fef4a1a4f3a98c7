"""Fitted log-splines in the unit of the outcome, with their exact partials by the nodes.

Let the support be [A, B], W = B - A, t = (y - A)/W, and t_j, s the same of nodes and noise. Then
log f(y) = theta.B(t) - log Z - log W, and theta depends on A, B only through t_j and s:

    d log f = g.dp + (theta.B'(t)) dt - dlog W,   g = H^-1 (B(t) - E B),

    g.dp = sum_j (G(t_j) dw_j + w_j G'(t_j) dt_j + w_j dG/ds(t_j) ds),   G(x) = E g.B(x + s e).

Both ends move t by dt = -((1 - t) dA + t dB)/W, and s by -s (dB - dA)/W. An end at the reach moves
with mean and sd of the outcome, an end of the range with the range and with the noise. Outside
the support the search sees log f at the edge less ((y - edge)/sd)^2/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aleator.densities.gaussian import FittedGaussian
from aleator.densities.interface import (
    DEGENERATE_VALUE,
    Codes,
    NodeSensitivity,
    Status,
    by_experiment,
    one_per_experiment,
    probabilities,
)
from aleator.densities.inversion import invert
from aleator.densities.logspline.splines import NoisyPowers, evaluate, noisy, spline_rule, splines
from aleator.densities.stand_in import NodeNormal
from aleator.types import Array, Flags

_TOUCH = 1e-12
"""An outcome beyond an edge by less than this part of the support lies on the edge."""

_LARGEST_BATCH = 50_000
"""Powers computed at once: they fit the cache of one core."""


@dataclass(frozen=True)
class Support:
    """Ends a, b (N,) of the support and the outcome's sd `scale`; which ends the range has set (the
    others lie `reach` sds from the mean); where the range does not hold the mean (`empty`)."""

    a: Array
    b: Array
    scale: Array
    lower_moves: Flags
    upper_moves: Flags
    reach: float
    margin: float
    empty: Flags

    @property
    def width(self) -> Array:
        """(N,)"""
        return self.b - self.a

    def inside(self, y: Array) -> Array:
        """Outcomes y (N, G) as t, 0 and 1 at the ends."""
        return (y - self.a[:, None]) / self.width[:, None]


@dataclass(frozen=True)
class FittedLogSpline:
    """Log-spline densities of N experiments; methods as in `FittedDensity`.

    `normal` stands in where the status is not SOLVED.
    """

    nodes: NodeNormal
    normal: FittedGaussian
    range: Support
    coefficients: Array
    log_z: Array
    mean: Array
    hessian: Array
    status: Codes

    @property
    def _solved(self) -> Flags:
        return np.asarray(self.status == int(Status.SOLVED))

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y (N,) or (N, G); -inf outside the support."""
        outcome = by_experiment(y, self.log_z.size, "the outcome")
        t = self.range.inside(outcome)
        value = self._log_density(np.clip(t, 0.0, 1.0)) - np.log(self.range.width)[:, None]
        value = np.where((t >= -_TOUCH) & (t <= 1.0 + _TOUCH), value, -np.inf)
        return self._or(value, self.normal.log_pdf(outcome)).reshape(np.shape(y))

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N,) or (N, G); 0 outside the support."""
        return np.exp(self.log_pdf(y))

    def cdf(self, y: ArrayLike) -> Array:
        """Probability of an outcome not above y (N,) or (N, G)."""
        outcome = by_experiment(y, self.log_z.size, "the outcome")
        own = self._below(np.clip(self.range.inside(outcome), 0.0, 1.0))
        return self._or(own, self.normal.cdf(outcome)).reshape(np.shape(y))

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,)."""
        level = probabilities(p)
        own = self._inverse(np.broadcast_to(level, (self.log_z.size, level.size)))
        return self._or(own, self.normal.quantile(level))

    def node_sensitivity(self, y: ArrayLike) -> NodeSensitivity:
        """Value for the search at y (N,) with its partial derivatives; cost O(N J K).

        Outside the support the continuation of this module; without a spline the normal density
        less FAILED_SOLVE_PENALTY; without any density DEGENERATE_VALUE.
        """
        outcome = one_per_experiment(y, self.log_z.size, "the outcome")
        none = (self.status == int(Status.DEGENERATE)) | ~np.isfinite(outcome)
        outcome = np.where(none, self.nodes.mean, outcome)
        own, solved = self._own(outcome), self._solved
        if not solved.all():
            own = _put(own, self._stand_in(outcome), solved)
        inside = self.range.inside(outcome[:, None])[:, 0]
        outside = (inside < -_TOUCH) | (inside > 1.0 + _TOUCH)
        status = np.where(solved & outside, Status.OUTSIDE_SUPPORT, self.status)
        return NodeSensitivity(
            value=np.where(none, DEGENERATE_VALUE, own.value),
            d_y=np.where(none[:, None], 0.0, own.d_y),
            d_weights=np.where(none[:, None], 0.0, own.d_weights),
            d_noise=np.where(none, 0.0, own.d_noise),
            status=np.where(none, Status.DEGENERATE, status).astype(np.int64),
        )

    def _own(self, outcome: Array) -> NodeSensitivity:
        a, b, width, scale = self.range.a, self.range.b, self.range.width, self.range.scale
        edge = np.clip(outcome, a, b)
        beyond = (outcome - edge) / scale
        t = np.clip((edge - a) / width, 0.0, 1.0)[:, None]
        splined = splines(t[:, 0], self.coefficients.shape[1] - 3)
        g = np.linalg.solve(self.hessian, (splined - self.mean)[:, :, None])[:, :, 0]
        nodes = self.range.inside(self.nodes.y)
        s: Array = self.nodes.noise_sd / width
        value, d_t, d_s = self._of_nodes(np.asarray(g), nodes, s)
        # the weights sum to one, so that a constant is without meaning
        value -= (value @ self.nodes.weights)[:, None]
        # the edge itself keeps its t
        slope = np.where(beyond == 0.0, evaluate(self.coefficients, t, 1)[:, 0], 0.0)
        by_a = (1.0 + s * d_s - slope * (1.0 - t[:, 0]) - ((1.0 - nodes) * d_t).sum(axis=1)) / width
        by_b = (-1.0 - s * d_s - slope * t[:, 0] - (nodes * d_t).sum(axis=1)) / width
        by_a = by_a + np.where(beyond < 0.0, beyond / scale, 0.0)
        by_b = by_b + np.where(beyond > 0.0, beyond / scale, 0.0)
        reach_a, reach_b = ~self.range.lower_moves, ~self.range.upper_moves
        d_y, d_weights, d_noise = self.nodes.chain(
            np.where(reach_a, by_a, 0.0) + np.where(reach_b, by_b, 0.0),
            self.range.reach * (np.where(reach_b, by_b, 0.0) - np.where(reach_a, by_a, 0.0))
            + beyond**2 / scale,
        )
        d_lower, d_upper = np.where(reach_a, 0.0, by_a), np.where(reach_b, 0.0, by_b)
        return NodeSensitivity(
            value=self._log_density(t)[:, 0] - np.log(width) - 0.5 * beyond**2,
            d_y=d_y + d_t / width[:, None],
            d_weights=d_weights + value,
            d_noise=d_noise + d_s / width + self.range.margin * (d_upper - d_lower),
            status=self.status,
        )

    def _of_nodes(self, g: Array, t: Array, s: Array) -> tuple[Array, Array, Array]:
        """G(t_j) and w_j G'(t_j) (N, J), sum_j w_j dG/ds(t_j) (N,)."""
        weights = self.nodes.weights
        rows = max(1, _LARGEST_BATCH // (t.shape[1] * g.shape[1]))
        parts = [
            noisy(g[i : i + rows], NoisyPowers.at(t[i : i + rows], s[i : i + rows], g.shape[1] - 3))
            for i in range(0, t.shape[0], rows)
        ]
        value, by_place, by_noise = (np.concatenate(part) for part in zip(*parts, strict=True))
        return value, weights * by_place, by_noise @ weights

    def _stand_in(self, outcome: Array) -> NodeSensitivity:
        value, d_y, d_weights, d_noise = self.nodes.sensitivity(outcome)
        return NodeSensitivity(value, d_y, d_weights, d_noise, self.status)

    def _or(self, own: Array, normal: Array) -> Array:
        """`own` (N, G) with the rows where the normal density stands in replaced."""
        return np.where(self._solved[:, None], own, normal)

    def _log_density(self, t: Array) -> Array:
        """By t (N, G) in [0, 1]."""
        return evaluate(self.coefficients, t) - self.log_z[:, None]

    def _below(self, t: Array) -> Array:
        """Probability of [0, t] (N, G): whole intervals, and Gauss-Legendre on the broken one."""
        intervals = self.coefficients.shape[1] - 3
        piece = np.clip((t * intervals).astype(np.int64), 0, intervals - 1)
        value = np.take_along_axis(self._whole(), piece, axis=1)
        x, w = np.polynomial.legendre.leggauss(spline_rule(intervals).nodes.size // intervals)
        left = piece / intervals
        part = t - left
        for place, weight in zip(0.5 * (x + 1.0), 0.5 * w, strict=True):
            value = value + weight * part * np.exp(self._log_density(left + place * part))
        return np.clip(value, 0.0, 1.0)

    def _whole(self) -> Array:
        """Probability below each knot (N, K+1)."""
        intervals = self.coefficients.shape[1] - 3
        rule = spline_rule(intervals)
        probability = np.exp(self.coefficients @ rule.basis.T - self.log_z[:, None]) * rule.weights
        below = np.zeros((self.log_z.size, intervals + 1))
        masses = probability.reshape(self.log_z.size, intervals, -1).sum(axis=2)
        np.cumsum(masses, axis=1, out=below[:, 1:])
        return below

    def _inverse(self, p: Array) -> Array:
        """Outcomes (N, P) with probabilities p (N, P) below them."""
        whole = self._whole()
        last = whole.shape[1] - 2
        piece = np.stack(
            [np.searchsorted(*pair, side="right") for pair in zip(whole, p, strict=True)]
        )
        low = np.clip(piece - 1, 0, last) / (last + 1)
        t = invert(
            self._below, lambda t: np.exp(self._log_density(t)), p, low, low + 1.0 / (last + 1)
        )
        t = np.where(p <= 0.0, 0.0, np.where(p >= 1.0, 1.0, t))
        return self.range.a[:, None] + self.range.width[:, None] * t


def _put(own: NodeSensitivity, other: NodeSensitivity, kept: Flags) -> NodeSensitivity:
    """`own` in the rows that are kept, `other` in the rest."""
    column = kept[:, None]
    return NodeSensitivity(
        value=np.where(kept, own.value, other.value),
        d_y=np.where(column, own.d_y, other.d_y),
        d_weights=np.where(column, own.d_weights, other.d_weights),
        d_noise=np.where(kept, own.d_noise, other.d_noise),
        status=own.status,
    )
