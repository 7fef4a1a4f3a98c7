"""Differential evolution, by SciPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from aleator.laws import Hyperparameter
from aleator.progress import Progress, Silent
from aleator.search.coordinates import Coordinates
from aleator.search.interface import Objective, Scored, SearchResult
from aleator.search.optima import only_point
from aleator.search.population import ARRIVED, Cube, at_least, finished, first_population
from aleator.search.watched import Watched

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DifferentialEvolution:
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

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Let the population evolve, and polish its best."""
        told = progress or Silent()
        coordinates, watched = Coordinates(hyperparameters), Watched(objective, self.name)
        if coordinates.free.size == 0:
            return only_point(watched, coordinates, hyperparameters)
        cube = Cube(watched, coordinates)
        done = 0

        def tell(intermediate_result: optimize.OptimizeResult) -> None:  # noqa: ARG001
            nonlocal done
            done += 1
            text = f"generation {done} of {self.generations}, {watched.standing}"
            told.update(text, done, self.generations)

        end = optimize.differential_evolution(
            lambda u: cube(u.T),
            [(0.0, 1.0)] * coordinates.free.size,
            init=first_population(coordinates, guesses, self.population, seed),
            # the first population is a generation too
            maxiter=self.generations - 1,
            tol=0.0,
            atol=ARRIVED,
            rng=np.random.default_rng(seed),
            callback=tell,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
        return finished(
            watched, coordinates, hyperparameters, converged=bool(end.success), polish=self.polish
        )
