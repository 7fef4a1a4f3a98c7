"""The distribution of the outcomes under a law, by a density that is fitted to their moments.

Law and response, but no data (paper, eq. (PDF)). It carries the derivatives by alpha, so that a
likelihood made of it has its exact score.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.laws import Hyperparameter
from aleator.moments.densities import Density, FittedDensity
from aleator.moments.densities.interface import NearbyDensity
from aleator.moments.densities.moments import Moments, joined
from aleator.moments.located import Located
from aleator.moments.propagation import NodePropagation, Propagation, QuadraturePropagation, finer
from aleator.types import Array, Indices


@dataclass(frozen=True, eq=False)
class FittedOutcomes:
    """The distributions of N outcomes under one law; see `PredictedOutcomes`."""

    moments: Moments
    fitted: FittedDensity

    @property
    def mean(self) -> Array:
        """(N,)."""
        return self.moments.mean

    @property
    def sd(self) -> Array:
        """(N,)."""
        return self.moments.sd

    @property
    def standardized(self) -> Array:
        """Standardized moments (N, 5) of orders zero to four."""
        return self.moments.standardized[:, :5]

    @property
    def status(self) -> NDArray[np.int64]:
        """(N,) `Status` codes."""
        return self.fitted.status

    def cdf(self, y: Array) -> Array:
        """P(outcome < y) (N,)."""
        return self.fitted.cdf(y)

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, Q) that are not exceeded with probabilities p (Q,)."""
        return self.fitted.quantile(p)


@dataclass(frozen=True)
class Predictive:
    """The distributions of N outcomes as functions of alpha (K,).

    `propagation` gives the moments of U distinct conditions, and `condition` (N,) says which of
    them each experiment is made under: repetitions are propagated once. `lower` and `upper` (N,)
    are the range of the outcome, possibly infinite. `hyperparameters` (K) are those of the inputs.
    """

    propagation: Propagation
    density: Density
    condition: Indices
    lower: Array
    upper: Array
    hyperparameters: tuple[Hyperparameter, ...]

    @property
    def name(self) -> str:
        """What the densities are made of, for reports."""
        return self.density.name

    @property
    def order(self) -> int:
        """Moments that are needed: those that are matched, and the four of a report."""
        return max(self.density.order, 4)

    def moments(self, alpha: Array, *, gradient: bool = False) -> Moments:
        """Moments of the outcomes."""
        moments = self.propagation.moments(alpha, self.order, gradient=gradient)
        return moments.take(self.condition)

    def under(self, alpha: Array) -> FittedOutcomes:
        """The N densities with these moments on the range of the outcome."""
        moments = self.moments(alpha)
        return FittedOutcomes(moments, self.density.fit(moments, self.lower, self.upper))

    def at(self, alpha: Array, known: Located | None = None) -> Located:
        """The same with derivatives by alpha; sooner where densities nearby are known."""
        if known is not None and np.array_equal(known.alpha, alpha):
            return known
        moments, ends = self.moments(alpha, gradient=True), (self.lower, self.upper)
        if isinstance(self.density, NearbyDensity) and known is not None:
            fitted = self.density.fit_near(moments, *ends, known.fitted)
        else:
            fitted = self.density.fit(moments, *ends)
        return Located(alpha.copy(), fitted, moments)

    def continued(self, alphas: Array, y: Array) -> Array:
        """Sums (A,) of the continuation at y (N,), for alphas (A, K): a batch of A N densities."""
        every = joined([self.moments(alpha) for alpha in alphas])
        lower, upper = (np.tile(end, len(alphas)) for end in (self.lower, self.upper))
        fitted = self.density.fit(every, lower, upper)
        value = fitted.sensitivity(np.tile(y, len(alphas))).value
        return np.asarray(value.reshape(-1, y.size).sum(axis=1))

    def nodes(self, alpha: Array) -> Array:
        """The nodes x (J, n) of the law. Raises TypeError for a propagation that has none."""
        if not isinstance(self.propagation, NodePropagation):
            raise TypeError(f"{type(self.propagation).__name__} has no nodes")
        return self.propagation.at(alpha)

    def take(self, rows: Indices) -> Predictive:
        """The distributions of some of the experiments, without a thought of the others."""
        propagation, condition = self.propagation, self.condition[rows]
        if isinstance(propagation, QuadraturePropagation) and propagation.divisible:
            asked, condition = np.unique(condition, return_inverse=True)
            propagation = propagation.take(asked)
        return replace(
            self,
            propagation=propagation,
            condition=condition,
            lower=self.lower[rows],
            upper=self.upper[rows],
        )

    def finer(self) -> Predictive | None:
        """The same with half as many nodes again a parameter; None where that is not known."""
        way = self.propagation
        if not isinstance(way, QuadraturePropagation):
            return None
        more = finer(way.cubature)
        if more is None:
            return None
        return replace(self, propagation=QuadraturePropagation(way.inputs, way.response, more))
