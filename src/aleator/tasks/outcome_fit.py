"""The fit of experiments with one outcome each: the density of the outcome, without runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from aleator.errors import InputsError
from aleator.inference.diagnostics.surfaces import relative_errors
from aleator.inference.fit import SPAN, stepped
from aleator.inference.information import Inference
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.problem import Problem
from aleator.observations.experiments import Experiments
from aleator.observations.responses import Observations
from aleator.search.value import LogLikelihood
from aleator.surrogates.responses import DirectResponse, Predicted
from aleator.types import Array

FARTHEST = 6.0
"""Quantiles are tabulated to so many standard deviations of a normal law."""
TABULATED = 81
"""Quantiles between which outcomes are drawn by interpolation."""


@dataclass(frozen=True, eq=False)
class OutcomeFit:
    """A `Fit` of a problem; the outcomes of the table are those of the problem."""

    problem: Problem
    alpha: Array
    inference: Inference
    table: Experiments

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of the model."""
        return self.problem.model.hyperparameters

    @property
    def inputs(self) -> Inputs:
        """The laws of the parameters."""
        return self.problem.model.inputs

    @property
    def region(self) -> Array:
        """That of the surfaces; with collocation the box."""
        return self.problem.region

    @property
    def count(self) -> int:
        """N."""
        return len(self.problem.outcomes)

    def scored(self) -> LogLikelihood:
        """Log-densities (N,) with scores (N, K); a smooth continuation where there is none."""
        return self._scored

    def objective(self) -> Callable[[Array], LogLikelihood]:
        """The continued log-likelihood."""
        return self.problem.continued

    def honest(self) -> Callable[[Array], LogLikelihood]:
        """The log-likelihood itself."""
        return self.problem.likelihood

    def more_nodes(self, alpha: Array) -> float:
        """With half as many nodes again; zero for collocation, where nodes cost runs."""
        return self.problem.gap(alpha)

    def probabilities(self, points: int | None = None) -> Array:  # noqa: ARG002  see `Fit`
        """P(below the outcome | alpha), (N,)."""
        return self._under.cdf(self.problem.outcomes)

    def rough(self) -> OutcomeFit:
        """The same, with level sets on coarser grids; other nodes are those of the law."""
        return replace(self, problem=self.problem.coarse())

    def for_replicates(self) -> OutcomeFit:
        """The same on coarser grids, alpha fitted by these."""
        return self if self.problem.levels is None else stepped(self.rough())

    def at(self, alpha: Array) -> OutcomeFit:
        """The same outcomes at another alpha."""
        return replace(self, alpha=alpha)

    def seeing(self, table: Experiments) -> OutcomeFit:
        """The same experiments with the outcomes of another table."""
        problem = self.problem.given(table.outcomes)
        return replace(self, problem=problem, table=table)

    def drawn(self, rng: np.random.Generator) -> OutcomeFit:
        """Other outcomes under the law of alpha.

        With surfaces they are values of these, and with level sets of the simulator; with
        collocation, quantiles of the densities, and where one failed the outcome stays as it is.
        """
        problem = self.problem
        if problem.levels is not None and isinstance(problem.response, DirectResponse):
            x = self.inputs.sample(self.alpha, rng.random((self.count, len(self.inputs.names))))
            return self._with(problem.response.run(problem.condition, x))
        if problem.surface is None:
            return self._with(self._from_densities(rng))
        return self._with(self._from_surfaces(rng))

    def span(self) -> tuple[Array, Array]:
        """Ends (N,): seven standard deviations about the mean, within what can be reached."""
        under, ends = self._under, self.problem.predictor
        low, high = under.mean - SPAN * under.sd, under.mean + SPAN * under.sd
        return np.maximum(ends.lower, low), np.minimum(ends.upper, high)

    def quantiles(self, probabilities: Array) -> Array:
        """Those (N, P) of the densities."""
        return self._under.quantile(probabilities)

    def individuals(self, rng: np.random.Generator) -> None:  # noqa: ARG002  see `Fit`
        """None: without noise one outcome leaves a surface of parameters open."""
        return

    def variates(self) -> None:
        """None: see `individuals`."""
        return

    def given(self, x: Array) -> Array:  # noqa: ARG002  see `Fit`
        """Raise InputsError: without noise an outcome has no density given its parameters."""
        raise InputsError(
            "without measurement noise an outcome has no density given its parameters",
            "add noise: [noise] sd, or noise=Noise(...), which may be small",
        )

    @property
    def roughness(self) -> Array | None:
        """Over the scatter of the outcome under the law, (N,)."""
        problem = self.problem
        return (
            None if problem.surface is None else relative_errors(problem.surface)[problem.condition]
        )

    def simulated(self, x: Array) -> Array | None:
        """Values (N, J) of the surfaces, or of a simulator that takes arrays, at x (J, n)."""
        if not self.problem.free:
            return None
        return self.problem.response.evaluate(x)[self.problem.condition]

    def nodes(self) -> tuple[Array, Array] | None:
        """Those of the law at alpha, whose runs the likelihood at alpha has made."""
        if self.problem.free:
            return None
        x = self.problem.nodes(self.alpha)
        return x, self.problem.response.evaluate(x)[self.problem.condition]

    def _with(self, y: Array) -> OutcomeFit:
        """The same with other outcomes (N,), after the transform."""
        (response,) = self.table.observations.responses
        seen = Observations.exact(y, response.name, response.transform)
        return self.seeing(self.table.with_observations(seen))

    def _from_surfaces(self, rng: np.random.Generator) -> Array:
        """Simulated outcomes (N,), each at a point of its own, which may be far out."""
        problem = self.problem
        assert problem.surface is not None
        x = self.inputs.sample(self.alpha, rng.random((self.count, len(self.inputs.names))))
        inside = np.clip(x, *problem.region.T)
        return problem.surface.at(problem.condition, inside[:, problem.moving])

    def _from_densities(self, rng: np.random.Generator) -> Array:
        """Outcomes (N,) by interpolation between the quantiles of the densities."""
        score, table = self._quantiles
        drawn = rng.standard_normal(self.count)
        place = np.clip(np.searchsorted(score, drawn) - 1, 0, score.size - 2)
        share = np.clip((drawn - score[place]) / (score[place + 1] - score[place]), 0.0, 1.0)
        rows = np.arange(self.count)
        y = (1.0 - share) * table[rows, place] + share * table[rows, place + 1]
        return np.where(np.isfinite(y), y, self.problem.outcomes)

    @cached_property
    def _scored(self) -> LogLikelihood:
        return self.objective()(self.alpha)

    @cached_property
    def _under(self) -> Predicted:
        """The distributions of the outcomes at alpha."""
        return self.problem.predictor.under(self.alpha)

    @cached_property
    def _quantiles(self) -> tuple[Array, Array]:
        """Normal scores (Q,) and the outcomes (N, Q) at their probabilities, at alpha."""
        score = np.linspace(-FARTHEST, FARTHEST, TABULATED)
        return score, self._under.quantile(special.ndtr(score))
