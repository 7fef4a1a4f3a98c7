"""The parameters of single experiments, as images of standard normal variates of their own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from aleator.laws.law import Law, Standard
from aleator.types import Array

if TYPE_CHECKING:
    from aleator.laws.inputs import Inputs


@dataclass(frozen=True, eq=False)
class Individual:
    """Parameters x (B, J, n) of B experiments at J standard normal variates xi (B, J, s) of each.

    x = T(xi | alpha): every law is the image of a variate theta, and theta = L xi ties correlated
    parameters (see `Inputs`); `theta` is (B, J, s). It is smooth in alpha with xi held, whatever
    the support of a law.
    """

    inputs: Inputs
    xi: Array
    theta: Array
    x: Array
    own: tuple[Standard, ...]
    mixing: Array
    mixing_slope: Array
    alpha: Array
    experiments: slice

    @classmethod
    def of(cls, inputs: Inputs, alpha: Array, xi: Array, experiments: slice) -> Individual:
        """The image of the variates under the law alpha (K,) of these experiments."""
        mixing, slope = _mixing(inputs, alpha)
        theta = xi @ mixing.T
        place = {i: s for s, i in enumerate(inputs.scattered)}
        none = np.zeros(xi.shape[:2])
        own = tuple(
            _standard(law, values, theta[..., place[i]] if i in place else none)
            for i, (law, values) in enumerate(
                zip(inputs.laws.values(), inputs.values(alpha, experiments), strict=True)
            )
        )
        x = np.stack([part.x for part in own], axis=-1)
        return cls(inputs, xi, theta, x, own, mixing, slope, alpha, experiments)

    def by_variates(self) -> Array:
        """dx/dxi (B, J, n, s)."""
        slopes = np.zeros((*self.x.shape, self.xi.shape[2]))
        for s, i in enumerate(self.inputs.scattered):
            slopes[:, :, i] = self.own[i].dtheta[..., None] * self.mixing[s]
        return slopes

    def score(self, gradient: Array) -> Array:
        """sum_j g_j dx_j/dalpha (B, K) of a gradient g by x (B, J, n), xi held."""
        first = self.inputs.partials.start
        found = np.zeros((len(self.x), self.inputs.size))
        found[:, :first] = self._score_of_laws(gradient)
        for k in range(self.mixing_slope.shape[2]):
            moved = self.xi @ self.mixing_slope[:, :, k].T
            for s, i in enumerate(self.inputs.scattered):
                if np.any(self.mixing_slope[s, :, k]):
                    by_theta = gradient[..., i] * self.own[i].dtheta
                    found[:, first + k] += np.sum(by_theta * moved[..., s], axis=1)
        return found

    def _score_of_laws(self, gradient: Array) -> Array:
        """The part of the score by what is not a correlation."""
        by_values = np.concatenate(
            [
                np.einsum("bj,bjk->bk", gradient[..., i], own.dvalues)
                for i, own in enumerate(self.own)
            ],
            axis=1,
        )
        model = self.inputs.covariate_model
        if model is None:
            return by_values
        return model.score(self.alpha, by_values, self.experiments)


def variates_of(inputs: Inputs, alpha: Array, x: Array, experiments: slice) -> Array:
    """The variates xi (B, s) whose image the parameters x (B, n) are; not finite beyond a law.

    The inverse of `Individual.of`: xi = L^-1 theta with theta the normal scores of x.
    """
    laws, values = list(inputs.laws.values()), inputs.values(alpha, experiments)
    theta = [laws[i].normal_score(values[i], x[:, i, None])[:, 0] for i in inputs.scattered]
    mixing = _mixing(inputs, alpha)[0]
    return np.asarray(np.linalg.solve(mixing, np.array(theta)).T)


def _mixing(inputs: Inputs, alpha: Array) -> tuple[Array, Array]:
    """L (s, s) of theta = L xi over all scattering parameters, and dL/d partial (s, s, p)."""
    s, members = inputs.scattering, list(inputs.correlation.members)
    partial = alpha[inputs.partials]
    mixing, slope = np.eye(s), np.zeros((s, s, partial.size))
    if members:
        factor, by_partial = inputs.correlation.cholesky(partial)
        mixing[np.ix_(members, members)] = factor
        slope[np.ix_(members, members, range(partial.size))] = by_partial
    return mixing, slope


def _standard(law: Law, values: Array, theta: Array) -> Standard:
    """The image of theta (B, J), with dvalues (B, J, k)."""
    if values.ndim > 1:
        return law.standard(values, theta)
    # a law from elsewhere may know flat variates only
    found = law.standard(values, theta.ravel())
    shape = theta.shape
    return Standard(
        found.x.reshape(shape), found.dtheta.reshape(shape), found.dvalues.reshape(*shape, -1)
    )
