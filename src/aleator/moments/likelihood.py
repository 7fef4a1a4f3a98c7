"""Log-likelihood of alpha and its exact score.

log L(alpha) = sum_l log f_Yl(y_l | alpha)   (paper, eq. (MLE)), and log priors where given.
A predictive distribution and data: it never sees a simulator.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.laws import Hyperparameter
from aleator.laws.hyperparameter import log_prior
from aleator.moments.located import Located
from aleator.moments.predictive import Predictive
from aleator.search.value import LogLikelihood
from aleator.types import Array, Indices


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
        here = self.predictive.at(alpha)
        honest = replace(here.scored(self.outcomes), each=here.fitted.log_pdf(self.outcomes))
        return honest.believed(self.hyperparameters, alpha)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood without its score, at about a third of the cost."""
        fitted = self.predictive.under(alpha).fitted
        found = LogLikelihood(fitted.log_pdf(self.outcomes), None, fitted.status)
        return found.believed(self.hyperparameters, alpha)

    def gap(self, alpha: Array) -> float:
        """Change of the log-likelihood with half as many nodes again; zero where there are none."""
        more = self.predictive.finer()
        if more is None:
            return 0.0
        finer = replace(self, predictive=more).evaluate(alpha)
        return finer.likelihood - self.evaluate(alpha).likelihood

    def given(self, outcomes: Array) -> Likelihood:
        """The same distributions with other outcomes (N,)."""
        return replace(self, outcomes=outcomes)

    @property
    def continued(self) -> Continued:
        """What a search climbs."""
        return Continued(self)

    def take(self, rows: Indices) -> Likelihood:
        """The likelihood of some of the experiments."""
        return Likelihood(self.predictive.take(rows), self.outcomes[rows])


class Continued:
    """The objective of a search: the log-likelihood, continued where there is none.

    Outside a support and where a density failed it is a smooth penalty with the exact score of just
    what is computed, so that a search that is still far away finds its way. A sound answer
    contains none of it. The last densities are where the next ones are sought from, which is all
    that it remembers: values depend on it by rounding only.
    """

    def __init__(self, likelihood: Likelihood, known: Located | None = None) -> None:
        self.likelihood, self._last = likelihood, known

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The continued log-likelihood at alpha (K,) with its score."""
        self._last = self.likelihood.predictive.at(alpha, self._last)
        found = self._last.scored(self.likelihood.outcomes)
        return found.believed(self.likelihood.hyperparameters, alpha)

    def values(self, alphas: Array) -> Array:
        """The continued totals (A,) at alphas (A, K), without scores."""
        own = self.likelihood
        totals = own.predictive.continued(np.asarray(alphas), own.outcomes)
        priors = [log_prior(own.hyperparameters, alpha) for alpha in alphas]
        return np.asarray(totals + np.array(priors))
