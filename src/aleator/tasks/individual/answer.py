"""From a question to its answer: search with nodes that follow, settle, be sure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from aleator.inference.diagnostics.individual import Rival
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
from aleator.observations.errors import MeasurementErrors, Noise
from aleator.observations.experiments import Experiments
from aleator.search import Optimum, Search, SearchResult, WarmStart
from aleator.simulators import Runner
from aleator.surrogates import AdaptiveSurfaces, ResponseSurface
from aleator.surrogates.responses import moving_parameters
from aleator.tasks.baselines import start_point
from aleator.tasks.direct import way_of
from aleator.tasks.individual.failed import lost_observations
from aleator.tasks.individual.guess import PooledFit, guesses, pooled_fit
from aleator.tasks.individual.highest import highest, told
from aleator.tasks.individual.infer import inferred
from aleator.tasks.individual.order import ordered
from aleator.tasks.individual.population import first_region
from aleator.tasks.individual.rivals import followed_rivals, rivals
from aleator.tasks.individual.settle import Settled, climbed, settled
from aleator.tasks.individual.surfaces import SURFACE, Begun, ByResponseSurfaces
from aleator.tasks.kept_search import kept_search
from aleator.tasks.ledger import Ledger
from aleator.types import Array, Flags, Indices

FIRST = (GaussHermite(1), GaussHermite(5), GaussHermite(3), GaussHermite(3))
"""The nodes that a search begins with, by the number of variates."""
FEWEST = GaussHermite(3, 1)
"""... for more variates than that."""
MANY = 3000
"""Experiments from where on a search on a sample of them, in groups, costs less than one on all."""
SAMPLE = 300
BEST = 3
"""Optima of a sample that are climbed from with all experiments."""


@dataclass(frozen=True, eq=False)
class Question:
    """Experiments, the law whose hyperparameters are wanted, and how the observations err.

    Of the observations that the runner gives values of the table has those that are `kept`.
    """

    runner: Runner
    table: Experiments
    inputs: Inputs
    noise: Noise | Mapping[str, Noise]
    surfaces: ResponseSurface
    search: Search
    seed: int
    kept: Flags

    def without(self, lost: Flags) -> Question:
        """The same without some of the observations (M,): no run gives their values."""
        kept = self.kept.copy()
        kept[kept] = ~lost
        return replace(self, table=self.table.only(~lost), kept=kept)

    @property
    def unit(self) -> Indices:
        """(M,) the unit whose run gives each observation."""
        return self.runner.unit[self.kept]

    @property
    def column(self) -> Indices:
        """(M,) which of the values of that run each observation is."""
        return self.runner.column[self.kept]

    @cached_property
    def errors(self) -> MeasurementErrors:
        """The measurement errors of the table's observations."""
        return MeasurementErrors.of(self.noise, self.table)

    @cached_property
    def layout(self) -> Layout:
        """Which run gives the value of which observation."""
        experiment = self.table.observations.experiment
        return Layout(len(self.table.ids), experiment, self.unit, self.column)

    @cached_property
    def measured(self) -> Array:
        """The observations (M,) as numbers: of one that is censored, the bound that is known."""
        seen = self.table.observations
        return np.where(np.isfinite(seen.lower), seen.lower, seen.upper)

    def likelihood(self, predictor: Predictor) -> IndividualLikelihood:
        """With few nodes, for a search."""
        variates = self.inputs.scattering
        rule = FIRST[variates] if variates < len(FIRST) else FEWEST
        return IndividualLikelihood.of(self.inputs, self.errors, predictor, self.layout, rule)


@dataclass(frozen=True, eq=False)
class Answer:
    """A maximum, and how sure it is; without surfaces the simulator itself was integrated over.

    `question` is what was answered in the end: without observations that no run gives a value of.
    `reason` says why this way was taken.
    """

    question: Question
    settled: Settled
    found: SearchResult
    inference: Inference
    profile: Profile
    fit: PooledFit
    surfaces: AdaptiveSurfaces | None
    rivals: tuple[Rival, ...]
    reason: str


def answered(question: Question, ledger: Ledger) -> Answer:
    """Search with nodes that follow, settle, and see how sure the answer is."""
    inputs, runner = question.inputs, question.runner
    hyperparameters = (*inputs.hyperparameters, *question.errors.hyperparameters)
    region = first_region(inputs, hyperparameters, len(question.table.ids))
    start = start_point(inputs)
    way = way_of(runner, question.surfaces, start, region)
    if way.direct:
        question = question.without(
            lost_observations(runner, region, question.unit, question.column)
        )
        likelihood = question.likelihood(Direct(runner, moving_parameters(inputs.box), inputs.box))
        found = _Searched(question, ledger)(likelihood, [])
        lower: tuple[Settled, ...] = ()
        with ledger.stage("search"):
            tops, surfaces = highest(settled(likelihood, found.alpha), found), None
    else:
        with ledger.stage(SURFACE):
            begun = Begun.on(runner, region, question.surfaces, question.unit, question.column,
                             ledger.progress)  # fmt: skip
        question, begun = question.without(begun.lost), begun.without_lost()
        searched = _Searched(question, ledger)
        surfaced = ByResponseSurfaces(runner, question.likelihood, searched, ledger).answer(begun)
        # surfaces are exact near the answer: it is as far as they know
        tops, surfaces = told(surfaced.settled, surfaced.found), surfaced.surfaces
        lower = surfaced.others
    with ledger.stage("inference"):
        end, found, inference, profile = inferred(tops.settled, tops.found, tops.others)
        others = rivals(end, inference, found, tops.others)
        others = others or followed_rivals(lower, end, inference)
    with ledger.stage("baselines"):
        fit = pooled_fit(end.likelihood, question.measured, start_point(question.inputs))
    return Answer(question, end, found, inference, profile, fit, surfaces, others, way.reason)


@dataclass(frozen=True, eq=False)
class _Searched:
    """The user's search, with the pooled fit on the same surfaces among its guesses.

    Of many experiments it is made on a sample, and its best ends are climbed from with all.
    """

    question: Question
    ledger: Ledger

    def __call__(self, likelihood: IndividualLikelihood, guess: Sequence[Array]) -> SearchResult:
        question = self.question
        with self.ledger.stage("baselines"):
            fit = pooled_fit(likelihood, question.measured, start_point(question.inputs))
        known = [*guess, *guesses(likelihood, fit, question.measured, question.seed)]
        # what a search finds at other surfaces need not be sought everywhere again
        search = WarmStart(guess[0]) if guess else question.search
        few = likelihood.count <= MANY
        objective = likelihood if few else likelihood.sampled(SAMPLE)
        maximize = partial(
            search.maximize, objective, likelihood.hyperparameters, seed=question.seed,
            guesses=known, progress=self.ledger.progress,
        )  # fmt: skip
        with self.ledger.stage("search"):
            found = kept_search(
                None if isinstance(likelihood.predictor, Direct) else question.runner, search,
                likelihood.continued, likelihood.hyperparameters, known, question.seed,
                lambda: maximize() if few else _with_all(likelihood, maximize()),
            )  # fmt: skip
            return ordered(found, question.inputs)


def _with_all(likelihood: IndividualLikelihood, found: SearchResult) -> SearchResult:
    """The best optima of a sample as those of all experiments."""
    optima = []
    for optimum in found.optima[:BEST]:
        held, alpha = climbed(likelihood, optimum.alpha)
        optima.append(Optimum(alpha, held.evaluate(alpha).total, optimum.starts))
    best, *others = sorted(optima, key=lambda o: -o.log_likelihood)
    ascents = tuple(
        replace(ascent, log_likelihood=best.log_likelihood)
        for ascent in found.ascents
        if ascent.converged
    )
    return replace(
        found,
        alpha=best.alpha,
        log_likelihood=best.log_likelihood,
        optima=(best, *others),
        ascents=ascents or found.ascents,
    )
