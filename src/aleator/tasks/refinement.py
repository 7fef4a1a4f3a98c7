"""Adaptive surrogate refinement: search, refine the surfaces, search again until nothing moves.

A surface costs runs, and an answer looks at it only where the law has its mass. Without a tolerance
the first surfaces are coarse, and the law that they lead to says where the next runs are to be.
With a tolerance the surfaces are exact all over a region, and only the region follows the answer.
Collocation needs no surface. No run is lost on the way. Only the runs that this identification
asked for decide where the next one is, so that a store of runs does not change the answer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from aleator.inference import diagnostics
from aleator.inference.information import Inference, infer
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Forward, Problem, forward, prepare, told
from aleator.progress import Progress
from aleator.search import SearchResult, WarmStart, ascend
from aleator.search.interface import SAME_VALUE
from aleator.simulators import Runner
from aleator.surrogates import AdaptiveSurfaces, Surface, surfaces_of
from aleator.surrogates.responses import moving_parameters
from aleator.tasks.likely import interval_alphas, law_draws, likely_alphas, wide_draws
from aleator.tasks.many import of_many
from aleator.tasks.region import first_region, interval_region, next_region, own_region, widened
from aleator.types import Array, Flags, Indices

Search = Callable[[Problem, list[Array]], SearchResult]
Fast = Callable[[], bool]
"""Whether the simulator itself may take the place of surfaces; found out at the first call."""

SURFACE, SEARCH = "response surface", "search"
"""What the rounds and searches are called in the account of runs and seconds."""
FINEST = 1e-3
"""Estimated error of a surface, over the scatter, below which no error can matter to an answer."""
STILL = 0.1
"""A step of alpha, in the metric of the information (no hyperparameter moves more, in its standard
errors), that is none."""
CHANGE = 0.2
"""A change of the log-likelihood that is none; a thousandth an experiment if that is more."""
ROUNDS = 24
"""Rounds after which the answer is taken as it is."""
ENOUGH = 300
"""Runs an experiment after which a fast simulator is asked itself."""
REGIONS = 6
"""Regions that an identification with a tolerance may try before it takes what it has."""


@dataclass(frozen=True)
class Refined:
    """A maximum that was found, its likelihood, and the surfaces that this rests on.

    `held` says that the region holds the laws at the ends of the intervals, and is not to narrow.
    """

    problem: Problem
    found: SearchResult
    surfaces: AdaptiveSurfaces | None
    held: bool = False


@dataclass(frozen=True)
class Refinement(ABC):
    """How an identification goes on from one answer to a better one.

    `full` is the user's search from guesses; `stage` accounts for runs and seconds; of a `fast`
    simulator surfaces end where runs no longer make them exact.
    """

    runner: Runner
    outcomes: Array
    model: Model
    full: Search
    stage: Callable[[str], AbstractContextManager[None]]
    progress: Progress
    ids: Sequence[str]
    fast: Fast

    @abstractmethod
    def search(self, seed: int) -> Refined:
        """The answer that further runs do not move."""

    @abstractmethod
    def resumed(self, refined: Refined) -> Refined:
        """The same from the surfaces of an answer by another density."""

    def sharpened(self, refined: Refined, draws: Mapping[int, Array]) -> Refined:
        """The answer with a round of runs for some conditions, each where its own draws lie."""
        surfaces = refined.surfaces
        assert surfaces is not None
        with self.stage(SURFACE):
            for condition, some in draws.items():
                surfaces.sharpen(np.arange(surfaces.good.size) == condition, some)
            problem = self._problem(surfaces, refined.problem.region)
        return replace(refined, problem=problem, found=self.full(problem, [refined.found.alpha]))

    def outgrown(self, refined: Refined) -> bool:
        """Whether the simulator itself serves better than surfaces: of many runs, or of steps."""
        surfaces = refined.surfaces
        if surfaces is None:
            return False
        many = surfaces.total_runs > ENOUGH * surfaces.good.size
        return (many or surfaces.broken) and self.fast()

    @abstractmethod
    def hold(self, refined: Refined, inference: Inference, intervals: Array) -> Refined | None:
        """The answer on surfaces that hold the laws at the ends of the intervals, or None if so."""

    def _problem(self, surfaces: AdaptiveSurfaces, region: Array) -> Problem:
        """The likelihood, on a region that is widened until every outcome lies within reach.

        Raises ExperimentsError where one does not though surfaces are exact on the inputs' box.
        """
        box = self.model.inputs.box
        while True:
            if not self.model.follows:
                surfaces.refine(None, surfaces.level, told(self.progress))
            problem = self._prepared(region, surfaces.surface())
            lost = diagnostics.unreachable(problem.by_densities)
            if not lost.size:
                return problem
            if not np.array_equal(region, box):
                region = widened(region, box)
                surfaces.move(moving(region))
            elif not self._sharpened(surfaces, problem.condition[lost]):
                diagnostics.refuse_unreachable(problem.by_densities, self.ids)

    def _sharpened(self, surfaces: AdaptiveSurfaces, lost: Indices) -> bool:
        """Whether some of the conditions `lost` have more runs now, all over the region."""
        where, noise_sd = surfaces.where, surfaces.noise_sd
        surfaces.judge(surfaces.everywhere(), noise_sd)
        members: Flags = surfaces.wanting(FINEST) & np.isin(np.arange(surfaces.good.size), lost)
        if members.any():
            surfaces.sharpen(members, surfaces.everywhere())
        surfaces.judge(where, noise_sd)
        return bool(members.any())

    def _prepared(self, region: Array, surface: Surface | None) -> Problem:
        return prepare(self.runner, self.outcomes, self.model, region, self.progress, surface)

    def _first(self, seed: int) -> tuple[AdaptiveSurfaces, Problem]:
        """First surfaces, and the likelihood that they give."""
        choice = self.model.surfaces
        assert choice is not None
        region = first_region(self.runner, self.model, self.outcomes, seed)
        surfaces = surfaces_of(self.runner, region, choice)
        return surfaces, self._problem(surfaces, region)


@dataclass(frozen=True)
class Collocated(Refinement):
    """The simulator runs where the law is in each evaluation: there is nothing to refine."""

    def search(self, _seed: int) -> Refined:
        """The answer of one search."""
        with self.stage("preparation"):
            problem = self._prepared(self.model.inputs.box, None)
        return Refined(problem, self.full(problem, []), None)

    def resumed(self, _refined: Refined) -> Refined:
        """The answer of one search: no run is kept in surfaces."""
        return self.search(0)

    def hold(self, _refined: Refined, _inference: Inference, _intervals: Array) -> None:
        """There is no region that could be too narrow."""


@dataclass(frozen=True)
class OnRegion(Refinement):
    """Surfaces exact all over a region, to the user's tolerance; the region follows the answer."""

    def search(self, seed: int) -> Refined:
        """The answer on a region that fits it."""
        with self.stage(SURFACE):
            surfaces, problem = self._first(seed)
        return self._followed(Refined(problem, self.full(problem, []), surfaces), surfaces)

    def resumed(self, refined: Refined) -> Refined:
        """The answer on a region that fits it, first on that of the other."""
        surfaces = refined.surfaces
        assert surfaces is not None
        again = self._moved(refined, surfaces, refined.problem.region)
        return self._followed(again, surfaces)

    def hold(self, refined: Refined, _: Inference, intervals: Array) -> Refined | None:
        """The answer on a region that holds the laws at the ends of the intervals."""
        region = interval_region(refined.problem, refined.found.alpha, intervals)
        if region is None or refined.surfaces is None:
            return None
        return self._moved(refined, refined.surfaces, region)

    def _followed(self, refined: Refined, surfaces: AdaptiveSurfaces) -> Refined:
        for _ in range(REGIONS - 1):
            region = next_region(refined.problem, refined.found.alpha)
            if region is None:
                break
            refined = self._moved(refined, surfaces, region)
        return refined

    def _moved(self, refined: Refined, surfaces: AdaptiveSurfaces, region: Array) -> Refined:
        with self.stage(SURFACE):
            surfaces.move(moving(region))
            problem = self._problem(surfaces, region)
        return replace(refined, problem=problem, found=self.full(problem, [refined.found.alpha]))


@dataclass(frozen=True)
class UnderLaw(Refinement):
    """Surfaces exact where the law has its mass, and no more exact than the answer needs."""

    def search(self, seed: int) -> Refined:
        """The answer that further runs do not move."""
        with self.stage(SURFACE):
            surfaces, problem = self._first(seed)
        runs = surfaces.total_runs
        return self._settled(Refined(problem, self.full(problem, []), surfaces), surfaces, runs)

    def resumed(self, refined: Refined) -> Refined:
        """The answer that further runs do not move, from the surfaces of the other."""
        surfaces = refined.surfaces
        assert surfaces is not None
        with self.stage(SURFACE):
            problem = self._problem(surfaces, refined.problem.region)
        runs, found = surfaces.total_runs, self.full(problem, [refined.found.alpha])
        return self._settled(replace(refined, problem=problem, found=found), surfaces, runs)

    def hold(self, refined: Refined, inference: Inference, intervals: Array) -> Refined | None:
        """The answer on surfaces exact enough for the laws at the ends of the intervals too."""
        problem, alpha, surfaces = refined.problem, refined.found.alpha, refined.surfaces
        assert surfaces is not None
        wider = interval_region(problem, alpha, intervals, generous=False)
        region = problem.region if wider is None else wider
        inputs, noise_sd = self.model.inputs, self.model.noise_sd(alpha)
        ends = interval_alphas(alpha, inference, intervals, problem.model.hyperparameters)
        draws = [law_draws(inputs, one, region) for one in (alpha, *ends)]
        with self.stage(SURFACE):
            if wider is not None:
                surfaces.move(moving(region))
            surfaces.judge(np.concatenate(draws), noise_sd)
            members = surfaces.wanting(2.0 * surfaces.level)
            if wider is None and not members.any():
                return None
            if members.any():
                surfaces.sharpen(members, np.concatenate(draws))
            surfaces.judge(draws[0], noise_sd)
            problem = self._problem(surfaces, region)
            found = climbed(problem, refined.found, inference)
        held = refined.held or wider is not None
        return self._settled(Refined(problem, found, surfaces, held), surfaces, -1)

    def _settled(self, refined: Refined, surfaces: AdaptiveSurfaces, searched: int) -> Refined:
        """Refine and climb until nothing moves, and another search finds nothing else.

        `searched` is the number of runs at which it has been made.
        """
        level, calm = surfaces.level, False
        for _ in range(ROUNDS):
            if self.outgrown(refined):
                break
            inference = self._look(refined, surfaces)
            finished = calm and level < surfaces.level
            if not finished:
                level = _wanted_level(surfaces, 0.5 * level if calm else level)
            if finished or not surfaces.wanting(level).any():
                if searched == surfaces.total_runs:
                    break
                searched, before = surfaces.total_runs, refined.found
                refined = self._searched(refined)
                found = refined.found
                if self._calm(before, found, inference):
                    break
                level, calm = surfaces.level, False
            else:
                before = refined.found
                with self.stage(SURFACE):
                    refined = self._refined(refined, surfaces, inference, level)
                calm = self._calm(before, refined.found, inference)
        return refined

    def _searched(self, refined: Refined) -> Refined:
        """What a search finds on surfaces finer than those of the full one.

        A short one tells whether it is still the same where no other optimum was likely.
        """
        problem, known = refined.problem, refined.found
        if known.exhaustive:
            short = partial(
                WarmStart(known.alpha).maximize, hyperparameters=problem.model.hyperparameters,
                seed=0, progress=self.progress,
            )  # fmt: skip
            with self.stage(SEARCH):
                found = of_many(problem, short)
            if found.log_likelihood < known.log_likelihood + SAME_VALUE:
                return refined
        return replace(refined, found=self.full(problem, [known.alpha]))

    def _look(self, refined: Refined, surfaces: AdaptiveSurfaces) -> Inference:
        """Judge the surfaces under the law of the answer, and tell how sure that is."""
        problem, alpha = refined.problem, refined.found.alpha
        draws = law_draws(self.model.inputs, alpha, problem.region)
        surfaces.judge(draws, self.model.noise_sd(alpha))
        return infer(problem.objective, alpha, problem.model.hyperparameters)

    def _refined(
        self, refined: Refined, surfaces: AdaptiveSurfaces, inference: Inference, level: float
    ) -> Refined:
        """Move the region to the law, run the experiments rougher than `level`, and climb."""
        problem, alpha = refined.problem, refined.found.alpha
        likely = [*likely_alphas(alpha, inference, problem.model.hyperparameters)]
        stays = refined.held or self.runner.account.refused
        better = None if stays else next_region(problem, alpha, likely)
        region = problem.region if better is None else better
        if better is not None:
            surfaces.move(moving(region))
        surfaces.separate()
        members = surfaces.wanting(level)
        if members.any():
            surfaces.sharpen(members, wide_draws(self.model.inputs, likely, region))
        tell = told(self.progress)
        if tell:
            tell(surfaces.total_runs, int(surfaces.good.sum()), surfaces.good.size)
        problem = self._problem(surfaces, region)
        return replace(refined, problem=problem, found=climbed(problem, refined.found, inference))

    def _calm(self, before: SearchResult, after: SearchResult, inference: Inference) -> bool:
        """Whether neither alpha nor the log-likelihood has moved."""
        step = (after.alpha - before.alpha)[inference.identified]
        length = float(step @ inference.information @ step)
        change = abs(after.log_likelihood - before.log_likelihood)
        return length < STILL**2 and change < max(CHANGE, 1e-3 * self.outcomes.size)


def refinement_of(
    runner: Runner,
    outcomes: Array,
    model: Model,
    full: Search,
    stage: Callable[[str], AbstractContextManager[None]],
    progress: Progress,
    ids: Sequence[str],
    fast: Fast,
) -> Refinement:
    """The way that goes with the user's choice of the propagation."""
    if model.surfaces is None:
        return Collocated(runner, outcomes, model, full, stage, progress, ids, fast)
    kind = UnderLaw if model.follows else OnRegion
    return kind(runner, outcomes, model, full, stage, progress, ids, fast)


def under_law(
    runner: Runner, model: Model, alpha: Array, progress: Progress | None = None
) -> Forward:
    """The forward problem for a law alpha (K,) that is known: no search moves it.

    With a tolerance the surfaces are exact all over the region of the law. Without one they are as
    exact under the law as an identification makes them: half the error that it begins with.
    """
    region = own_region(model.inputs, alpha)
    if model.surfaces is None:
        return forward(runner, model, region, progress)
    surfaces = surfaces_of(runner, region, model.surfaces)
    if model.follows:
        surfaces.judge(law_draws(model.inputs, alpha, region), model.noise_sd(alpha))
        draws = wide_draws(model.inputs, [alpha], region)
        surfaces.refine(draws, 0.5 * surfaces.level, told(progress))
    else:
        surfaces.refine(None, surfaces.level, told(progress))
    return forward(runner, model, region, progress, surfaces.surface())


def moving(region: Array) -> Array:
    """The rows of a region (n, 2) that have a width; the other parameters are known."""
    return region[moving_parameters(region)]


def _wanted_level(surfaces: AdaptiveSurfaces, level: float) -> float:
    """The level, or half of it and so on until a surface is too rough for it."""
    while level > FINEST and not surfaces.wanting(level).any():
        level *= 0.5
    return level


def climbed(problem: Problem, found: SearchResult, inference: Inference) -> SearchResult:
    """The nearest maximum, from the one that was found on other surfaces."""
    alpha, value = ascend(
        problem.objective, found.alpha, problem.model.hyperparameters,
        inference.identified, inference.information,
    )  # fmt: skip
    return found.moved(alpha, value)
