"""From a question to its answer: search with nodes that follow, settle, be sure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import (
    Direct,
    GaussHermite,
    IndividualLikelihood,
    Layout,
    Predictor,
)
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Experiments
from aleator.search import Search, SearchResult
from aleator.simulators import Runner
from aleator.surrogates import AdaptiveSurfaces, ResponseSurface
from aleator.tasks.baselines import start_point
from aleator.tasks.individual.cost import cheap
from aleator.tasks.individual.guess import PooledFit, guesses, pooled_fit
from aleator.tasks.individual.infer import inferred
from aleator.tasks.individual.settle import Settled, settled
from aleator.tasks.individual.surfaces import ByResponseSurfaces
from aleator.tasks.ledger import Ledger
from aleator.types import Array

FIRST = (1, 7, 5)
"""Gauss-Hermite nodes a variate that a search begins with, by the number of variates."""
FEWEST = 3
"""... for more variates than that."""


@dataclass(frozen=True, eq=False)
class Question:
    """Experiments, the law whose hyperparameters are wanted, and how the observations err."""

    runner: Runner
    table: Experiments
    inputs: Inputs
    errors: MeasurementErrors
    surfaces: ResponseSurface
    search: Search
    seed: int

    @cached_property
    def layout(self) -> Layout:
        """Which run gives the value of which observation."""
        experiment = self.table.observations.experiment
        return Layout(len(self.table.ids), experiment, self.runner.unit, self.runner.column)

    @cached_property
    def measured(self) -> Array:
        """The observations (M,) as numbers: of one that is censored, the bound that is known."""
        seen = self.table.observations
        return np.where(np.isfinite(seen.lower), seen.lower, seen.upper)

    def likelihood(self, predictor: Predictor) -> IndividualLikelihood:
        """With few nodes, for a search."""
        variates = self.inputs.scattering
        rule = GaussHermite(FIRST[variates] if variates < len(FIRST) else FEWEST)
        return IndividualLikelihood.of(self.inputs, self.errors, predictor, self.layout, rule)


@dataclass(frozen=True, eq=False)
class Answer:
    """A maximum, and how sure it is; without surfaces the simulator itself was integrated over."""

    settled: Settled
    found: SearchResult
    inference: Inference
    profile: Profile
    fit: PooledFit
    surfaces: AdaptiveSurfaces | None


def answered(question: Question, ledger: Ledger) -> Answer:
    """Search with nodes that follow, settle, and see how sure the answer is."""
    searched = _Searched(question, ledger)
    if cheap(question.runner, question.inputs, start_point(question.inputs)):
        inputs = question.inputs
        moving = np.flatnonzero(inputs.box[:, 1] > inputs.box[:, 0])
        likelihood = question.likelihood(Direct(question.runner, moving, inputs.box))
        found = searched(likelihood, [])
        with ledger.stage("search"):
            end, surfaces = settled(likelihood, found.alpha), None
    else:
        way = ByResponseSurfaces(
            question.runner, question.likelihood, question.surfaces, searched, ledger
        )
        hyperparameters = (*question.inputs.hyperparameters, *question.errors.hyperparameters)
        surfaced = way.answer(question.inputs, hyperparameters)
        end, found, surfaces = surfaced.settled, surfaced.found, surfaced.surfaces
    found = replace(found, alpha=end.alpha, log_likelihood=end.value)
    with ledger.stage("inference"):
        end, found, inference, profile = inferred(end, found)
    with ledger.stage("baselines"):
        fit = pooled_fit(end.likelihood, question.measured, start_point(question.inputs))
    return Answer(end, found, inference, profile, fit, surfaces)


@dataclass(frozen=True, eq=False)
class _Searched:
    """The user's search, with the pooled fit on the same surfaces among its guesses."""

    question: Question
    ledger: Ledger

    def __call__(self, likelihood: IndividualLikelihood, guess: Sequence[Array]) -> SearchResult:
        question = self.question
        with self.ledger.stage("baselines"):
            fit = pooled_fit(likelihood, question.measured, start_point(question.inputs))
        with self.ledger.stage("search"):
            return question.search.maximize(
                likelihood,
                likelihood.hyperparameters,
                seed=question.seed,
                guesses=[*guess, *guesses(likelihood, fit)],
                progress=self.ledger.progress,
            )
