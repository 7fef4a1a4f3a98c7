"""A fit: the likelihood of the data at one alpha, without simulator runs, and its refits.

Consistency, bootstrap, comparison, posterior, the best possible law and the design of further
experiments all take a `Fit` and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.inference.information import Inference
from aleator.inference.likelihood_at import IndividualsAt, LikelihoodAt, OutcomesAt
from aleator.laws.hyperparameter import LIMITS, Hyperparameter, limits_of
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import IndividualLikelihood, NodeRule
from aleator.likelihood.problem import Problem
from aleator.observations.experiments import Experiments
from aleator.search.interface import LogLikelihood, Scored
from aleator.search.newton import ASCENT, Summit, ascended, on_limits
from aleator.search.objective import SIGHT


@dataclass(frozen=True)
class RefitSettings:
    """Settings of the refit to other data. The values are chosen by judgement.

    A refit has arrived where the estimated rise to the maximum is below `left`, in log-likelihood.
    A scale that ends near zero is also tried from `trials` values between nearly zero and its upper
    limit. Eigenvalues of the first information matrix are raised to `least_curvature` times the
    largest.
    """

    left: float = 1e-2
    trials: int = 7
    least_curvature: float = 1e-8


REFIT = RefitSettings()


@dataclass(frozen=True, eq=False)
class Fit:
    """The likelihood of N experiments with M observations at one value of alpha (K,).

    A fit is immutable: a method that changes something returns another fit. `inference` is the
    uncertainty from the identification, and stays the same when alpha or the data change. `table`
    has the experiments with all columns. `likelihood` is one of two kinds (`OutcomesAt`,
    `IndividualsAt`).
    """

    likelihood: LikelihoodAt
    inference: Inference
    table: Experiments

    @classmethod
    def of_outcomes(
        cls, problem: Problem, alpha: Array, inference: Inference, table: Experiments
    ) -> Fit:
        """The fit of exact outcomes, one for each experiment; `table` has the same experiments."""
        return cls(OutcomesAt(problem, alpha), inference, table)

    @classmethod
    def of_individuals(
        cls,
        likelihood: IndividualLikelihood,
        alpha: Array,
        inference: Inference,
        table: Experiments,
        coarse: NodeRule,
    ) -> Fit:
        """The fit of an integral over individual parameters, with nodes adapted to alpha.

        `coarse` is the rule with the fewest nodes that is accurate enough: more nodes hardly change
        the log-likelihood.
        """
        return cls(IndividualsAt(likelihood, alpha, coarse), inference, table)

    @property
    def alpha(self) -> Array:
        """The alpha (K,) at which the likelihood is taken."""
        return self.likelihood.alpha

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters in the order of alpha."""
        return self.likelihood.hyperparameters

    @property
    def inputs(self) -> Inputs:
        """The laws of the parameters."""
        return self.likelihood.inputs

    @property
    def count(self) -> int:
        """The number N of experiments."""
        return self.likelihood.count

    @property
    def cluster(self) -> Indices:
        """The number (N,) of the cluster of each experiment; clusters are independent.

        Experiments that share parameters are in one cluster; otherwise each is one.
        """
        grouping = self.inputs.grouping
        return np.arange(self.count) if grouping is None else grouping.cluster

    @property
    def cluster_names(self) -> tuple[str, ...]:
        """The names of the clusters: the id of an experiment, or of the first of several."""
        return names_of(self.cluster, self.table.ids)

    def scored(self) -> LogLikelihood:
        """Log-densities (N,) of all experiments at alpha, with scores (N, K)."""
        return self._scored

    def of_experiments(self) -> Array:
        """The log-density (N,) of each experiment at alpha.

        It is that given all others that share parameters with the experiment.
        """
        if isinstance(self.likelihood, IndividualsAt) and self.inputs.grouping is not None:
            return self.likelihood.integral.conditional(self.alpha)
        return self.scored().each

    def objective(self) -> Scored:
        """The log-likelihood as a function of alpha, for a search or a sampler."""
        return self.likelihood.objective()

    def probabilities(self, points: int | None = None) -> Array:
        """P(value below the measured one | earlier ones of its experiment, alpha) (M,)."""
        return self.likelihood.probabilities(self.table.observations, points)

    def at(self, alpha: Array) -> Fit:
        """The fit of the same data at another alpha."""
        return replace(self, likelihood=self.likelihood.at(alpha))

    def seeing(self, table: Experiments) -> Fit:
        """The fit of the same experiments with the observations of another table."""
        return replace(self, likelihood=self.likelihood.seeing(table.observations), table=table)

    def drawn(self, rng: np.random.Generator) -> Fit:
        """The fit of a data set drawn under the law and the noise of alpha."""
        other = self.likelihood.drawn(self.table.observations, rng)
        return self.seeing(self.table.with_observations(other))

    def ruled(self, rule: NodeRule, which: Flags) -> Fit:
        """The fit of the experiments `which` (N,) with another node rule; the others count zero.

        The likelihood must be an integral over individual parameters of each experiment alone.
        Nodes are adapted when observations are seen.
        """
        assert isinstance(self.likelihood, IndividualsAt)
        return replace(self, likelihood=self.likelihood.ruled(rule, which))

    def for_replicates(self) -> Fit:
        """The fit with nodes that evaluate many data sets quickly."""
        likelihood, moved = self.likelihood.for_replicates()
        fit = replace(self, likelihood=likelihood)
        return stepped(fit) if moved else fit

    @cached_property
    def _scored(self) -> LogLikelihood:
        return self.likelihood.scored()


def names_of(group: Indices, ids: Sequence[str]) -> tuple[str, ...]:
    """The names of groups of experiments, by the id of the first and the number of the others.

    >>> names_of(np.array([0, 1, 0]), ["a", "b", "c"])
    ('a and 1 more', 'b')
    """
    first, count = np.unique(group, return_index=True, return_counts=True)[1:]
    return tuple(
        ids[k] if others == 1 else f"{ids[k]} and {others - 1} more"
        for k, others in zip(first.tolist(), count.tolist(), strict=True)
    )


@dataclass(frozen=True, eq=False)
class Weighted:
    """A log-likelihood in which experiment l counts `weights[l]` times; `weights` is (N,).

    The experiments of a cluster have one weight.
    """

    objective: Scored
    weights: Array

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The weighted log-likelihood and its scores at alpha (K,)."""
        found, counted, own = self.objective(alpha), self.weights > 0.0, self.weights
        if found.cluster is not None:
            own = own[np.unique(found.cluster, return_index=True)[1]]
        each = np.where(own > 0.0, own * found.each, 0.0)
        scores = found.scores
        if scores is not None:
            scores = np.where(counted[:, None], self.weights[:, None] * scores, 0.0)
        return replace(found, each=each, scores=scores)


def stepped(fit: Fit) -> Fit:
    """The fit one Newton step closer to its maximum, by the information of the identification.

    For data drawn at the identified alpha the step ends within a distance of order 1/N of the
    maximum, while the maximum itself is of order 1/sqrt(N) away. This is exact enough for many
    bootstrap replicates. Along a ridge the whole step may lower the likelihood, so it is halved
    until it does not.
    """
    moving = fit.inference.identified
    if not moving.size:
        return fit
    begun = fit.scored()
    score = begun.score[moving]
    limits, here = limits_of(fit.hyperparameters, moving), fit.alpha[moving]
    free = np.flatnonzero(~on_limits(here, score, *limits) & np.isfinite(score))
    step = np.zeros(moving.size)
    step[free] = np.linalg.lstsq(fit.inference.information[np.ix_(free, free)], score[free])[0]
    for half in range(ASCENT.tries):
        alpha = fit.alpha.copy()
        alpha[moving] = np.clip(here + 0.5**half * step, *limits)
        there = fit.at(alpha)
        if there.scored().total >= begun.total:
            return there
    return fit


def climbed(fit: Fit, weights: Array | None = None, arrived: float = ASCENT.arrived) -> Fit:
    """The fit at the nearest maximum; experiment l counts `weights[l]` times (None: once)."""
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


@dataclass(frozen=True)
class Refit:
    """A fit at its maximum, the maximal `value`, and whether the search `arrived` there.

    The value is the log-likelihood plus the log priors, with the weights of the experiments if
    there are any.
    """

    fit: Fit
    value: float
    arrived: bool


def refitted(fit: Fit, weights: Array | None = None, settings: RefitSettings = REFIT) -> Refit:
    """The fit at the maximum near its alpha; experiment l counts `weights[l]` times (None: once).

    A local ascent is made as in `climbed`. A scale that ends at its lower limit or near zero is
    also tried from several larger values, because the derivative with respect to a standard
    deviation is zero at zero, whether or not zero is the maximum. Cost: about ten evaluations;
    twice as many with such a scale.
    """
    objective: Scored = fit.objective()
    if weights is not None:
        objective = Weighted(objective, weights)
    end = _climb(fit, objective, fit.alpha, fit.inference.information)
    for k in _near_zero(fit, end.alpha):
        start = _best(objective, end.alpha, k, fit.hyperparameters[k], settings.trials)
        other = _climb(fit, objective, start, _outer(fit, objective(start)))
        end = other if other.value > end.value else end
    return Refit(fit.at(end.alpha), end.value, end.value > SIGHT.floor and end.gain < settings.left)


def _climb(fit: Fit, objective: Scored, alpha: Array, matrix: Array) -> Summit:
    moving, information = fit.inference.identified, positive(matrix)
    return ascended(objective, alpha, fit.hyperparameters, moving, information, ASCENT.arrived)


def _near_zero(fit: Fit, alpha: Array) -> list[int]:
    each = [(k, fit.hyperparameters[k]) for k in fit.inference.identified.tolist()]
    return [k for k, h in each if h.log and alpha[k] <= max(h.lower, LIMITS.nearest * h.upper)]


def _best(objective: Scored, alpha: Array, k: int, h: Hyperparameter, trials: int) -> Array:
    """The best of several alphas that differ in hyperparameter k, a scale above zero."""
    scales = np.geomspace(max(h.lower, LIMITS.nearest * h.upper), h.upper, trials + 2)[1:-1]
    points = np.repeat(alpha[None], trials, axis=0)
    points[:, k] = scales
    values = np.array([objective(point).total for point in points])
    best: Array = points[int(np.argmax(np.where(np.isfinite(values), values, -np.inf)))]
    return best


def _outer(fit: Fit, found: LogLikelihood) -> Array:
    """The sum (G, G) of the outer products of the experiments' scores, which is never negative."""
    assert found.scores is not None
    scores = found.scores[:, fit.inference.identified]
    return np.asarray(scores.T @ scores)


def positive(matrix: Array, least: float = REFIT.least_curvature) -> Array:
    """A positive definite matrix: the absolute values of the eigenvalues, none of them near zero.

    The matrix is first scaled to a unit diagonal. A search that uses an information matrix which is
    not positive definite goes astray.

    >>> positive(np.array([[2.0, 0.0], [0.0, -3.0]])).tolist()
    [[2.0, 0.0], [0.0, 3.0]]
    """
    if not matrix.size:
        return matrix
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where((scale > 0.0) & np.isfinite(scale), scale, 1.0)
    unit = np.nan_to_num(matrix / np.outer(scale, scale))
    values, vectors = np.linalg.eigh(0.5 * (unit + unit.T))
    size = np.abs(values)
    size = np.maximum(size, least * max(size.max(), 1.0))
    return np.asarray((vectors * size) @ vectors.T * np.outer(scale, scale))
