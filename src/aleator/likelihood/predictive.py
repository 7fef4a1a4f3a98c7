"""The distribution of the outcomes under a law: law, response and noise, but no data.

Two ways lead to it. `FromMoments` fits a density to the moments of the outcome (the paper).
`FromNodes` sums over the outcomes at the nodes of the law. Both carry the derivatives by alpha, so
that a likelihood made of them has its exact score.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from aleator.densities import Density, FittedDensity, NodeDensity, NodeSensitivity, Sensitivity
from aleator.densities.moments import Moments, add_noise, joined
from aleator.densities.outcomes import Outcomes
from aleator.laws import Hyperparameter
from aleator.likelihood.propagation import NodePropagation, Propagation
from aleator.observations.noise import Noise
from aleator.search.value import LogLikelihood
from aleator.types import Array, Indices


@dataclass(frozen=True)
class Predictive(ABC):
    """The distributions of N outcomes as functions of alpha (K,).

    `propagation` gives the moments, or the outcomes at the nodes, of U distinct conditions, and
    `condition` (N,) says which of them each experiment is made under: repetitions are propagated
    once. `lower` and `upper` (N,) are the range of the noise-free outcome, possibly infinite.
    `hyperparameters` (K) are those of the inputs, followed by `noise.sd` where there is noise.
    """

    propagation: Propagation
    density: Density | NodeDensity
    condition: Indices
    lower: Array
    upper: Array
    hyperparameters: tuple[Hyperparameter, ...]
    noise: Noise | None

    @abstractmethod
    def fitted(self, alpha: Array) -> FittedDensity:
        """The N densities of the measured outcomes at alpha."""

    @abstractmethod
    def scored(self, alpha: Array, y: Array) -> tuple[FittedDensity, LogLikelihood]:
        """The densities at alpha, and their smooth continuation at y (N,) with its scores.

        The continuation is the log-density itself wherever there is one.
        """

    @abstractmethod
    def continued(self, alphas: Array, y: Array) -> Array:
        """Sums (A,) of the continuation at y (N,), for alphas (A, K)."""

    @property
    @abstractmethod
    def order(self) -> int:
        """Moments that are needed: those that are matched, and the four of a report."""

    def moments(self, alpha: Array, *, gradient: bool = False) -> Moments:
        """Moments of the measured outcomes, noise included."""
        moments = self.propagation.moments(self.law(alpha), self.order, gradient=gradient)
        if self.noise is not None:
            scale = self.noise_sd(alpha)
            moments = add_noise(moments, scale, self.noise.kind.moments(self.order))
        return moments.take(self.condition)

    def law(self, alpha: Array) -> Array:
        """The law's part of alpha."""
        return alpha if self.noise is None else alpha[:-1]

    def noise_sd(self, alpha: Array) -> float:
        """The noise's scale in alpha; zero without noise."""
        return 0.0 if self.noise is None else float(alpha[-1])

    def range(self, noise_sd: float) -> tuple[Array, Array]:
        """Lowest and highest outcome (N,) that can be measured with noise of this scale."""
        margin = 0.0 if self.noise is None else self.noise.kind.reach * noise_sd
        return self.lower - margin, self.upper + margin

    def take(self, rows: Indices) -> Predictive:
        """The distributions of some of the experiments."""
        return replace(
            self,
            condition=self.condition[rows],
            lower=self.lower[rows],
            upper=self.upper[rows],
        )

    def by(
        self, density: Density | NodeDensity, propagation: Propagation | None = None
    ) -> Predictive:
        """The same outcomes in another density, or by other nodes."""
        return predictive(
            propagation or self.propagation, density, self.condition, self.lower, self.upper,
            self.hyperparameters, self.noise,
        )  # fmt: skip


@dataclass(frozen=True)
class FromMoments(Predictive):
    """Densities fitted to the moments of the measured outcomes."""

    density: Density

    @property
    def order(self) -> int:
        """The moments that the density matches, at least four."""
        return max(self.density.order, 4)

    def fitted(self, alpha: Array) -> FittedDensity:
        """The N densities with these moments on the range of the outcome."""
        return self.density.fit(self.moments(alpha), *self.range(self.noise_sd(alpha)))

    def scored(self, alpha: Array, y: Array) -> tuple[FittedDensity, LogLikelihood]:
        """By the chain rule over the moments and over the ends of the range."""
        moments = self.moments(alpha, gradient=True)
        fitted = self.density.fit(moments, *self.range(self.noise_sd(alpha)))
        s = fitted.sensitivity(y)
        return fitted, LogLikelihood(s.value, self._scores(s, moments), s.status)

    def continued(self, alphas: Array, y: Array) -> Array:
        """One batch of A N densities."""
        every = joined([self.moments(alpha) for alpha in alphas])
        ranges = [self.range(self.noise_sd(alpha)) for alpha in alphas]
        lower, upper = (np.concatenate(ends) for ends in zip(*ranges, strict=True))
        fitted = self.density.fit(every, lower, upper)
        value = fitted.sensitivity(np.tile(y, len(alphas))).value
        return np.asarray(value.reshape(-1, y.size).sum(axis=1))

    def _scores(self, s: Sensitivity, moments: Moments) -> Array:
        assert moments.mean_jac is not None
        assert moments.sd_jac is not None
        assert moments.standardized_jac is not None
        scores = (
            s.d_mean[:, None] * moments.mean_jac
            + s.d_sd[:, None] * moments.sd_jac
            + np.einsum("nm,nmk->nk", s.d_standardized, moments.standardized_jac)
        )
        if self.noise is not None:
            # the range of the outcome is widened by the noise
            scores[:, -1] += self.noise.kind.reach * (s.d_upper - s.d_lower)
        return np.asarray(scores)


@dataclass(frozen=True)
class FromNodes(Predictive):
    """Densities of the outcomes at the nodes of the law themselves."""

    propagation: NodePropagation
    density: NodeDensity

    @property
    def order(self) -> int:
        """The four moments of a report."""
        return 4

    def fitted(self, alpha: Array) -> FittedDensity:
        """The N densities around the nodes' outcomes."""
        outcomes = self._at_nodes(alpha, gradient=False)
        return self.density.fit_nodes(outcomes, self.noise_sd(alpha), self.lower, self.upper)

    def scored(self, alpha: Array, y: Array) -> tuple[FittedDensity, LogLikelihood]:
        """By the chain rule over the nodes' outcomes and weights."""
        fitted, s, outcomes = self._sensitivity(alpha, y, gradient=True)
        assert outcomes.dy is not None
        assert outcomes.dweights is not None
        scores = (s.d_y[:, None, :] @ outcomes.dy)[:, 0, :] + s.d_weights @ outcomes.dweights
        if self.noise is not None:
            scores = np.concatenate([scores, s.d_noise[:, None]], axis=1)
        return fitted, LogLikelihood(s.value, scores, s.status)

    def continued(self, alphas: Array, y: Array) -> Array:
        """One alpha after the other: their nodes are many."""
        return np.array([self._sensitivity(a, y, gradient=False)[1].value.sum() for a in alphas])

    def _sensitivity(
        self, alpha: Array, y: Array, *, gradient: bool
    ) -> tuple[FittedDensity, NodeSensitivity, Outcomes]:
        outcomes = self._at_nodes(alpha, gradient=gradient)
        noise_sd = self.noise_sd(alpha)
        fitted = self.density.fit_nodes(outcomes, noise_sd, self.lower, self.upper)
        return fitted, fitted.node_sensitivity(y), outcomes

    def _at_nodes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        outcomes = self.propagation.outcomes(self.law(alpha), gradient=gradient)
        return outcomes.take(self.condition)


def predictive(
    propagation: Propagation,
    density: Density | NodeDensity,
    condition: Indices,
    lower: Array,
    upper: Array,
    hyperparameters: tuple[Hyperparameter, ...],
    noise: Noise | None,
) -> Predictive:
    """The predictive distribution by the way that the density asks for."""
    rest = (condition, lower, upper, hyperparameters, noise)
    if isinstance(density, NodeDensity):
        assert isinstance(propagation, NodePropagation)
        return FromNodes(propagation, density, *rest)
    return FromMoments(propagation, density, *rest)
