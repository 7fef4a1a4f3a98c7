"""Moments of a polynomial chaos expansion in standard normal variates, for many parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.laws import Inputs
from aleator.moments.densities.moments import Moments
from aleator.moments.densities.outcomes import Outcomes
from aleator.moments.expansion import Basis, Design
from aleator.moments.expansion.moments import ExpansionMoments, prepare
from aleator.moments.propagation.choice import Fit
from aleator.moments.propagation.quadrature import along_alpha
from aleator.surrogates.responses import Response
from aleator.types import Array


@dataclass(frozen=True)
class ExpandedPropagation:
    """Moments of eta(T(theta | alpha)) expanded in Hermite polynomials of theta ~ N(0, 1).

    The points of the design, in theta, do not depend on alpha, and the coefficients are linear
    in the outcomes there, so that their derivative by alpha is that of the outcomes. The moments of
    the expansion are exact (paper, eq. (moments3.0); here by tensor Gauss rules or Galerkin
    products). `order` is the highest moment that will be asked for. Cost: one evaluation of the
    response at the points, and O(N J P) besides the moments.
    """

    inputs: Inputs
    response: Response
    fit: Fit
    order: int

    @cached_property
    def _basis(self) -> Basis:
        return Basis.normal(self.inputs.scattering)

    @cached_property
    def design(self) -> Design:
        """The points in theta, (J, scattering)."""
        return self.fit.design(self._basis)

    @cached_property
    def _operator(self) -> Array:
        """From outcomes at the points to coefficients, (J, P): the fit of every unit vector."""
        return self.fit.fit(self._basis, self.design, np.eye(len(self.design))).coefficients

    @cached_property
    def _exact(self) -> ExpansionMoments:
        expansion = self.fit.fit(self._basis, self.design, np.zeros((1, len(self.design))))
        return prepare(self._basis, expansion.indices, self.order)

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the expansions of the N outcomes, with derivatives if asked for."""
        outcomes = self.outcomes(alpha, gradient=gradient)
        coefficients = outcomes.y @ self._operator
        if outcomes.dy is None:
            return _lowered(self._exact.moments(coefficients), order)
        m = self._exact.moments_with_gradient(coefficients)
        assert m.mean_jac is not None
        assert m.sd_jac is not None
        assert m.standardized_jac is not None
        # by the outcomes first: moments are fewer than hyperparameters and polynomials
        own = np.stack(
            [m.mean_jac, m.sd_jac, *np.moveaxis(m.standardized_jac[:, 3:], 1, 0)], axis=1
        )
        change = (own @ self._operator.T) @ outcomes.dy
        standardized = np.zeros((*m.standardized.shape, self.inputs.size))
        standardized[:, 3:] = change[:, 2:]
        whole = Moments(m.mean, m.sd, m.standardized, change[:, 0], change[:, 1], standardized)
        return _lowered(whole, order)

    def at(self, alpha: Array) -> Array:
        """The points of the design as parameters (J, n)."""
        return self.inputs.image(alpha, self.design.t)[0]

    def outcomes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        """The outcomes at the points of the design, with its weights."""
        x, dx = self.inputs.image(alpha, self.design.t)
        if not gradient:
            return Outcomes(self.response.evaluate(x), self.design.weights)
        outcome, slope = self.response.evaluate_with_gradient(x)
        none = np.zeros((len(self.design), self.inputs.size))
        return Outcomes(outcome, self.design.weights, along_alpha(slope, dx), none)


def _lowered(moments: Moments, order: int) -> Moments:
    """The moments up to a lower order than was prepared."""
    jac = moments.standardized_jac
    return Moments(
        moments.mean,
        moments.sd,
        moments.standardized[:, : order + 1],
        moments.mean_jac,
        moments.sd_jac,
        None if jac is None else jac[:, : order + 1],
    )
