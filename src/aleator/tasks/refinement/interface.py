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

import numpy as np

from aleator.inference import diagnostics
from aleator.inference.information import Inference
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem, prepare, told
from aleator.progress import Progress
from aleator.search import SearchResult, ascend
from aleator.simulators import Runner
from aleator.surrogates import AdaptiveSurfaces, Surface, surfaces_of
from aleator.surrogates.responses import attempts, moving_parameters
from aleator.tasks.refinement.reach import REACH, by_surface, holding, reached, sharpened, support
from aleator.tasks.region import first_region
from aleator.types import Array

Search = Callable[[Problem, list[Array]], SearchResult]

SURFACE, SEARCH = "response surface", "search"
"""What the rounds and searches are called in the account of runs and seconds."""
FINEST = 1e-3
"""Estimated error of a surface, over the scatter, below which no error can matter to an answer."""


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

    `full` is the user's search from guesses; `stage` accounts for runs and seconds.
    """

    runner: Runner
    outcomes: Array
    model: Model
    full: Search
    stage: Callable[[str], AbstractContextManager[None]]
    progress: Progress
    ids: Sequence[str]

    @abstractmethod
    def search(self, seed: int) -> Refined:
        """The answer that further runs do not move."""

    def sharpened(self, refined: Refined, draws: Mapping[int, Array]) -> Refined:
        """The answer with a round of runs for some conditions, each where its own draws lie."""
        surfaces = refined.surfaces
        assert surfaces is not None
        with self.stage(SURFACE):
            for condition, some in draws.items():
                surfaces.sharpen(np.arange(surfaces.good.size) == condition, some)
            problem = self._problem(surfaces, refined.problem.region)
        return replace(refined, problem=problem, found=self.full(problem, [refined.found.alpha]))

    @abstractmethod
    def hold(self, refined: Refined, inference: Inference, intervals: Array) -> Refined | None:
        """The answer on surfaces that hold the laws at the ends of the intervals, or None if so."""

    def _problem(self, surfaces: AdaptiveSurfaces, region: Array) -> Problem:
        """The likelihood, on a region where every outcome that the simulator reaches lies in reach.

        Those that a surface still misses by its own error are left to later rounds, and all where a
        budget does not have the runs by which one is sought. Raises
        ExperimentsError for an outcome that the simulator itself does not reach.
        """
        inputs = self.model.inputs
        for _ in range(REACH.rounds):
            problem = self._on(surfaces, region)
            short = diagnostics.shortfalls(problem)
            lost = np.flatnonzero(short)
            most = REACH.most(len(moving_parameters(region)))
            if not lost.size or self.runner.account.given(most) < most:
                return problem
            farthest = int(lost[np.argmax(np.abs(short[lost]))])
            condition, side = int(problem.condition[farthest]), float(np.sign(short[farthest]))
            points, values = by_surface(surfaces, condition)
            x = reached(
                attempts(self.runner, region), points[np.argmax(side * values)], condition,
                float(problem.outcomes[farthest]), side, support(inputs)[moving_parameters(region)],
            )  # fmt: skip
            if x is None:
                raise diagnostics.unreachable(problem, self.ids)
            wider = holding(region, x, inputs.box)
            if not np.array_equal(wider, region):
                region = wider
                surfaces.move(moving(region))
            elif not sharpened(surfaces, problem.condition[lost], problem.outcomes[lost]):
                return problem
        return self._on(surfaces, region)

    def _on(self, surfaces: AdaptiveSurfaces, region: Array) -> Problem:
        """The likelihood on a region, by surfaces that are exact all over it if so chosen."""
        if not self.model.follows:
            surfaces.refine(None, surfaces.level, told(self.progress))
        return self._prepared(region, surfaces.surface())

    def _prepared(self, region: Array, surface: Surface | None) -> Problem:
        return prepare(self.runner, self.outcomes, self.model, region, self.progress, surface)

    def _first(self, seed: int) -> tuple[AdaptiveSurfaces, Problem]:
        """First surfaces, and the likelihood that they give."""
        choice = self.model.surfaces
        assert choice is not None
        region = first_region(self.runner, self.model, self.outcomes, seed)
        surfaces = surfaces_of(self.runner, region, choice)
        return surfaces, self._problem(surfaces, region)


def moving(region: Array) -> Array:
    """The rows of a region (n, 2) that have a width; the other parameters are known."""
    return region[moving_parameters(region)]


def climbed(problem: Problem, found: SearchResult, inference: Inference) -> SearchResult:
    """The nearest maximum, from the one that was found on other surfaces."""
    alpha, value = ascend(
        problem.objective, found.alpha, problem.model.hyperparameters,
        inference.identified, inference.information,
    )  # fmt: skip
    return found.moved(alpha, value)
