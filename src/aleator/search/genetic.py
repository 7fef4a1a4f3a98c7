"""The genetic algorithm of the paper, by pymoo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aleator.search.interface import SearchResult
from aleator.search.population import (
    ARRIVED,
    Cube,
    at_least,
    finished,
    first_population,
    needs,
)
from aleator.search.task import Task, TaskSearch
from aleator.types import Array


@dataclass(frozen=True)
class GeneticAlgorithm(TaskSearch):
    """A genetic algorithm (pymoo's): tournaments, simulated binary crossover, polynomial mutation.

    The paper's search is `GeneticAlgorithm(population=50, polish=False)`. Each of at most
    `generations` generations is valued in one batch; it ends earlier once `patience` generations
    gained less than 0.01 in log-likelihood, and only then counts as converged. The first
    population holds the hyperparameters' start, the guesses and Sobol' points. With `polish` a
    gradient ascent starts from the best. Needs the extra `evolution`.

    Cost: population x generations evaluations without score. It fails where the maximum is a
    narrow ridge: without polish and guesses, 2,500 evaluations ended 0.03 and 0.11 (two seeds)
    below the best known log-likelihood of the wet clutch, and 2.4 below that of a random fatigue
    limit. Raises InputsError for a population below 4 or no generations, AleatorError without
    pymoo.

    >>> GeneticAlgorithm().name
    'genetic(50)'
    """

    population: int = 50
    generations: int = 100
    patience: int = 20
    polish: bool = True

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        needs("pymoo", "the genetic search")
        at_least(
            "genetic search", population=(self.population, 4),
            generations=(self.generations, 1), patience=(self.patience, 1),
        )  # fmt: skip

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return f"genetic({self.population})"

    def _search(self, task: Task) -> SearchResult:
        """Let the population evolve, and polish its best."""
        cube = Cube(task.counted, task.coordinates)
        first = first_population(task.coordinates, task.guesses, self.population, task.seed)
        evolution = _evolution(first, task.seed)
        best: list[float] = []
        converged = False
        while len(best) < self.generations and not converged:
            children = evolution.ask()
            if children is None or len(children) == 0:
                # every child is a copy of its parents
                converged = True
                break
            children.set("F", cube(children.get("X"))[:, None])
            evolution.tell(infills=children)
            best.append(float(evolution.opt[0].F[0]))
            stage = f"generation {len(best)} of {self.generations}, {task.counted.standing}"
            task.progress.update(stage, len(best), self.generations)
            before = best[-1 - self.patience] if len(best) > self.patience else np.inf
            converged = before - best[-1] < ARRIVED
        return finished(task, converged=converged, polish=self.polish)


def _evolution(first: Array, seed: int) -> Any:
    """pymoo's algorithm, asked for each generation; its generator is its own, seeded."""
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.problem import Problem

    algorithm = GA(pop_size=len(first), sampling=first)
    cube = Problem(n_var=first.shape[1], n_obj=1, xl=0.0, xu=1.0)
    # the generations are counted here
    return algorithm.setup(cube, seed=seed, termination=("n_gen", np.inf), verbose=False)
