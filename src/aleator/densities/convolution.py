"""The density of the outcome itself: the nodes' outcomes, each with what lies around it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from aleator.densities.interface import (
    DEGENERATE_VALUE,
    FARTHEST,
    SMALLEST_SD,
    Codes,
    NodeSensitivity,
    Status,
    by_experiment,
    check_noise,
    check_weights,
    one_per_experiment,
    probabilities,
)
from aleator.densities.linearized import Linearized
from aleator.densities.normal_sum import NormalSum
from aleator.densities.outcomes import Outcomes
from aleator.densities.stand_in import NodeNormal
from aleator.densities.windows import shares, windowed
from aleator.errors import InputsError
from aleator.types import Array, Flags

LARGEST_RIPPLE = 0.02
"""Estimated mean relative error of f from which the nodes are too coarse.

Measured with Gauss rules of one normal parameter, 10 to 200 nodes, on five simulators at noise
from 1 % to 100 % of the scatter: below this estimate the mean distance of log f from that of 40,001
nodes was under 0.07. Nodes of equal weight miss the last tail, hence are too low there; nodes of
two parameters interleave irregularly and the estimate does not see it (mean distance 0.58 with
30 x 30 nodes at a noise of 5 %): nodes on a lattice are smoothed instead.
"""

LARGEST_BEND = 0.3
"""Mean share of curvature in the components' deviation from which a lattice is too coarse.

Measured with 61^2, 41^2, 25^3 and 31^3 nodes on ten simulators at noise from 2 % to 100 % of the
scatter: below it the mean distance of log f from the exact one was under 0.08 (under 0.002 where
it is below 0.1), above it up to 0.14.
"""

_LARGEST_EXPONENT = 600.0
"""The derivative by a weight of zero far from its node is cut here, so that it is finite."""


_LARGEST_OUTCOME = 1e140


@dataclass(frozen=True)
class Convolution:
    """The density of the outcome, with noise or without, and without any moments.

    f(y) = sum_j w_j Normal(y; eta_j, sigma_e^2), with eta_j the outcomes at nodes of weights w_j:
    the marginal likelihood of a nonlinear mixed-effects model by quadrature (Pinheiro and Bates,
    1995). It is exact but for the number of nodes: they must lie closer together, in the outcome,
    than some two standard deviations of the noise, or the density is a row of spikes.

    Nodes on a lattice of variates (`GermGrid`, the default) have no spikes, however small the noise
    and whatever the number of parameters: what lies between the nodes is integrated by local
    linearization (`Linearized`), as far as the noise does not fill it. What is left is a bias of
    fourth order in the step. Mean distance of log f from the exact one at a noise of 2 %, 10 %
    and 30 % of the scatter: for two parameters (61^2 nodes) 0.0005, 0.0004, 0.0001 where the
    outcome is monotonic (without smoothing 0.26, 0.0007, 1e-6), 0.03, 0.01, 0.001 for a
    product of two centered normals; for three (25^3) 0.004 to 0.02 where it is monotonic and
    smooth, up to 0.14 where it is not, most of which is TOO_COARSE.

    Of other nodes `points` is the number to ask for, all parameters together. Of one normal
    parameter 400 nodes of a Gauss rule resolve a noise above 8 % (linear simulator) to 19 %
    (saturating) of the scatter, 400 nodes of equal probability above 3 % (linear) and 1 %
    (saturating). Halving the noise takes twice the nodes of equal probability, four times those
    of a Gauss rule.

    Nodes too coarse (`ripple` above 0.02, or on a lattice `Linearized.bend` above 0.3) have status
    TOO_COARSE, and the normal density of the same mean and variance stands in.

    Without noise only a lattice has a density; other nodes have status DEGENERATE. It is the law's
    own, pushed forward: the error of log f is below 6e-4 from 1e-4 to 1 - 1e-4 of probability for
    lognormal outcomes of one parameter (401 nodes) up to a logarithmic sd of 1.5, and at the edges
    of a uniform or truncated law; a singularity, where the outcome turns, is cut at some 0.001 of
    its scale. Beyond the nodes it is zero, and a search sees a normal tail e^-40 below.

    Raises InputsError for points under 2, for a negative weight (a sparse grid has them; a sum with
    them is no density), or a noise that is negative or not finite. Cost O(N J) for a value with all
    its derivatives, O(N J n^2) on a lattice.

    >>> nodes = Outcomes(np.array([[0.0, 1.0]]), np.array([0.5, 0.5]))
    >>> fitted = Convolution().fit_nodes(nodes, 1.0, -np.inf, np.inf)
    >>> float(fitted.pdf([0.5])[0])  # exp(-1/8)/sqrt(2 pi)
    0.352065
    """

    points: int = 400

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.points < 2:
            raise InputsError(
                f"convolution with {self.points} points: too few", "take 400, the usual choice"
            )

    @property
    def name(self) -> str:
        """Name for reports."""
        return "convolution"

    def fit_nodes(
        self,
        outcomes: Outcomes,
        noise_sd: float,
        lower: ArrayLike,  # noqa: ARG002  one interface for all densities
        upper: ArrayLike,  # noqa: ARG002
    ) -> FittedConvolution:
        """Place the noise around the outcomes (N, J); lower and upper are not used."""
        check_weights(outcomes.weights, self.name)
        check_noise(noise_sd)
        usable = np.asarray(np.isfinite(outcomes.y).all(axis=1))
        if outcomes.lattice is None:
            usable &= noise_sd > SMALLEST_SD
            y = np.where(usable[:, None], outcomes.y, 0.0)
            sd = max(noise_sd, SMALLEST_SD)
            coarse = ripple(y, outcomes.weights, sd) > LARGEST_RIPPLE
            return FittedConvolution(y, outcomes.weights, sd, coarse, ~usable)
        # the squares of their differences have to be finite
        low, high = outcomes.y.min(axis=1), outcomes.y.max(axis=1)
        usable &= (low > -_LARGEST_OUTCOME) & (high < _LARGEST_OUTCOME)
        y = outcomes.y if usable.all() else np.where(usable[:, None], outcomes.y, 0.0)
        sd = noise_sd if noise_sd > SMALLEST_SD else 0.0
        around = Linearized(y, outcomes.weights, outcomes.lattice, sd)
        usable &= ~around.points.all(axis=1)
        return FittedConvolution(
            y, outcomes.weights, sd, around.bend > LARGEST_BEND, ~usable, around
        )


def ripple(y: Array, weights: Array, noise_sd: float | Array) -> Array:
    """Estimate (N,) of the mean relative error of f that the distance of the nodes makes.

    Equal nodes at distance h make f oscillate by 2 exp(-2 pi^2 sigma_e^2/h^2) (Poisson's sum). Each
    gap between neighbors counts with the weights within one sigma_e of its ends, so that a
    cluster counts as what it is to the noise: one node. `noise_sd` is one number or (N,). Between
    0 and 2; cost O(N J log J).

    >>> ripple(np.array([[0.0, 1.0, 2.0, 3.0]]), np.full(4, 0.25), 0.5).round(3).tolist()
    [0.011]
    """
    order = np.argsort(y, axis=1)
    gap = np.diff(np.take_along_axis(y, order, axis=1), axis=1)
    gap = gap / np.reshape(noise_sd, (-1, 1))
    if not (gap > 1.0).any():
        return np.zeros(y.shape[0])
    # a gap beyond 10 says no more than one of 10
    place = np.zeros(y.shape)
    np.cumsum(np.minimum(gap, 10.0), axis=1, out=place[:, 1:])
    below = np.zeros((y.shape[0], y.shape[1] + 1))
    np.cumsum(weights[order], axis=1, out=below[:, 1:])
    left = below[:, 1:-1] - np.take_along_axis(below, _rank(place, place[:, :-1] - 1.0), axis=1)
    right = np.take_along_axis(below, _rank(place, place[:, 1:] + 1.0), axis=1) - below[:, 1:-1]
    with np.errstate(divide="ignore", over="ignore"):
        wave = 2.0 * np.exp(-2.0 * np.pi**2 / gap**2)
    return np.asarray((0.5 * (left + right) * wave).sum(axis=1))


def _rank(sorted_rows: Array, query: Array) -> Codes:
    """How many entries of each row (N, J) lie under each query (N, G)."""
    span = float(np.ptp(sorted_rows)) + 4.0
    shift = span * np.arange(sorted_rows.shape[0])[:, None]
    found = np.searchsorted((sorted_rows + shift).ravel(), (query + shift).ravel())
    first = sorted_rows.shape[1] * np.arange(query.shape[0])[:, None]
    rank: Codes = found.reshape(query.shape) - first
    return rank


@dataclass(frozen=True)
class FittedConvolution:
    """Convolutions of N experiments; methods as in `FittedDensity`.

    `y` (N, J), `weights` (J,), `noise_sd`; `around` tells what lies around the nodes of a lattice.
    `too_coarse` (N,) tells where nodes are too far apart: the normal density of the same mean and
    variance stands in. `none` (N,) tells where there is no density.
    """

    y: Array
    weights: Array
    noise_sd: float
    too_coarse: Flags
    none: Flags
    around: Linearized | None = None

    @property
    def status(self) -> Codes:
        """(N,) SOLVED, TOO_COARSE or DEGENERATE."""
        coarse = np.where(self.too_coarse, Status.TOO_COARSE, Status.SOLVED)
        return np.where(self.none, Status.DEGENERATE, coarse).astype(np.int64)

    @property
    def _coarse(self) -> Flags:
        coarse: Flags = self.too_coarse & ~self.none
        return coarse

    @cached_property
    def _normal(self) -> NodeNormal:
        return NodeNormal(self.y, self.weights, self.noise_sd)

    @cached_property
    def _parts(self) -> NormalSum:
        """Around every node its outcome's own spread, where that is known, and the noise."""
        if self.around is None:
            sds = np.full(self.y.shape, self.noise_sd)
            return NormalSum(np.broadcast_to(self.weights, self.y.shape), self.y, sds)
        around = self.around
        return NormalSum(np.exp(around.log_core), around.mean, np.sqrt(around.variance))

    @property
    def _sum(self) -> NormalSum:
        """Where the nodes are too coarse, every node is the normal density that stands in."""
        parts, coarse = self._parts, self._coarse[:, None]
        if not coarse.any():
            return parts
        return NormalSum(
            parts.weights,
            np.where(coarse, self._normal.mean[:, None], parts.centers),
            np.where(coarse, self._normal.sd[:, None], parts.sds),
        )

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y (N,) or (N, G); -inf where there is none."""
        at = by_experiment(y, self.none.size, "the outcome")
        value = self._sum.log_pdf(at)
        if self.noise_sd == 0.0:
            value = np.where(value < self._normal.beyond(at)[0], -np.inf, value)
        return np.where(self.none[:, None], -np.inf, value).reshape(np.shape(y))

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N,) or (N, G)."""
        return np.exp(self.log_pdf(y))

    def cdf(self, y: ArrayLike) -> Array:
        """Probability of an outcome not above y (N,) or (N, G)."""
        return self._sum.cdf(by_experiment(y, self.none.size, "the outcome")).reshape(np.shape(y))

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,)."""
        return self._sum.quantile(probabilities(p))

    def node_sensitivity(self, y: ArrayLike) -> NodeSensitivity:
        """Value for the search at y (N,) with its partial derivatives, cost O(N J).

        With s the noise's sd, z_j = (y - eta_j)/s and r_j = w_j Normal(y; eta_j, s^2)/f the share
        of node j: d log f = sum_j r_j (z_j/s d eta_j + dw_j/w_j + (z_j^2 - 1)/s ds). On a lattice
        the chain goes on to the components; its weights are fixed, so that d_weights is zero.
        Too coarse nodes have the value of the normal density less FAILED_SOLVE_PENALTY; without a
        density, or for an outcome that is not finite, it is DEGENERATE_VALUE.
        """
        outcome = one_per_experiment(y, self.none.size, "the outcome")
        none, coarse = self.none | ~np.isfinite(outcome), self._coarse
        outcome = np.where(none, 0.0, outcome)
        value, d_y, d_weights, d_noise = self._own(outcome)
        if self.noise_sd == 0.0:
            value, d_y = self._normal.lifted(outcome, value, d_y)
        if coarse.any():
            normal = self._normal.sensitivity(outcome)
            value, d_noise = np.where(coarse, (normal[0], normal[3]), (value, d_noise))
            d_y, d_weights = np.where(coarse[:, None], normal[1:3], (d_y, d_weights))
        return NodeSensitivity(
            value=np.where(none, DEGENERATE_VALUE, value),
            d_y=np.where(none[:, None], 0.0, d_y),
            d_weights=np.where(none[:, None], 0.0, d_weights),
            d_noise=np.where(none, 0.0, d_noise),
            status=np.where(none, Status.DEGENERATE, self.status).astype(np.int64),
        )

    def _own(self, outcome: Array) -> tuple[Array, Array, Array, Array]:
        if self.around is None:
            return self._of_nodes(outcome)
        around = self.around
        if not around.line or self.noise_sd > 0.0:
            value, d_y, d_noise = _of_lattice(outcome, around)
            return value, d_y, np.zeros_like(d_y), d_noise
        inside, value, d_y = windowed(outcome, around)
        rest = ~inside
        if rest.any():
            value[rest], d_y[rest] = _of_lattice(outcome[rest], around.take(rest))[:2]
        return value, d_y, np.broadcast_to(0.0, d_y.shape), np.zeros(outcome.size)

    def _of_nodes(self, outcome: Array) -> tuple[Array, Array, Array, Array]:
        sd = self.noise_sd
        each, z = _log_normal(outcome, self.y, sd)
        with np.errstate(divide="ignore"):
            value, share = shares(each + np.log(self.weights))
        by_weight = np.exp(np.minimum(each - value[:, None], _LARGEST_EXPONENT))
        d_noise = (share * (z**2 - 1.0)).sum(axis=1) / sd
        return value, share * z / sd, by_weight, d_noise


def _of_lattice(outcome: Array, around: Linearized) -> tuple[Array, Array, Array]:
    """Value (N,), and partials by y (N, J) and noise_sd (N,), of a sum over all nodes."""
    sd = np.sqrt(around.variance)
    each, z = _log_normal(outcome, around.mean, sd)
    value, share = shares(each + around.log_core)
    by_mean = share * z / sd
    by_variance = 0.5 * share * (z**2 - 1.0) / around.variance
    return value, *around.chain(share, by_mean, by_variance)


def _log_normal(y: Array, centers: Array, sds: Array | float) -> tuple[Array, Array]:
    """Logarithms (N, J) of Normal(y; centers, sds^2) at y (N,), and (y - centers)/sds."""
    with np.errstate(over="ignore"):
        z = np.clip((y[:, None] - centers) / sds, -FARTHEST, FARTHEST)
    return -0.5 * z**2 - np.log(sds) - 0.5 * np.log(2.0 * np.pi), z
