"""A fit, as everything that judges one or builds on one sees it: no run of the simulator is made.

Tests of consistency, bootstrap, comparison, posterior and design ask the same few things: the
log-likelihood of each experiment with its score, other data under the same law, and the maximum
for other data or other weights. Each of the two ways to a likelihood answers them in one file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, Self, TypeVar

import numpy as np

from aleator.inference.information import Inference
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.laws.inputs import Inputs
from aleator.observations.experiments import Experiments
from aleator.search.newton import ARRIVED, TRIES, ascended, held
from aleator.search.value import LogLikelihood
from aleator.types import Array

SPAN = 7.0
"""Standard deviations of an outcome on either side of its mean that hold nearly all of it."""


class Fit(Protocol):
    """The likelihood of N experiments with M observations, at alpha (K,).

    A value: each method that changes something returns another fit. `inference` is that of the
    identification, whatever alpha and data are now; `table` has the experiments with all columns.
    """

    @property
    def alpha(self) -> Array:
        """Where it stands, (K,)."""

    @property
    def inference(self) -> Inference:
        """Information and errors at the identified alpha."""

    @property
    def table(self) -> Experiments:
        """The experiments: their ids, and the columns of their table."""

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of alpha, in its order."""

    @property
    def inputs(self) -> Inputs:
        """The laws of the parameters."""

    @property
    def region(self) -> Array:
        """Where simulated values are known, (n, 2): the region of the surfaces, or the box."""

    @property
    def count(self) -> int:
        """N."""

    def scored(self) -> LogLikelihood:
        """Log-densities (N,) of all experiments at alpha, with scores (N, K)."""

    def objective(self) -> Callable[[Array], LogLikelihood]:
        """The same as a function of alpha, which a search or a sampler may climb."""

    def honest(self) -> Callable[[Array], LogLikelihood]:
        """The same for a sampler: a function of alpha alone, minus infinity outside a support."""

    def more_nodes(self, alpha: Array) -> float:
        """What more nodes change of the log-likelihood at alpha; zero where there are no more."""

    def probabilities(self, points: int | None = None) -> Array:
        """P(below what was measured | earlier ones of the same experiment, alpha) (M,).

        Under the right alpha they are independent and uniform. NaN where one is not known. By so
        many `points` of each experiment where they are integrals; None takes what a report needs.
        """

    def rough(self) -> Self:
        """The same with the fewest nodes that serve."""

    def for_replicates(self) -> Self:
        """The same with nodes that many data sets in turn are quickly judged by."""

    def at(self, alpha: Array) -> Self:
        """The same data at another alpha."""

    def seeing(self, table: Experiments) -> Self:
        """Other data: the same experiments, whose observations are those of another table."""

    def drawn(self, rng: np.random.Generator) -> Self:
        """Other data of the same experiments, under the law and the noise of alpha."""

    def span(self) -> tuple[Array, Array]:
        """Ends (M,) between which each observation would lie, but for one in many thousands."""

    def quantiles(self, probabilities: Array) -> Array:
        """Quantiles (M, P) of what would be measured in place of each observation, under alpha.

        Of the law, not of what is known of the experiment. NaN where there is none.
        """

    def individuals(self, rng: np.random.Generator) -> Array | None:
        """A draw (N, n) of the parameters of each experiment given its observations.

        Under the right model they are a sample of the law. None where there is no noise.
        """

    def variates(self) -> tuple[Array, Array] | None:
        """Means (N, s) and mean products (N, s, s) of the variates of the scattering parameters.

        Given the observations of their experiment; under the law they are standard normal. None
        where there is no noise, or one observation an experiment, which tells no parameter alone.
        """

    def given(self, x: Array) -> Array:
        """log p(observations of an experiment | parameters) (N, J) at points x (J, n).

        Raises AleatorError where there is no noise.
        """

    @property
    def roughness(self) -> Array | None:
        """Of each observation the estimated error of its surface, relative, (M,); None without."""

    def simulated(self, x: Array) -> Array | None:
        """What is known of the simulator at points x (J, n): of each observation, (M, J).

        By its surfaces, or by itself where it is fast. NaN where it has no value; None with
        collocation, which knows its nodes only.
        """

    def nodes(self) -> tuple[Array, Array] | None:
        """With collocation its nodes x (J, n), and the outcomes of its runs there (M, J).

        None where `simulated` answers.
        """


AnyFit = TypeVar("AnyFit", bound=Fit)


@dataclass(frozen=True, eq=False)
class Weighted:
    """An objective in which experiment l counts `weights[l]` times, (N,)."""

    objective: Callable[[Array], LogLikelihood]
    weights: Array

    def __call__(self, alpha: Array) -> LogLikelihood:
        """Value and score at alpha (K,)."""
        found, counted = self.objective(alpha), self.weights > 0.0
        each = np.where(counted, self.weights * found.each, 0.0)
        scores = found.scores
        if scores is not None:
            scores = np.where(counted[:, None], self.weights[:, None] * scores, 0.0)
        return replace(found, each=each, scores=scores)


def stepped(fit: AnyFit) -> AnyFit:
    """The fit one Newton step nearer to its maximum, by the information of the identification.

    For data drawn at the identified alpha the step ends within 1/N of the maximum, where the
    maximum itself is 1/sqrt(N) away: what a bootstrap of many replicates needs. Along a ridge a
    whole step may lead far down, so it is halved until it does not.
    """
    moving = fit.inference.identified
    if not moving.size:
        return fit
    begun = fit.scored()
    score = begun.score[moving]
    limits, here = limits_of(fit.hyperparameters, moving), fit.alpha[moving]
    free = np.flatnonzero(~held(here, score, *limits) & np.isfinite(score))
    step = np.zeros(moving.size)
    step[free] = np.linalg.lstsq(fit.inference.information[np.ix_(free, free)], score[free])[0]
    for half in range(TRIES):
        alpha = fit.alpha.copy()
        alpha[moving] = np.clip(here + 0.5**half * step, *limits)
        there = fit.at(alpha)
        if there.scored().total >= begun.total:
            return there
    return fit


def climbed(fit: AnyFit, weights: Array | None = None, arrived: float = ARRIVED) -> AnyFit:
    """The fit at the nearest maximum; experiments count `weights` (N,) times, or once each."""
    if not fit.inference.identified.size:
        return fit
    objective = fit.objective()
    if weights is not None:
        objective = Weighted(objective, weights)
    end = ascended(
        objective, fit.alpha, fit.hyperparameters, fit.inference.identified,
        fit.inference.information, arrived,
    )  # fmt: skip
    return fit.at(end.alpha)
