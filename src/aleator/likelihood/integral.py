"""The density of a measured value as an integral over the parameters, for any observation model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.densities import DEGENERATE_VALUE, NodeSensitivity, Status
from aleator.densities.interface import by_experiment, one_per_experiment, probabilities
from aleator.densities.inversion import invert
from aleator.densities.outcomes import Outcomes
from aleator.observations.model import ObservationModel, Observed
from aleator.types import Array

SMALLEST = 1e-300
"""A weight or a density below this is none."""
TAIL = 1e-12
"""Probability of the observation model beyond which no quantile is looked for."""


@dataclass(frozen=True)
class NodeIntegral:
    """f(y) = sum_j w_j p(y | eta_j, sd): the integral over the law's nodes.

    p is the observation model, eta_j the outcomes at nodes of weights w_j >= 0. It is exact but for
    the number of nodes: their outcomes must lie closer together than the observation model is
    wide. More nodes are tried at the answer, and a difference is told. A cusp in p, as that of
    Laplace's error, leaves jumps in the score. Cost O(N J).
    """

    observation: ObservationModel
    points: int = 400

    @property
    def name(self) -> str:
        """Name for reports."""
        return f"integral({self.observation.name})"

    def fit_nodes(
        self,
        outcomes: Outcomes,
        noise_sd: float,
        lower: ArrayLike,  # noqa: ARG002  one interface for all densities
        upper: ArrayLike,  # noqa: ARG002
    ) -> FittedNodeIntegral:
        """Place the observation model at the outcomes (N, J)."""
        return FittedNodeIntegral(self.observation, outcomes.y, outcomes.weights, noise_sd)


@dataclass(frozen=True)
class FittedNodeIntegral:
    """The densities of N experiments; methods as in `FittedDensity`."""

    observation: ObservationModel
    y: Array
    weights: Array
    noise_sd: float

    @cached_property
    def status(self) -> NDArray[np.int64]:
        """(N,) SOLVED, or DEGENERATE where an outcome at a node is not finite."""
        finite = np.isfinite(self.y).all(axis=1)
        return np.where(finite, Status.SOLVED, Status.DEGENERATE).astype(np.int64)

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y (N,) or (N, G)."""
        at = by_experiment(y, self.y.shape[0], "the outcome")
        columns = [self._shares(column)[0] for column in at.T]
        value = np.stack(columns, axis=1)
        none = (self.status != Status.SOLVED)[:, None]
        return np.where(none, -np.inf, value).reshape(np.shape(y))

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N,) or (N, G)."""
        return np.exp(self.log_pdf(y))

    def cdf(self, y: ArrayLike) -> Array:
        """Probability of a measured value not above y (N,) or (N, G)."""
        at = by_experiment(y, self.y.shape[0], "the outcome")
        columns = [
            self.observation.cdf(column[:, None], self.y, self._scale) @ self.weights
            for column in at.T
        ]
        return np.stack(columns, axis=1).reshape(np.shape(y))

    def quantile(self, p: ArrayLike) -> Array:
        """Measured values (N, P) that are not exceeded with probabilities p (P,)."""
        wanted = probabilities(p)
        ends = [
            self.observation.quantile(np.array(tail), end(self.y, axis=1), self._scale)
            for tail, end in ((TAIL, np.min), (1.0 - TAIL, np.max))
        ]
        shape = (self.y.shape[0], wanted.size)
        low, high = (np.broadcast_to(end[:, None], shape) for end in ends)
        return invert(self.cdf, self.pdf, np.broadcast_to(wanted, shape), low, high)

    def node_sensitivity(self, y: ArrayLike) -> NodeSensitivity:
        """log f with its partials: d log f = sum_j r_j (d log p_j + dw_j/w_j), r_j = w_j p_j/f."""
        outcome = one_per_experiment(y, self.y.shape[0], "the outcome")
        none = (self.status != Status.SOLVED) | ~np.isfinite(outcome)
        value, share, observed = self._shares(np.where(none, 0.0, outcome))
        none = none | ~np.isfinite(value)
        share = np.where(none[:, None], 0.0, share)
        return NodeSensitivity(
            value=np.where(none, DEGENERATE_VALUE, value),
            d_y=share * observed.d_eta,
            d_weights=share / np.maximum(self.weights, SMALLEST),
            d_noise=(share * observed.d_scale).sum(axis=1),
            status=np.where(none, Status.DEGENERATE, self.status).astype(np.int64),
        )

    @property
    def _scale(self) -> Array:
        return np.array(self.noise_sd)

    def _shares(self, y: Array) -> tuple[Array, Array, Observed]:
        """log f (N,) at y (N,), the share (N, J) of each node in f, and the observation model."""
        observed = self.observation.log_density(y[:, None], self.y, self._scale)
        with np.errstate(divide="ignore", invalid="ignore"):
            each = observed.value + np.log(self.weights)
            top = np.maximum(each.max(axis=1, keepdims=True), -1e300)
            share = np.exp(each - top)
            total = share.sum(axis=1, keepdims=True)
            return (top + np.log(total))[:, 0], share / total, observed
