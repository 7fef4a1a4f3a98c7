"""Log-likelihood of alpha and its exact score.

log L(alpha) = sum_l log f_Yl(y_l | alpha)   (paper, eq. (MLE)).
It never sees a simulator: only alpha -> moments, or alpha -> outcomes at the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.densities import Density, FittedDensity, NodeDensity, NodeSensitivity, Sensitivity
from aleator.densities.moments import Moments, add_normal_noise, joined
from aleator.densities.outcomes import Outcomes
from aleator.laws import Hyperparameter
from aleator.likelihood.propagation import NodePropagation, Propagation
from aleator.types import Array

NOISE_REACH = 8.0
"""Standard deviations of noise added to the outcome's range: mass beyond is below 1e-15."""


@dataclass(frozen=True)
class LogLikelihood:
    """Value at one alpha: `each` (N,) log-densities, `scores` (N, K) or None, `status` (N,)."""

    each: Array
    scores: Array | None
    status: NDArray[np.int64]

    @property
    def total(self) -> float:
        """The log-likelihood, summed over experiments."""
        return float(self.each.sum())

    @property
    def score(self) -> Array:
        """The derivative of the total by alpha, (K,)."""
        assert self.scores is not None
        return np.asarray(self.scores.sum(axis=0))


@dataclass(frozen=True)
class Likelihood:
    """The likelihood of N outcomes as a function of alpha (K,).

    `propagation` gives the moments, or the outcomes at the nodes, of U distinct conditions, and
    `condition` (N,) says which of them each experiment was made under: repetitions are propagated
    once. `lower` and `upper` (N,) are the range of the noise-free outcome, possibly infinite.
    `hyperparameters` (K) are those of the inputs, followed by `noise.sd` if `noisy`.

    Two kinds of value: `evaluate` is honest (minus infinity outside a support); calling the
    likelihood gives the smooth continuation that a search needs while it is still far away, with
    the exact score, and `values` gives the continuation alone for many alphas at once.
    """

    propagation: Propagation
    density: Density | NodeDensity
    outcomes: Array
    condition: NDArray[np.intp]
    lower: Array
    upper: Array
    hyperparameters: tuple[Hyperparameter, ...]
    noisy: bool

    def moments(self, alpha: Array, *, gradient: bool = False, order: int = 4) -> Moments:
        """Moments of the measured outcomes, noise included."""
        law, noise_sd = self._split(alpha)
        moments = self.propagation.moments(law, order, gradient=gradient)
        if self.noisy:
            moments = add_normal_noise(moments, noise_sd)
        return moments.take(self.condition)

    def fit(self, alpha: Array) -> FittedDensity:
        """The N fitted densities at alpha."""
        if isinstance(self.density, NodeDensity):
            outcomes = self._at_nodes(alpha, gradient=False)
            return self.density.fit_nodes(outcomes, self._split(alpha)[1], self.lower, self.upper)
        moments = self.moments(alpha, order=self._order)
        return self.density.fit(moments, *self._noisy_range(alpha))

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The honest log-likelihood; cost about that of a call without the score."""
        fitted = self.fit(alpha)
        return LogLikelihood(fitted.log_pdf(self.outcomes), None, fitted.status)

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The continued log-likelihood with its exact score, by the chain rule."""
        if isinstance(self.density, NodeDensity):
            return self._by_nodes(self.density, alpha)
        return self._by_moments(self.density, alpha)

    def values(self, alphas: Array) -> Array:
        """The continued log-likelihood at alphas (A, K), as (A,): one batch of A N densities."""
        if isinstance(self.density, NodeDensity):
            return np.array(
                [
                    self._node_sensitivity(self.density, a, gradient=False)[0].value.sum()
                    for a in alphas
                ]
            )
        count = self.outcomes.size
        every = joined([self.moments(alpha, order=self._order) for alpha in alphas])
        ranges = [self._noisy_range(alpha) for alpha in alphas]
        lower, upper = (np.concatenate(ends) for ends in zip(*ranges, strict=True))
        fitted = self.density.fit(every, lower, upper)
        value = fitted.sensitivity(np.tile(self.outcomes, len(alphas))).value
        return np.asarray(value.reshape(-1, count).sum(axis=1))

    def _by_moments(self, density: Density, alpha: Array) -> LogLikelihood:
        moments = self.moments(alpha, gradient=True, order=self._order)
        s = density.fit(moments, *self._noisy_range(alpha)).sensitivity(self.outcomes)
        return LogLikelihood(s.value, self._moment_scores(s, moments), s.status)

    def _moment_scores(self, s: Sensitivity, moments: Moments) -> Array:
        assert moments.mean_jac is not None
        assert moments.sd_jac is not None
        assert moments.standardized_jac is not None
        scores = (
            s.d_mean[:, None] * moments.mean_jac
            + s.d_sd[:, None] * moments.sd_jac
            + np.einsum("nm,nmk->nk", s.d_standardized, moments.standardized_jac)
        )
        if self.noisy:
            # the range of the outcome is widened by the noise
            scores[:, -1] += NOISE_REACH * (s.d_upper - s.d_lower)
        return np.asarray(scores)

    def _by_nodes(self, density: NodeDensity, alpha: Array) -> LogLikelihood:
        s, outcomes = self._node_sensitivity(density, alpha)
        assert outcomes.dy is not None
        assert outcomes.dweights is not None
        scores = (s.d_y[:, None, :] @ outcomes.dy)[:, 0, :] + s.d_weights @ outcomes.dweights
        if self.noisy:
            scores = np.concatenate([scores, s.d_noise[:, None]], axis=1)
        return LogLikelihood(s.value, scores, s.status)

    def _node_sensitivity(
        self, density: NodeDensity, alpha: Array, gradient: bool = True
    ) -> tuple[NodeSensitivity, Outcomes]:
        outcomes = self._at_nodes(alpha, gradient=gradient)
        noise_sd = self._split(alpha)[1]
        fitted = density.fit_nodes(outcomes, noise_sd, self.lower, self.upper)
        return fitted.node_sensitivity(self.outcomes), outcomes

    def _at_nodes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        assert isinstance(self.propagation, NodePropagation)
        law, _ = self._split(alpha)
        return self.propagation.outcomes(law, gradient=gradient).take(self.condition)

    def _split(self, alpha: Array) -> tuple[Array, float]:
        """The law's part of alpha, and the noise's standard deviation."""
        return (alpha[:-1], float(alpha[-1])) if self.noisy else (alpha, 0.0)

    def _noisy_range(self, alpha: Array) -> tuple[Array, Array]:
        margin = NOISE_REACH * self._split(alpha)[1]
        return self.lower - margin, self.upper + margin

    @property
    def _order(self) -> int:
        """Moments that the density needs, and at least the four of the report."""
        return 4 if isinstance(self.density, NodeDensity) else max(self.density.order, 4)
