"""Moments and outcomes at the nodes of the law."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.laws import Inputs
from aleator.moments.densities.moments import Moments
from aleator.moments.densities.outcomes import Outcomes
from aleator.moments.quadrature import Cubature
from aleator.moments.quadrature.nodes import Nodes
from aleator.surrogates.responses import Divisible, Response
from aleator.types import Array, Indices


@dataclass(frozen=True)
class QuadraturePropagation:
    """Outcomes of a response at the nodes of the law, and their moments.

    The moments are the weighted sums at the nodes. Cost: one evaluation of the response at J points
    and O(N J K M).
    """

    inputs: Inputs
    response: Response
    cubature: Cubature

    @property
    def divisible(self) -> bool:
        """Whether some of the conditions can be asked for alone."""
        return isinstance(self.response, Divisible)

    def take(self, conditions: Indices) -> QuadraturePropagation:
        """Of some of the conditions, each at most once."""
        assert isinstance(self.response, Divisible)
        return replace(self, response=self.response.take(conditions))

    def at(self, alpha: Array) -> Array:
        """The nodes of the law (J, n)."""
        return self.nodes(alpha).x

    def nodes(self, alpha: Array) -> Nodes:
        """The nodes of the law with their weights."""
        return self.cubature.nodes(self.inputs, alpha)

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the N outcomes, with the derivatives of just what is computed."""
        return self.outcomes(alpha, gradient=gradient).moments(order)

    def outcomes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        """The outcomes of the response at the nodes."""
        return self.outcomes_at(self.nodes(alpha), gradient=gradient)

    def outcomes_at(self, nodes: Nodes, *, gradient: bool) -> Outcomes:
        """The same at nodes that are known."""
        if not gradient:
            outcome = self.response.evaluate(nodes.x)
            return Outcomes(outcome, nodes.weights)
        outcome, slope = self.response.evaluate_with_gradient(nodes.x)
        dy = along_alpha(slope, nodes.dx)
        return Outcomes(outcome, nodes.weights, dy, nodes.dweights)


def along_alpha(slope: Array, dx: Array) -> Array:
    """dY/dalpha (N, J, K) = sum_i (d eta/d x_i)(d x_i/d alpha)."""
    dy = np.zeros((slope.shape[0], slope.shape[1], dx.shape[2]))
    for i in range(slope.shape[2]):
        for k in np.flatnonzero(np.any(dx[:, i], axis=0)):
            dy[:, :, k] += slope[:, :, i] * dx[:, i, k]
    return dy
