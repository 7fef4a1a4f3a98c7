"""Differential evolution, by SciPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from aleator.search.interface import SearchResult
from aleator.search.population import ARRIVED, Cube, at_least, finished, first_population
from aleator.search.task import Task, TaskSearch


@dataclass(frozen=True)
class DifferentialEvolution(TaskSearch):
    """Differential evolution (Storn and Price; SciPy's best1bin), a generation in one batch.

    At most `generations` generations of `population` alphas; it has converged once the
    log-likelihoods of the population scatter by less than 0.01. The first population holds the
    hyperparameters' start, the guesses and Sobol' points. With `polish` a gradient ascent starts
    from the best.

    Cost: population x generations evaluations without score. It fails, slowly rather than wrongly,
    where hyperparameters are strongly correlated.
    Raises InputsError for a population below 5 or no generations.

    >>> DifferentialEvolution().name
    'differential_evolution(50)'
    """

    population: int = 50
    generations: int = 100
    polish: bool = True

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        at_least(
            "differential evolution", population=(self.population, 5),
            generations=(self.generations, 1),
        )  # fmt: skip

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return f"differential_evolution({self.population})"

    def _search(self, task: Task) -> SearchResult:
        """Let the population evolve, and polish its best."""
        cube = Cube(task.counted, task.coordinates)
        done = 0

        def tell(intermediate_result: optimize.OptimizeResult) -> None:  # noqa: ARG001
            nonlocal done
            done += 1
            text = f"generation {done} of {self.generations}, {task.counted.standing}"
            task.progress.update(text, done, self.generations)

        end = optimize.differential_evolution(
            lambda u: cube(u.T),
            [(0.0, 1.0)] * task.coordinates.free.size,
            init=first_population(task.coordinates, task.guesses, self.population, task.seed),
            # the first population is a generation too
            maxiter=self.generations - 1,
            tol=0.0,
            atol=ARRIVED,
            rng=np.random.default_rng(task.seed),
            callback=tell,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
        return finished(task, converged=bool(end.success), polish=self.polish)
