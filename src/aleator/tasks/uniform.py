"""Surfaces of one exactness all over their region, or none: the answer does not move the runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from aleator.inference import diagnostics as findings
from aleator.inference.information import Inference
from aleator.likelihood.model import Model
from aleator.likelihood.problem import Problem, prepare
from aleator.progress import Progress
from aleator.search import SearchResult
from aleator.simulators import Runner
from aleator.tasks import region as focus
from aleator.types import Array

ROUNDS = 6
"""Regions that an identification may try before it takes what it has."""


@dataclass(frozen=True)
class Uniform:
    """An identification with the tolerance that the user chose, or by collocation.

    `full` is the user's search from guesses. Surfaces are built on the whole of a region, and on
    another where that fits the answer better; collocation runs the simulator where the law is, and
    needs no second round.
    """

    runner: Runner
    outcomes: Array
    model: Model
    full: Callable[[Problem, list[Array]], SearchResult]
    stage: Callable[[str], AbstractContextManager[None]]
    progress: Progress
    ids: Sequence[str]

    def search(self, seed: int) -> tuple[Problem, SearchResult]:
        """The answer on a region that fits it."""
        surfaces = self.model.surfaces is not None
        stage = "response surface" if surfaces else "preparation"
        box = self.model.inputs.box
        guess: list[Array] = []
        with self.stage(stage):
            region = focus.first_region(self.runner, self.model, self.outcomes, seed)
        for last in (*[False] * (ROUNDS - 1), True):
            with self.stage(stage):
                problem = self._prepared(region)
            if findings.unreachable(problem.likelihood).size:
                if np.array_equal(region, box) or last:
                    findings.refuse_unreachable(problem.likelihood, self.ids)
                region = focus.widened(region, box)
                continue
            found = self.full(problem, guess)
            better = None if last else focus.next_region(problem, found.alpha)
            if better is None:
                break
            region, guess = better, [found.alpha]
        return problem, found

    def hold(
        self, problem: Problem, found: SearchResult, _: Inference, intervals: Array
    ) -> tuple[Problem, SearchResult] | None:
        """The answer on surfaces that hold the laws at the ends of the intervals, or None if so."""
        region = focus.interval_region(problem, found.alpha, intervals)
        if region is None:
            return None
        with self.stage("response surface"):
            problem = self._prepared(region)
        return problem, self.full(problem, [found.alpha])

    def _prepared(self, region: Array) -> Problem:
        return prepare(self.runner, self.outcomes, self.model, region, self.progress)
