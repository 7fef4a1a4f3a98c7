"""Moments of a polynomial chaos expansion in the laws' own polynomials: the paper's way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.laws import Inputs
from aleator.moments.densities.moments import Moments
from aleator.moments.densities.outcomes import Outcomes
from aleator.moments.expansion.projection import expansion_map
from aleator.moments.propagation.quadrature import QuadraturePropagation
from aleator.moments.quadrature import TensorGauss
from aleator.surrogates.responses import Response
from aleator.types import Array

STEP = 1e-5
"""Step of differences of the basis by alpha, in widths of the limits or in parts of an sd."""


@dataclass(frozen=True)
class ProjectedPropagation:
    """Moments of the expansion that is projected on a tensor rule of `nodes` a parameter.

    The polynomials to total degree `degree` are those of the laws at alpha, and move with it; the
    moments are integrated exactly (paper, eqs. (quadrature) and (moments)). Cost: one evaluation of
    the response at J points and O(N J K M).
    """

    inputs: Inputs
    response: Response
    nodes: int
    degree: int

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the N expansions, with the derivatives of just what is computed."""
        outcomes = self.outcomes(alpha, gradient=gradient)
        matrix, weights = self._expansion(alpha, order)
        fine = outcomes.y @ matrix.T
        if outcomes.dy is None:
            return Outcomes(fine, weights).moments(order)
        dfine = np.einsum("fj,njk->nfk", matrix, outcomes.dy, optimize=True)
        dweights = np.zeros((weights.size, alpha.size))
        for k, h in enumerate(self.inputs.hyperparameters):
            # a basis that depends on alpha moves too; its map costs no run, so differences serve
            if not h.free:
                continue
            step = np.zeros_like(alpha)
            step[k] = STEP * (alpha[k] if h.log else h.upper - h.lower)
            up, weights_up = self._expansion(alpha + step, order)
            down, weights_down = self._expansion(alpha - step, order)
            dfine[:, :, k] += outcomes.y @ ((up - down) / (2.0 * step[k])).T
            dweights[:, k] = (weights_up - weights_down) / (2.0 * step[k])
        return Outcomes(fine, weights, dfine, dweights).moments(order)

    def outcomes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        """The outcomes of the response at the nodes, not expanded."""
        return self._plain.outcomes(alpha, gradient=gradient)

    def at(self, alpha: Array) -> Array:
        """The nodes of the tensor rule (J, n)."""
        return self._plain.at(alpha)

    @property
    def _plain(self) -> QuadraturePropagation:
        return QuadraturePropagation(self.inputs, self.response, TensorGauss(self.nodes))

    def _expansion(self, alpha: Array, order: int) -> tuple[Array, Array]:
        return expansion_map(self.inputs, alpha, self.nodes, self.degree, order)
