"""Outcomes at the nodes of a law: what every statistic of the outcome is computed from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.moments.densities.moments import (
    Moments,
    weighted_moments,
    weighted_moments_with_gradient,
)
from aleator.types import Array


@dataclass(frozen=True)
class Outcomes:
    """Outcomes y (N, J) of N experiments at J nodes with weights (J,) that sum to one.

    `dy` (N, J, K) and `dweights` (J, K) are their derivatives by the K hyperparameters, or None
    where no derivative was asked for. E[g(Y_l)] is sum_j w_j g(y_lj) for any function g.

    >>> o = Outcomes(np.array([[1.0, 3.0]]), np.array([0.5, 0.5]))
    >>> o.moments(2).mean.tolist()
    [2.0]
    """

    y: Array
    weights: Array
    dy: Array | None = None
    dweights: Array | None = None

    def moments(self, order: int) -> Moments:
        """Moments up to `order`, with jacobians where the derivatives are there."""
        if self.dy is None or self.dweights is None:
            return weighted_moments(self.y, self.weights, order)
        return weighted_moments_with_gradient(self.y, self.weights, order, self.dy, self.dweights)

    def take(self, index: NDArray[np.intp]) -> Outcomes:
        """The outcomes of the experiments at `index` (any number of times each), in that order."""
        if np.array_equal(index, np.arange(self.y.shape[0])):
            return self
        dy = None if self.dy is None else self.dy[index]
        return Outcomes(self.y[index], self.weights, dy, self.dweights)
