"""The likelihood of the paper, from densities that are fitted to moments.

log L(alpha) = sum_l log f_Yl(y_l | alpha)   (paper, eqs. (PDF) and (MLE)), plus log priors where
given. `Predictive` gives the densities as functions of alpha, with derivatives; it holds no data.
`Likelihood` adds the outcomes and has the exact score. Neither runs a simulator.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.core.status import Status
from aleator.core.types import Array, Indices
from aleator.laws import Hyperparameter
from aleator.laws.hyperparameter import log_prior
from aleator.moments.densities import Density, FittedMomentDensity, Gaussian
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.moments import Moments, joined
from aleator.moments.propagation import Propagation, QuadraturePropagation, finer
from aleator.results.values import DensityDistance
from aleator.search.interface import LogLikelihood
from aleator.simulators.response_functions import Divisible, OutcomeDistribution


@dataclass(frozen=True, eq=False)
class FittedOutcomes:
    """The distributions of N outcomes at one alpha, from densities fitted to their moments."""

    moments: Moments
    fitted: FittedMomentDensity

    @property
    def mean(self) -> Array:
        """The mean of each outcome (N,)."""
        return self.moments.mean

    @property
    def sd(self) -> Array:
        """The standard deviation of each outcome (N,)."""
        return self.moments.sd

    @property
    def standardized(self) -> Array:
        """The standardized moments of each outcome (N, 5), of orders zero to four."""
        return self.moments.standardized[:, :5]

    @property
    def status(self) -> NDArray[np.int64]:
        """The `Status` code of each fitted density (N,)."""
        return self.fitted.status

    def cdf(self, y: Array) -> Array:
        """The probability (N,) that each outcome is below y (N,)."""
        return self.fitted.cdf(y)

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, Q) that are not exceeded with probabilities p (Q,)."""
        return self.fitted.quantile(p)

    def scored(self, y: Array) -> LogLikelihood:
        """Log-densities at y (N,), continued outside the supports, with their scores by alpha."""
        s, moments = self.fitted.sensitivity(y), self.moments
        assert moments.mean_jac is not None
        assert moments.sd_jac is not None
        assert moments.standardized_jac is not None
        scores = (
            s.d_mean[:, None] * moments.mean_jac
            + s.d_sd[:, None] * moments.sd_jac
            + (s.d_standardized[:, None] @ moments.standardized_jac)[:, 0]
        )
        return LogLikelihood(s.value, np.asarray(scores), s.status)


@dataclass(frozen=True)
class Predictive:
    """The distributions of N outcomes as functions of alpha (K,).

    `propagation` gives the moments under U distinct conditions, and `condition` (N,) is the
    condition of each experiment, so that repeated experiments are propagated once. `lower` and
    `upper` (N,) are the physical range of the outcome, possibly infinite. `hyperparameters` (K) are
    those of the laws.
    """

    propagation: Propagation
    density: Density
    condition: Indices
    lower: Array
    upper: Array
    hyperparameters: tuple[Hyperparameter, ...]

    @property
    def name(self) -> str:
        """The name of the kind of density, for reports."""
        return self.density.name

    @property
    def order(self) -> int:
        """The highest order of the moments: that of the density, and at least four for reports."""
        return max(self.density.order, 4)

    def moments(self, alpha: Array, *, gradient: bool = False) -> Moments:
        """The moments of the N outcomes at alpha (K,), with jacobians by alpha if `gradient`."""
        moments = self.propagation.moments(alpha, self.order, gradient=gradient)
        return moments.take(self.condition)

    def under(self, alpha: Array, *, gradient: bool = False) -> FittedOutcomes:
        """The N outcome densities at alpha (K,), fitted to the moments on the physical range."""
        moments = self.moments(alpha, gradient=gradient)
        return FittedOutcomes(moments, self.density.fit(moments, self.lower, self.upper))

    def continued(self, alphas: Array, y: Array) -> Array:
        """Sums over y (N,) of the continued log-densities, one for each of the alphas (A, K).

        All A N densities are fitted in one batch. Returns (A,).
        """
        every = joined([self.moments(alpha) for alpha in alphas])
        lower, upper = (np.tile(end, len(alphas)) for end in (self.lower, self.upper))
        fitted = self.density.fit(every, lower, upper)
        value = fitted.sensitivity(np.tile(y, len(alphas))).value
        return np.asarray(value.reshape(-1, y.size).sum(axis=1))

    def nodes(self, alpha: Array) -> Array:
        """The parameters x (J, n) at which the response is evaluated for alpha (K,)."""
        return self.propagation.at(alpha)

    def take(self, rows: Indices) -> Predictive:
        """The distributions of some of the experiments, computed without the others."""
        propagation, condition = self.propagation, self.condition[rows]
        if isinstance(propagation, QuadraturePropagation) and isinstance(
            propagation.response, Divisible
        ):
            conditions, condition = np.unique(condition, return_inverse=True)
            propagation = propagation.take(conditions)
        return replace(
            self,
            propagation=propagation,
            condition=condition,
            lower=self.lower[rows],
            upper=self.upper[rows],
        )

    def finer(self) -> Predictive | None:
        """These distributions with half as many nodes again, or None where there is no finer rule.

        A set of Sobol' points is doubled instead.
        """
        way = self.propagation
        if not isinstance(way, QuadraturePropagation):
            return None
        more = finer(way.cubature)
        if more is None:
            return None
        return replace(self, propagation=QuadraturePropagation(way.inputs, way.response, more))


@dataclass(frozen=True)
class Likelihood:
    """The likelihood of N outcomes as a function of alpha (K,), for users and samplers.

    It is minus infinity where an outcome lies outside the support of its density. A search needs a
    smooth continuation there, which is `Continued`.
    """

    predictive: Predictive
    outcomes: Array

    @property
    def name(self) -> str:
        """The name of the kind of density, for reports."""
        return self.predictive.name

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters, in the order of alpha."""
        return self.predictive.hyperparameters

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood with its exact score at alpha (K,).

        For an outcome outside its support the value is minus infinity, and the score is that of the
        continuation, which leads back to the support.
        """
        here = self.predictive.under(alpha, gradient=True)
        honest = replace(here.scored(self.outcomes), each=here.fitted.log_pdf(self.outcomes))
        return honest.believed(self.hyperparameters, alpha)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood without its score, at about a third of the cost."""
        fitted = self.predictive.under(alpha).fitted
        value = LogLikelihood(fitted.log_pdf(self.outcomes), None, fitted.status)
        return value.believed(self.hyperparameters, alpha)

    def gap(self, alpha: Array) -> float:
        """Change of the log-likelihood if the nodes are refined; zero without a finer rule."""
        more = self.predictive.finer()
        if more is None:
            return 0.0
        finer = replace(self, predictive=more).evaluate(alpha)
        return finer.likelihood - self.evaluate(alpha).likelihood

    def with_outcomes(self, outcomes: Array) -> Likelihood:
        """The likelihood of other outcomes (N,) under the same distributions."""
        return replace(self, outcomes=outcomes)

    @property
    def continued(self) -> Continued:
        """The objective that a search maximizes."""
        return Continued(self)

    def take(self, rows: Indices) -> Likelihood:
        """The likelihood of some of the experiments."""
        return Likelihood(self.predictive.take(rows), self.outcomes[rows])


@dataclass(frozen=True)
class Continued:
    """The objective of a search: the log-likelihood, continued where there is no density.

    For an outcome outside its support, or with a density that could not be fitted, a smooth penalty
    takes the place of the log-density. Its score is exact, so that a search far from the maximum is
    led towards it. At a valid maximum no outcome has such a penalty.
    """

    likelihood: Likelihood

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The continued log-likelihood at alpha (K,) with its score."""
        outcomes = self.likelihood.predictive.under(alpha, gradient=True)
        value = outcomes.scored(self.likelihood.outcomes)
        return value.believed(self.likelihood.hyperparameters, alpha)

    def values(self, alphas: Array) -> Array:
        """The continued log-likelihood plus log prior at each of the alphas (A, K), as (A,)."""
        likelihood = self.likelihood
        totals = likelihood.predictive.continued(np.asarray(alphas), likelihood.outcomes)
        priors = [log_prior(likelihood.hyperparameters, alpha) for alpha in alphas]
        return np.asarray(totals + np.array(priors))


COMPARED: tuple[Density, ...] = (
    Gaussian(),
    MaximumEntropy(order=4),
    MaximumEntropy(order=6),
)


def density_distances(
    likelihood: Likelihood,
    alpha: Array,
    exact: float,
    outcomes: OutcomeDistribution,
    most: int = 25,
    sds: float = 8.0,
    points: int = 401,
) -> tuple[DensityDistance, ...]:
    """How far each density fitted to moments is at alpha from the exact density of the outcome.

    Both come from the same response surfaces. `exact` is the log-likelihood with the exact density,
    and `outcomes` are the exact distributions. The earth mover's distances, in standard deviations,
    are computed for at most `most` experiments, on `points` points over `sds` standard deviations
    to either side of the mean; their error is about a thousandth.
    """
    chosen = np.unique(np.linspace(0, likelihood.outcomes.size - 1, most).astype(np.intp))
    steps = np.linspace(-sds, sds, points)
    grid = outcomes.mean[:, None] + outcomes.sd[:, None] * steps
    y, truth = grid[chosen], outcomes.cdf(grid)[chosen]
    rows = []
    for density in COMPARED:
        other = replace(likelihood, predictive=replace(likelihood.predictive, density=density))
        fitted = other.take(chosen).predictive.under(alpha).fitted
        # This is the earth mover's distance, by the trapezoidal rule.
        distance = np.trapezoid(np.abs(fitted.cdf(y) - truth), steps, axis=1)
        value = other.evaluate(alpha)
        rows.append(
            DensityDistance(
                density.name,
                value.total - exact,
                float(np.mean(distance)),
                float(np.max(distance)),
                int(np.sum(value.status != Status.SOLVED)),
            )
        )
    return tuple(rows)
