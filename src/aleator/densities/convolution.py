"""The density of the outcome itself: the nodes' outcomes, each with what lies around it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from aleator.densities.interface import (
    DEGENERATE_VALUE,
    FARTHEST,
    Codes,
    NodeSensitivity,
    Status,
    by_experiment,
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

LARGEST_BEND = 0.3
"""Mean share of curvature in the components' deviation from which a lattice is too coarse.

Measured with 61^2, 41^2, 25^3 and 31^3 nodes on ten simulators at noise from 2 % to 100 % of the
scatter: below it the mean distance of log f from the exact one was under 0.08 (under 0.002 where
it is below 0.1), above it up to 0.14.
"""

_LARGEST_OUTCOME = 1e140


@dataclass(frozen=True)
class Convolution:
    """The density of the outcome without any moments: the law's own, pushed forward.

    f(y) = sum_j w_j Normal(y; m_j, v_j) over nodes on a lattice of variates (`GermGrid`), each with
    the mean and variance that a local expansion of the outcome about it has (`Linearized`). The
    bias is of fourth order in the step: the error of log f is below 6e-4 from 1e-4 to 1 - 1e-4 of
    probability for lognormal outcomes of one parameter (401 nodes) up to a logarithmic sd of 1.5,
    and at the edges of a uniform or truncated law; a singularity, where the outcome turns, is cut
    at some 0.001 of its scale. Beyond the nodes it is zero, and a search sees a normal tail e^-40
    below. `points` is the number of nodes of one parameter.

    A lattice too coarse (`Linearized.bend` above 0.3) has status TOO_COARSE, and the normal density
    of the same mean and variance stands in. Outcomes that do not scatter have none: DEGENERATE.

    Raises InputsError for points under 2, for nodes that are no lattice, and for a negative weight
    (a sparse grid has them; a sum with them is no density). Cost O(N J n^2) for a value
    with all its derivatives.

    >>> from aleator.laws import Normal
    >>> from aleator.laws.inputs import Inputs
    >>> from aleator.quadrature import GermGrid
    >>> grid = GermGrid(161).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([0.0, 1.0]))
    >>> nodes = Outcomes(2.0 * grid.x.T, grid.weights, lattice=grid.lattice)
    >>> round(float(Convolution().fit_nodes(nodes, -np.inf, np.inf).pdf([1.0])[0]), 4)
    0.176
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
        lower: ArrayLike,  # noqa: ARG002  one interface for all densities
        upper: ArrayLike,  # noqa: ARG002
    ) -> FittedConvolution:
        """Spread the outcomes (N, J) at the nodes; lower and upper are not used."""
        check_weights(outcomes.weights, self.name)
        if outcomes.lattice is None:
            raise InputsError(
                f"density {self.name} needs nodes on a lattice of variates", "take GermGrid nodes"
            )
        usable = np.asarray(np.isfinite(outcomes.y).all(axis=1))
        # the squares of their differences have to be finite
        low, high = outcomes.y.min(axis=1), outcomes.y.max(axis=1)
        usable &= (low > -_LARGEST_OUTCOME) & (high < _LARGEST_OUTCOME)
        y = outcomes.y if usable.all() else np.where(usable[:, None], outcomes.y, 0.0)
        around = Linearized(y, outcomes.weights, outcomes.lattice)
        usable &= ~around.points.all(axis=1)
        return FittedConvolution(y, outcomes.weights, around.bend > LARGEST_BEND, ~usable, around)


@dataclass(frozen=True)
class FittedConvolution:
    """Convolutions of N experiments; methods as in `FittedDensity`.

    `y` (N, J), `weights` (J,); `around` tells what lies around the nodes of the lattice.
    `too_coarse` (N,) tells where nodes are too far apart: the normal density of the same mean and
    variance stands in. `none` (N,) tells where there is no density.
    """

    y: Array
    weights: Array
    too_coarse: Flags
    none: Flags
    around: Linearized

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
        return NodeNormal(self.y, self.weights)

    @cached_property
    def _parts(self) -> NormalSum:
        """Around every node its outcome's own spread."""
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

        With s_j^2 = v_j, z_j = (y - m_j)/s_j and r_j = w_j Normal(y; m_j, v_j)/f the share of node
        j: d log f = sum_j r_j (z_j/s_j dm_j + (z_j^2 - 1)/s_j ds_j), by the chain of `Linearized`.
        The weights of a lattice are fixed, so that d_weights is zero. Too
        coarse nodes have the value of the normal density less FAILED_SOLVE_PENALTY; without a
        density, or for an outcome that is not finite, it is DEGENERATE_VALUE.
        """
        outcome = one_per_experiment(y, self.none.size, "the outcome")
        none, coarse = self.none | ~np.isfinite(outcome), self._coarse
        outcome = np.where(none, 0.0, outcome)
        value, d_y = self._normal.lifted(outcome, *self._own(outcome))
        d_weights = np.zeros(d_y.shape)
        if coarse.any():
            normal = self._normal.sensitivity(outcome)
            value = np.where(coarse, normal[0], value)
            d_y, d_weights = np.where(coarse[:, None], normal[1:], (d_y, d_weights))
        return NodeSensitivity(
            value=np.where(none, DEGENERATE_VALUE, value),
            d_y=np.where(none[:, None], 0.0, d_y),
            d_weights=np.where(none[:, None], 0.0, d_weights),
            status=np.where(none, Status.DEGENERATE, self.status).astype(np.int64),
        )

    def _own(self, outcome: Array) -> tuple[Array, Array]:
        around = self.around
        if not around.line:
            return _of_lattice(outcome, around)
        inside, value, d_y = windowed(outcome, around)
        rest = ~inside
        if rest.any():
            value[rest], d_y[rest] = _of_lattice(outcome[rest], around.take(rest))
        return value, d_y


def _of_lattice(outcome: Array, around: Linearized) -> tuple[Array, Array]:
    """Value (N,), and partials by y (N, J), of a sum over all nodes."""
    sd = np.sqrt(around.variance)
    each, z = _log_normal(outcome, around.mean, sd)
    value, share = shares(each + around.log_core)
    by_mean = share * z / sd
    by_variance = 0.5 * share * (z**2 - 1.0) / around.variance
    return value, around.chain(by_mean, by_variance)


def _log_normal(y: Array, centers: Array, sds: Array) -> tuple[Array, Array]:
    """Logarithms (N, J) of Normal(y; centers, sds^2) at y (N,), and (y - centers)/sds."""
    with np.errstate(over="ignore"):
        z = np.clip((y[:, None] - centers) / sds, -FARTHEST, FARTHEST)
    return -0.5 * z**2 - np.log(sds) - 0.5 * np.log(2.0 * np.pi), z
