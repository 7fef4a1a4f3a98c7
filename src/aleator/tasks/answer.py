"""From a question to its answer: search, look at the answer, search where it says, be sure.

`identify` asks for the experiments that were measured, `recover` for virtual ones. Both go this
way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from aleator.inference.information import Inference, infer
from aleator.inference.profile import Profile, profile_intervals
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem
from aleator.search import Search, SearchResult, ascend
from aleator.simulators import Runner
from aleator.surrogates import AdaptiveSurfaces
from aleator.tasks.baselines import baselines_of
from aleator.tasks.direct import way_of_outcomes
from aleator.tasks.kept_search import kept_search
from aleator.tasks.ledger import Ledger
from aleator.tasks.many import of_many
from aleator.tasks.refinement.choice import refinement_of
from aleator.tasks.refinement.interface import SEARCH, Refined, Refinement, climbed
from aleator.types import Array

WIDER = 3
"""Times that the region may be widened so that it holds the intervals."""
CLIMBS = 3
"""Times that a profile may meet a better maximum."""


@dataclass(frozen=True)
class Question:
    """Outcomes (N,) of the runner's experiments, and the choices by which they are explained."""

    runner: Runner
    outcomes: Array
    ids: Sequence[str]
    model: Model
    search: Search
    seed: int


@dataclass(frozen=True)
class Answer:
    """A maximum that was found, and how sure it is.

    `surfaces` are those that the problem's are of, with what they may still become; None without.
    `reason` says why there are surfaces, or none.
    """

    problem: Problem
    found: SearchResult
    inference: Inference
    profile: Profile
    surfaces: AdaptiveSurfaces | None
    reason: str


def answered(question: Question, ledger: Ledger) -> Answer:
    """Search, refine the surfaces until nothing moves, and see how sure the answer is."""
    placed = way_of_outcomes(question.runner, question.model)
    model = question.model.directly() if placed.direct else question.model
    way = _way(question, model, ledger)
    refined, inference, profile = _sure(way, way.search(question.seed), ledger)
    return Answer(
        refined.problem, refined.found, inference, profile, refined.surfaces, placed.reason
    )


def sharpened(
    question: Question, answer: Answer, draws: Mapping[int, Array], ledger: Ledger
) -> Answer:
    """The answer with a round of runs for some conditions, each where its own draws lie."""
    way = _way(question, answer.problem.model, ledger)
    before = Refined(answer.problem, answer.found, answer.surfaces, held=True)
    refined, inference, profile = _sure(way, way.sharpened(before, draws), ledger)
    return replace(
        answer, problem=refined.problem, found=refined.found, inference=inference, profile=profile
    )


def infer_at(problem: Problem, found: SearchResult) -> tuple[SearchResult, Inference, Profile]:
    """Standard errors and profile intervals; climbs on if the profile meets a better maximum."""
    objective, hyperparameters = problem.objective, problem.model.hyperparameters
    for _ in range(CLIMBS):
        inference = infer(objective, found.alpha, hyperparameters)
        profile = profile_intervals(
            objective, found.alpha, hyperparameters, inference, rivals=found.rivals
        )
        if profile.better is None:
            break
        information = inference.information
        end, _ = ascend(
            objective, profile.better, hyperparameters, inference.identified, information
        )
        found = found.improved(end, objective(end), inference.identified)
    return found, inference, profile


@dataclass(frozen=True)
class _Search:
    """The user's search, with the baselines of the same surfaces among its guesses."""

    runner: Runner
    search: Search
    seed: int
    ledger: Ledger

    def __call__(self, problem: Problem, guess: list[Array]) -> SearchResult:
        with self.ledger.stage("baselines"):
            fit, linear = baselines_of(problem, self.search, self.seed)
        hyperparameters = problem.model.hyperparameters
        around = np.array([h.start for h in hyperparameters])
        inputs = problem.model.inputs
        for law, part, value in zip(inputs.laws.values(), inputs.slices, fit.x, strict=True):
            around[part] = law.filling(value)
        guesses = [*guess, around, linear.alpha]
        maximize = partial(
            self.search.maximize, hyperparameters=hyperparameters, seed=self.seed,
            guesses=guesses, progress=self.ledger.progress,
        )  # fmt: skip
        with self.ledger.stage(SEARCH):
            return kept_search(
                None if problem.surface is None else self.runner, self.search, problem.objective,
                hyperparameters, guesses, self.seed, lambda: of_many(problem, maximize),
            )  # fmt: skip


def _way(question: Question, model: Model, ledger: Ledger) -> Refinement:
    own = _Search(question.runner, question.search, question.seed, ledger)
    return refinement_of(
        question.runner, question.outcomes, model, own, ledger.stage, ledger.progress,
        question.ids,
    )  # fmt: skip


def _sure(way: Refinement, refined: Refined, ledger: Ledger) -> tuple[Refined, Inference, Profile]:
    """Inference on surfaces that hold the laws at the ends of the intervals, and on fine grids."""
    # level sets of the simulator itself have no region that could be too narrow
    direct = refined.problem.levels is not None and refined.surfaces is None
    for widened in range(0 if direct else WIDER + 1):
        with ledger.stage("inference"):
            found, inference, profile = infer_at(refined.problem, refined.found)
        refined = replace(refined, found=found)
        held = None if widened == WIDER else way.hold(refined, inference, profile.intervals)
        if held is None:
            break
        refined = held
    levels = refined.problem.levels
    if levels is None:
        return refined, inference, profile
    with ledger.stage("inference"):
        problem = replace(refined.problem, likelihood=levels.fine())
        hyperparameters = problem.model.hyperparameters
        known = infer(refined.problem.objective, refined.found.alpha, hyperparameters)
        found, inference, profile = infer_at(problem, climbed(problem, refined.found, known))
    return replace(refined, problem=problem, found=found), inference, profile
