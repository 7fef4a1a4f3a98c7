"""The paper's likelihood: densities that are fitted to moments, as functions of alpha, and data.

log L(alpha) = sum_l log f_Yl(y_l | alpha)   (paper, eqs. (PDF) and (MLE)), and log priors where
given. `Predictive` has law and response, but no data; it carries the derivatives by alpha, so that
the `Likelihood` made of it has its exact score. Neither sees a simulator.
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
    """The distributions of N outcomes under one law; see `PredictedOutcomes`."""

    moments: Moments
    fitted: FittedMomentDensity

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

    def scored(self, y: Array) -> LogLikelihood:
        """Continued log-densities at y (N,) with their scores, by the chain rule over moments."""
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

    def under(self, alpha: Array, *, gradient: bool = False) -> FittedOutcomes:
        """The N densities with these moments on the range of the outcome."""
        moments = self.moments(alpha, gradient=gradient)
        return FittedOutcomes(moments, self.density.fit(moments, self.lower, self.upper))

    def continued(self, alphas: Array, y: Array) -> Array:
        """Sums (A,) of the continuation at y (N,), for alphas (A, K): a batch of A N densities."""
        every = joined([self.moments(alpha) for alpha in alphas])
        lower, upper = (np.tile(end, len(alphas)) for end in (self.lower, self.upper))
        fitted = self.density.fit(every, lower, upper)
        value = fitted.sensitivity(np.tile(y, len(alphas))).value
        return np.asarray(value.reshape(-1, y.size).sum(axis=1))

    def nodes(self, alpha: Array) -> Array:
        """The points x (J, n) at which the response is evaluated."""
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
        """The same with half as many nodes again a parameter; None where that is not known."""
        way = self.propagation
        if not isinstance(way, QuadraturePropagation):
            return None
        more = finer(way.cubature)
        if more is None:
            return None
        return replace(self, propagation=QuadraturePropagation(way.inputs, way.response, more))


@dataclass(frozen=True)
class Likelihood:
    """The likelihood of N outcomes as a function of alpha (K,): what users and samplers may call.

    It is honest: minus infinity where an outcome lies outside the support of its density. What a
    search needs there, a smooth continuation, is `Continued`.
    """

    predictive: Predictive
    outcomes: Array

    @property
    def name(self) -> str:
        """What its densities are made of, for reports."""
        return self.predictive.name

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of alpha, in its order."""
        return self.predictive.hyperparameters

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood with its exact score; outside a support the score leads back to it."""
        here = self.predictive.under(alpha, gradient=True)
        honest = replace(here.scored(self.outcomes), each=here.fitted.log_pdf(self.outcomes))
        return honest.believed(self.hyperparameters, alpha)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood without its score, at about a third of the cost."""
        fitted = self.predictive.under(alpha).fitted
        value = LogLikelihood(fitted.log_pdf(self.outcomes), None, fitted.status)
        return value.believed(self.hyperparameters, alpha)

    def gap(self, alpha: Array) -> float:
        """Change of the log-likelihood with half as many nodes again; zero where there are none."""
        more = self.predictive.finer()
        if more is None:
            return 0.0
        finer = replace(self, predictive=more).evaluate(alpha)
        return finer.likelihood - self.evaluate(alpha).likelihood

    def with_outcomes(self, outcomes: Array) -> Likelihood:
        """The same distributions with other outcomes (N,)."""
        return replace(self, outcomes=outcomes)

    @property
    def continued(self) -> Continued:
        """What a search climbs."""
        return Continued(self)

    def take(self, rows: Indices) -> Likelihood:
        """The likelihood of some of the experiments."""
        return Likelihood(self.predictive.take(rows), self.outcomes[rows])


@dataclass(frozen=True)
class Continued:
    """The objective of a search: the log-likelihood, continued where there is none.

    Outside a support and where a density failed it is a smooth penalty with the exact score of just
    what is computed, so that a search that is still far away finds its way. A sound answer
    contains none of it.
    """

    likelihood: Likelihood

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The continued log-likelihood at alpha (K,) with its score."""
        outcomes = self.likelihood.predictive.under(alpha, gradient=True)
        value = outcomes.scored(self.likelihood.outcomes)
        return value.believed(self.likelihood.hyperparameters, alpha)

    def values(self, alphas: Array) -> Array:
        """The continued totals (A,) at alphas (A, K), without scores."""
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
    """Each density by moments at alpha against the exact one, all from the same surfaces.

    `exact` is the log-likelihood of the density of the outcome itself, and `outcomes` are its
    distributions. Distances are means over `most` experiments, more would say the same, on `points`
    points over `sds` standard deviations to either side: good to a thousandth of one.
    """
    chosen = np.unique(np.linspace(0, likelihood.outcomes.size - 1, most).astype(np.intp))
    steps = np.linspace(-sds, sds, points)
    grid = outcomes.mean[:, None] + outcomes.sd[:, None] * steps
    y, truth = grid[chosen], outcomes.cdf(grid)[chosen]
    rows = []
    for density in COMPARED:
        other = replace(likelihood, predictive=replace(likelihood.predictive, density=density))
        fitted = other.take(chosen).predictive.under(alpha).fitted
        # the earth mover's distance, by the trapezoidal rule
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
