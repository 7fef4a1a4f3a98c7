"""The way by surfaces that are exact where the law has its mass."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from aleator.inference.information import Inference, infer
from aleator.likelihood.problem import told
from aleator.search import SearchResult, WarmStart
from aleator.search.interface import SAME_VALUE
from aleator.surrogates import AdaptiveSurfaces
from aleator.tasks.likely import interval_alphas, law_draws, likely_alphas, wide_draws
from aleator.tasks.many import of_many
from aleator.tasks.refinement.interface import (
    FINEST,
    SEARCH,
    SURFACE,
    Refined,
    Refinement,
    climbed,
    moving,
)
from aleator.tasks.region import interval_region, next_region
from aleator.types import Array

STILL = 0.1
"""A step of alpha, in the metric of the information (no hyperparameter moves more, in its standard
errors), that is none."""
CHANGE = 0.2
"""A change of the log-likelihood that is none; a thousandth an experiment if that is more."""
ROUNDS = 24
"""Rounds after which the answer is taken as it is."""


@dataclass(frozen=True)
class UnderLaw(Refinement):
    """Surfaces exact where the law has its mass, and no more exact than the answer needs."""

    def search(self, seed: int) -> Refined:
        """The answer that further runs do not move."""
        with self.stage(SURFACE):
            surfaces, problem = self._first(seed)
        runs = surfaces.total_runs
        return self._settled(Refined(problem, self.full(problem, []), surfaces), surfaces, runs)

    def hold(self, refined: Refined, inference: Inference, intervals: Array) -> Refined | None:
        """The answer on surfaces exact enough for the laws at the ends of the intervals too."""
        problem, alpha, surfaces = refined.problem, refined.found.alpha, refined.surfaces
        assert surfaces is not None
        wider = interval_region(problem, alpha, intervals, generous=False)
        region = problem.region if wider is None else wider
        inputs = self.model.inputs
        ends = interval_alphas(alpha, inference, intervals, problem.model.hyperparameters)
        draws = [law_draws(inputs, one, region) for one in (alpha, *ends)]
        with self.stage(SURFACE):
            if wider is not None:
                surfaces.move(moving(region))
            surfaces.judge(np.concatenate(draws))
            members = surfaces.wanting(2.0 * surfaces.level)
            if wider is None and not members.any():
                return None
            if members.any():
                surfaces.sharpen(members, np.concatenate(draws))
            surfaces.judge(draws[0])
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
        surfaces.judge(draws)
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


def _wanted_level(surfaces: AdaptiveSurfaces, level: float) -> float:
    """The level, or half of it and so on until a surface is too rough for it."""
    while level > FINEST and not surfaces.wanting(level).any():
        level *= 0.5
    return level
