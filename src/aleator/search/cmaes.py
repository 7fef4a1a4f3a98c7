"""Covariance matrix adaptation, by cma."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from aleator.errors import InputsError
from aleator.search.climb import climb
from aleator.search.counted import FLOOR
from aleator.search.interface import Ascent, SearchResult
from aleator.search.optima import gathered
from aleator.search.population import POLISH, Cube, at_least, needs
from aleator.search.starts import starting_points
from aleator.search.task import Task, TaskSearch
from aleator.types import Array

FLAT = 1e-3
"""A run ends when its log-likelihoods have stayed within this."""
ARRIVED_BY = frozenset({"tolfun", "tolfunhist", "tolx"})
"""The reasons to stop, in the words of cma, that mean a maximum."""


@dataclass(frozen=True)
class CMAES(TaskSearch):
    """CMA-ES (Hansen): a normal distribution over alpha learns the likelihood's own covariance.

    `runs` of them, the first from the hyperparameters' start, then from the guesses, then from
    Sobol' points, each of at most `evaluations` evaluations; `step` is the first standard
    deviation in the unit cube, `population` cma's own 4 + 3 log F if None. With `polish` a gradient
    ascent starts from the end of each run. Needs the extra `evolution`.

    Cost: some hundred evaluations without score a run, in batches of one population. A run finds
    one optimum: it fails where that is not the best and `runs` is small.
    Raises InputsError for values out of range, AleatorError without cma.

    >>> CMAES(runs=2).name
    'cmaes(2)'
    """

    runs: int = 3
    evaluations: int = 1000
    population: int | None = None
    step: float = 0.2
    polish: bool = True

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        needs("cma", "the CMA-ES search")
        at_least(
            "CMA-ES", runs=(self.runs, 1), evaluations=(self.evaluations, 1),
            population=(4 if self.population is None else self.population, 4),
        )  # fmt: skip
        if not 0.0 < self.step <= 1.0:
            raise InputsError(f"CMA-ES: step {self.step}", "step is a share of the limits: 0.2")

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return f"cmaes({self.runs})"

    def _search(self, task: Task) -> SearchResult:
        """Run from every start, polish each end, and gather the distinct optima."""
        rng = np.random.default_rng(task.seed)
        ascents: list[Ascent] = []
        for start in starting_points(task.coordinates, task.guesses, self.runs, task.seed):
            ascents.append(self._run(task, start, rng, len(ascents)))
        return gathered(ascents, task.counted, task.hyperparameters)

    def _run(self, task: Task, start: Array, rng: np.random.Generator, before: int) -> Ascent:
        coordinates = task.coordinates
        cube, size = Cube(task.counted, coordinates), coordinates.free.size
        strategy = self._strategy(coordinates.to_unit(start), rng)
        alpha, value, count = start, FLOOR, 0
        while not (reasons := _quietly(strategy.stop)):
            u = np.array(_quietly(strategy.ask))
            cost = cube(u[:, :size])
            _quietly(strategy.tell, list(u), cost.tolist())
            count += len(u)
            best = int(np.argmin(cost))
            if -cost[best] > value:
                alpha, value = coordinates.to_alpha(u[best, :size]), -float(cost[best])
            text = f"run {before + 1} of {self.runs}, {task.counted.standing}"
            task.progress.update(text, before + min(count / self.evaluations, 1.0), self.runs)
        converged = bool(ARRIVED_BY & set(reasons))
        if value <= FLOOR:
            return Ascent(start, start, -np.inf, count, converged=False)
        if not self.polish:
            return Ascent(start, alpha, value, count, converged)
        end = climb(task.counted, coordinates, alpha, POLISH, [])
        return Ascent(start, end.alpha, end.log_likelihood, count + end.evaluations, end.converged)

    def _strategy(self, u: Array, rng: np.random.Generator) -> Any:
        """cma's strategy with a generator of its own, so that no global state is touched."""
        import cma

        options = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: rng.standard_normal(shape),
            "seed": np.nan,
            "tolfun": FLAT,
            "tolfunhist": FLAT,
            "maxfevals": self.evaluations,
            "verbose": -9,
        }
        if self.population is not None:
            options["popsize"] = self.population
        # it does not work in one dimension: a second one is added that changes nothing
        first = u if u.size > 1 else np.append(u, 0.5)
        return _quietly(cma.CMAEvolutionStrategy, first, self.step, options)


def _quietly(call: Any, *arguments: Any) -> Any:
    """What the call returns; its warnings concern cma's own steps, which are not the result."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return call(*arguments)
