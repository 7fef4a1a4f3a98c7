"""Moments of the outcome, about the mean and scaled, with their derivatives.

Powers are taken of z = (y - mean)/sd, never of y: raw moments of an outcome of 0.8 s with a
scatter of 0.02 s lose all digits at order 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aleator.core.blocks import blocks
from aleator.core.threads import single_threaded
from aleator.core.types import Array


@dataclass(frozen=True)
class Moments:
    """Moments of the outcomes of N experiments, and their derivatives by K hyperparameters.

    `mean` (N,) and `sd` (N,) carry the unit of the outcome; `standardized` (N, M+1) holds
    E[((Y - mean)/sd)^m] for m = 0..M, so that columns 0, 1, 2 are 1, 0, 1. The jacobians have a
    last axis K, or are None where no derivative was computed.
    """

    mean: Array
    sd: Array
    standardized: Array
    mean_jac: Array | None = None
    sd_jac: Array | None = None
    standardized_jac: Array | None = None

    @property
    def order(self) -> int:
        """The highest order M of the standardized moments."""
        return int(self.standardized.shape[1]) - 1

    def take(self, index: NDArray[np.intp]) -> Moments:
        """The moments of the outcomes at `index` (any number of times each), in that order."""
        return Moments(
            self.mean[index],
            self.sd[index],
            self.standardized[index],
            None if self.mean_jac is None else self.mean_jac[index],
            None if self.sd_jac is None else self.sd_jac[index],
            None if self.standardized_jac is None else self.standardized_jac[index],
        )

    def lowered(self, order: int) -> Moments:
        """These moments, restricted to the orders up to `order`."""
        jac = self.standardized_jac
        return replace(
            self,
            standardized=self.standardized[:, : order + 1],
            standardized_jac=None if jac is None else jac[:, : order + 1],
        )


def joined(parts: Sequence[Moments]) -> Moments:
    """The moments of several sets of experiments, concatenated into one set without jacobians.

    >>> m = weighted_moments(np.array([[1.0, 3.0]]), np.array([0.5, 0.5]), 2)
    >>> joined([m, m]).mean.tolist()
    [2.0, 2.0]
    """
    return Moments(
        np.concatenate([part.mean for part in parts]),
        np.concatenate([part.sd for part in parts]),
        np.concatenate([part.standardized for part in parts]),
    )


@single_threaded
def weighted_moments(y: Array, weights: Array, order: int) -> Moments:
    """Moments of outcomes y (N, J) under weights (J,) that sum to one.

    mean = sum_j w_j y_j and E[z^m] = sum_j w_j z_j^m (paper, eq. (momentdef), by quadrature).
    Cost O(N J M). An outcome without scatter gets sd 0 and standardized moments of zero from order
    3 on.

    >>> m = weighted_moments(np.array([[1.0, 3.0]]), np.array([0.5, 0.5]), 4)
    >>> m.mean.tolist(), m.sd.tolist(), m.standardized.tolist()
    ([2.0], [1.0], [[1.0, 0.0, 1.0, 0.0, 1.0]])
    """
    # Experiments are taken in blocks whose powers fit the cache of a core.
    every = blocks(max(len(y), 1), y.shape[1], 64_000)
    parts = []
    for rows in every:
        mean, sd, z = _standardize(y[rows], weights)
        parts.append(Moments(mean, sd, _powers(z, weights, order)))
    return parts[0] if len(parts) == 1 else joined(parts)


@single_threaded
def weighted_moments_with_gradient(
    y: Array, weights: Array, order: int, dy: Array, dweights: Array
) -> Moments:
    """The moments of `weighted_moments` and their derivatives by K hyperparameters.

    `dy` (N, J, K) are the derivatives of the outcomes, `dweights` (J, K) those of the weights.

    d E[z^m] = sum_j dw_j z_j^m + m sum_j w_j z_j^(m-1) (dy_j - dmean)/sd - m E[z^m] dsd/sd,
    with z_j = (y_j - mean)/sd. This differentiates the weighted sum itself, so that the derivative
    is exact for any number of nodes.
    Cost O(N J K M).
    """
    mean, sd, z = _standardize(y, weights)
    standardized = _powers(z, weights, order)
    scale = np.where(sd > 0.0, sd, 1.0)[:, None]
    mean_jac = y @ dweights + np.einsum("j,njk->nk", weights, dy)
    dmean = mean_jac / scale
    log_sd_jac = np.zeros_like(mean_jac)
    standardized_jac = np.zeros((*standardized.shape, dy.shape[2]))
    weighted_power = np.broadcast_to(weights, z.shape)
    power = np.ones_like(z)
    for m in range(1, order + 1):
        # At this point power is z^(m-1) and weighted_power is w z^(m-1).
        moving = (weighted_power[:, None, :] @ dy)[:, 0, :] / scale
        weighted_power = weighted_power * z
        power = power * z
        if m == 1:
            continue
        change = power @ dweights + m * moving
        if m == 2:
            log_sd_jac = 0.5 * change
            continue
        standardized_jac[:, m] = (
            change
            - m * standardized[:, m - 1, None] * dmean
            - m * standardized[:, m, None] * log_sd_jac
        )
    return Moments(mean, sd, standardized, mean_jac, sd[:, None] * log_sd_jac, standardized_jac)


def _standardize(y: Array, weights: Array) -> tuple[Array, Array, Array]:
    mean = y @ weights
    centered = y - mean[:, None]
    sd = np.sqrt(np.maximum(centered**2 @ weights, 0.0))
    # Scatter as small as the rounding error counts as no scatter.
    sd = np.where(sd > 1e-14 * np.max(np.abs(y), axis=1), sd, 0.0)
    z = centered / np.where(sd > 0.0, sd, np.inf)[:, None]
    return mean, sd, z


def _powers(z: Array, weights: Array, order: int) -> Array:
    standardized = np.zeros((z.shape[0], order + 1))
    power = np.ones_like(z)
    for m in range(order + 1):
        standardized[:, m] = power @ weights
        power = power * z
    # Moments 0, 1, 2 are 1, 0, 1 by definition; set so, they are free of rounding errors.
    standardized[:, 0], standardized[:, 1], standardized[:, 2] = 1.0, 0.0, 1.0
    return standardized


@dataclass(frozen=True)
class NodeOutcomes:
    """Outcomes y (N, J) of N experiments at J nodes with weights (J,) that sum to one.

    `dy` (N, J, K) and `dweights` (J, K) are their derivatives by the K hyperparameters, or None
    where no derivative was computed. For any function g, sum_j w_j g(y_lj) approximates the
    expectation E[g(Y_l)] of experiment l.

    >>> o = NodeOutcomes(np.array([[1.0, 3.0]]), np.array([0.5, 0.5]))
    >>> o.moments(2).mean.tolist()
    [2.0]
    """

    y: Array
    weights: Array
    dy: Array | None = None
    dweights: Array | None = None

    def moments(self, order: int) -> Moments:
        """The moments up to `order`, with jacobians if `dy` and `dweights` are given."""
        if self.dy is None or self.dweights is None:
            return weighted_moments(self.y, self.weights, order)
        return weighted_moments_with_gradient(self.y, self.weights, order, self.dy, self.dweights)
