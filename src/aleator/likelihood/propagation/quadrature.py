"""Moments and outcomes at the nodes of the law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.densities.moments import Moments
from aleator.densities.outcomes import Outcomes
from aleator.expansion.projection import expansion_map
from aleator.laws import Inputs
from aleator.quadrature import Cubature, TensorGauss
from aleator.surrogates.responses import Response
from aleator.types import Array


@dataclass(frozen=True)
class QuadraturePropagation:
    """Outcomes of a response at the nodes of the law, and their moments.

    With `degree` None the moments are the plain weighted sums at the nodes; else those of the
    expansion of that degree, integrated exactly (paper, eqs. (quadrature) and (moments)): this
    takes a tensor rule. Cost: one evaluation of the response at J points and O(N J K M).
    """

    inputs: Inputs
    response: Response
    cubature: Cubature
    degree: int | None = None

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the N outcomes, with the derivatives of just what is computed."""
        outcomes = self.outcomes(alpha, gradient=gradient)
        if self.degree is not None:
            outcomes = self._expanded(alpha, order, self.degree, outcomes)
        return outcomes.moments(order)

    def outcomes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        """The outcomes of the response at the nodes, whether expanded for the moments or not."""
        nodes = self.cubature.nodes(self.inputs, alpha)
        if not gradient:
            outcome = self.response.evaluate(nodes.x)
            return Outcomes(outcome, nodes.weights, lattice=nodes.lattice)
        outcome, slope = self.response.evaluate_with_gradient(nodes.x)
        dy = along_alpha(slope, nodes.dx)
        return Outcomes(outcome, nodes.weights, dy, nodes.dweights, nodes.lattice)

    def _expanded(self, alpha: Array, order: int, degree: int, outcomes: Outcomes) -> Outcomes:
        """The expansion through the outcomes, at finer nodes that integrate its powers exactly."""
        assert isinstance(self.cubature, TensorGauss)
        per_dimension = self.cubature.per_dimension

        def expansion(at: Array) -> tuple[Array, Array]:
            return expansion_map(self.inputs, at, per_dimension, degree, order)

        matrix, weights = expansion(alpha)
        fine = outcomes.y @ matrix.T
        if outcomes.dy is None:
            return Outcomes(fine, weights)
        dfine = np.einsum("fj,njk->nfk", matrix, outcomes.dy, optimize=True)
        dweights = np.zeros((weights.size, alpha.size))
        for k, h in enumerate(self.inputs.hyperparameters):
            # a basis that depends on alpha moves too; its map costs no run, so differences serve
            if not h.free:
                continue
            step = np.zeros_like(alpha)
            step[k] = 1e-5 * (alpha[k] if h.log else h.upper - h.lower)
            (up, weights_up), (down, weights_down) = (
                expansion(alpha + step),
                expansion(alpha - step),
            )
            dfine[:, :, k] += outcomes.y @ ((up - down) / (2.0 * step[k])).T
            dweights[:, k] = (weights_up - weights_down) / (2.0 * step[k])
        return Outcomes(fine, weights, dfine, dweights)


def along_alpha(slope: Array, dx: Array) -> Array:
    """dY/dalpha (N, J, K) = sum_i (d eta/d x_i)(d x_i/d alpha)."""
    dy = np.zeros((slope.shape[0], slope.shape[1], dx.shape[2]))
    for i in range(slope.shape[2]):
        for k in np.flatnonzero(np.any(dx[:, i], axis=0)):
            dy[:, :, k] += slope[:, :, i] * dx[:, i, k]
    return dy
