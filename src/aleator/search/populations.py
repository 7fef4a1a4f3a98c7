"""Searches with a population of alphas: CMA-ES, a genetic algorithm, differential evolution."""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from aleator.core.types import Array
from aleator.errors import AleatorError, InputsError
from aleator.search.interface import OPTIMA, Ascent, Optimum, SearchResult, nowhere_finite
from aleator.search.multistart import climb, evenly, starting_points
from aleator.search.objective import Coordinates, Task, TaskSearch, gathered


@dataclass(frozen=True)
class EvolutionSettings:
    """Settings of the end of a search with a population. The values are chosen by judgement."""

    polish: int = 100
    """The largest number of evaluations with score in the final gradient ascent."""
    flat: float = 1e-3
    """A run of CMA-ES ends when its last log-likelihoods differ by less than this."""


EVOLUTION = EvolutionSettings()


def first_population(
    coordinates: Coordinates, guesses: Sequence[Array], size: int, seed: int
) -> Array:
    """The first population u (size, F): the start values, the guesses, then Sobol' points."""
    known = coordinates.to_unit(np.stack([coordinates.start, *guesses]))
    missing = size - len(known)
    if missing <= 0:
        return np.asarray(known[:size])
    return np.concatenate([known, evenly(coordinates.free.size, missing, seed)])


def finished(
    task: Task, *, converged: bool, polish: bool, settings: EvolutionSettings = EVOLUTION
) -> SearchResult:
    """The result of a search: the best alpha evaluated, after a gradient ascent if `polish`.

    The search counts as one start. Raises InputsError where no log-likelihood was finite.
    """
    counted, coordinates = task.counted, task.coordinates
    if counted.best is None:
        raise nowhere_finite(task.hyperparameters, counted.evaluations)
    alpha, value = counted.best
    if polish:
        end = climb(counted, coordinates, alpha, settings.polish, [])
        if end.log_likelihood >= value:
            alpha, value, converged = end.alpha, end.log_likelihood, end.converged
    only = Ascent(coordinates.start, alpha, value, counted.evaluations, converged)
    optima = (Optimum(alpha, value, 1),)
    return SearchResult(alpha, value, (only,), optima, counted.method)


def at_least(search: str, **least: tuple[int, int]) -> None:
    """Raise InputsError for the first argument `key=(value, least)` with value below least.

    >>> at_least("genetic", population=(50, 4))
    """
    for key, (value, smallest) in least.items():
        if value < smallest:
            raise InputsError(f"{search}: {key} {value}", f"{key} must be at least {smallest}")


def needs(package: str, search: str) -> None:
    """Raise AleatorError, which says what to install, if an optional package is missing."""
    if importlib.util.find_spec(package) is None:
        raise AleatorError(
            f"{search} needs the package {package}, which is not installed",
            f"pip install {package}, or choose the gradient search",
        )


ARRIVED_BY = frozenset({"tolfun", "tolfunhist", "tolx"})
"""The names that the package cma gives to reasons for stopping that mean convergence."""


@dataclass(frozen=True)
class CMAES(TaskSearch):
    """CMA-ES (Hansen): samples from a normal law whose covariance adapts to the likelihood.

    There are `runs` independent runs: the first starts from the start values, the next from the
    guesses, the others from Sobol' points. Each takes at most `evaluations` evaluations. `step` is
    the first standard deviation in the unit cube; `population` is the number of alphas sampled at a
    time, by default 4 + 3 log F. With `polish` a gradient ascent starts from the end of each run.
    Needs the extra `evolution`.

    Cost: some hundred evaluations without score per run, in batches of one population. A run finds
    one local optimum; the search fails if none of the runs finds the best.
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
        needs("cma", "the CMA-ES search")
        at_least(
            "CMA-ES", runs=(self.runs, 1), evaluations=(self.evaluations, 1),
            population=(4 if self.population is None else self.population, 4),
        )  # fmt: skip
        if not 0.0 < self.step <= 1.0:
            raise InputsError(f"CMA-ES: step {self.step}", "step is a share of the limits: 0.2")

    @property
    def name(self) -> str:
        """The name of this search in a result."""
        return f"cmaes({self.runs})"

    def _search(self, task: Task) -> SearchResult:
        """Run CMA-ES from every start, improve each end if asked, and gather the optima."""
        rng = np.random.default_rng(task.seed)
        ascents: list[Ascent] = []
        for start in starting_points(task.coordinates, task.guesses, self.runs, task.seed):
            ascents.append(self._run(task, start, rng, len(ascents)))
        return gathered(ascents, task.counted, task.hyperparameters)

    def _run(self, task: Task, start: Array, rng: np.random.Generator, before: int) -> Ascent:
        coordinates = task.coordinates
        size = coordinates.free.size
        strategy = self._strategy(coordinates.to_unit(start), rng)
        alpha, value, count = start, task.counted.floor, 0
        while not (reasons := _quietly(strategy.stop)):
            u = np.array(_quietly(strategy.ask))
            cost = task.cost(u[:, :size])
            _quietly(strategy.tell, list(u), cost.tolist())
            count += len(u)
            best = int(np.argmin(cost))
            if -cost[best] > value:
                alpha, value = coordinates.to_alpha(u[best, :size]), -float(cost[best])
            text = f"run {before + 1} of {self.runs}, {task.counted.standing}"
            task.progress.update(text, before + min(count / self.evaluations, 1.0), self.runs)
        converged = bool(ARRIVED_BY & set(reasons))
        if value <= task.counted.floor:
            return Ascent(start, start, -np.inf, count, converged=False)
        if not self.polish:
            return Ascent(start, alpha, value, count, converged)
        end = climb(task.counted, coordinates, alpha, EVOLUTION.polish, [])
        return Ascent(start, end.alpha, end.log_likelihood, count + end.evaluations, end.converged)

    def _strategy(
        self, u: Array, rng: np.random.Generator, settings: EvolutionSettings = EVOLUTION
    ) -> Any:
        """The CMA-ES of the package cma, with a random generator of its own.

        The global random state of NumPy is not changed.
        """
        import cma

        options = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: rng.standard_normal(shape),
            "seed": np.nan,
            "tolfun": settings.flat,
            "tolfunhist": settings.flat,
            "maxfevals": self.evaluations,
            "verbose": -9,
        }
        if self.population is not None:
            options["popsize"] = self.population
        # cma does not work in one dimension; a second coordinate without effect is added.
        first = u if u.size > 1 else np.append(u, 0.5)
        return _quietly(cma.CMAEvolutionStrategy, first, self.step, options)


def _quietly(call: Any, *arguments: Any) -> Any:
    """The result of a call without its warnings, which concern only internal steps of cma."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return call(*arguments)


@dataclass(frozen=True)
class GeneticAlgorithm(TaskSearch):
    """The genetic algorithm of pymoo: tournaments, simulated binary crossover, polynomial mutation.

    The search of the paper is `GeneticAlgorithm(population=50, polish=False)`. Each of at most
    `generations` generations is evaluated in one batch. The search ends earlier, and counts as
    converged, once `patience` generations gained less than 0.01 in log-likelihood. The first
    population holds the start values, the guesses and Sobol' points. With `polish` a gradient
    ascent starts from the best alpha. Needs the extra `evolution`.

    Cost: population x generations evaluations without score. It fails where the maximum lies on a
    narrow ridge: without polish and guesses, 2,500 evaluations ended 0.03 and 0.11 (two seeds)
    below the best known log-likelihood in the example of the wet clutch, and 2.4 below it in that
    of a random fatigue limit. Raises InputsError for a population below 4 or no generations,
    AleatorError without pymoo.

    >>> GeneticAlgorithm().name
    'genetic(50)'
    """

    population: int = 50
    generations: int = 100
    patience: int = 20
    polish: bool = True

    def __post_init__(self) -> None:
        needs("pymoo", "the genetic search")
        at_least(
            "genetic search", population=(self.population, 4),
            generations=(self.generations, 1), patience=(self.patience, 1),
        )  # fmt: skip

    @property
    def name(self) -> str:
        """The name of this search in a result."""
        return f"genetic({self.population})"

    def _search(self, task: Task) -> SearchResult:
        """Let the population evolve, then improve its best alpha by a gradient ascent if asked."""
        first = first_population(task.coordinates, task.guesses, self.population, task.seed)
        evolution = _evolution(first, task.seed)
        best: list[float] = []
        converged = False
        while len(best) < self.generations and not converged:
            children = evolution.ask()
            if children is None or len(children) == 0:
                # No child differs from its parents any more.
                converged = True
                break
            children.set("F", task.cost(children.get("X"))[:, None])
            evolution.tell(infills=children)
            best.append(float(evolution.opt[0].F[0]))
            stage = f"generation {len(best)} of {self.generations}, {task.counted.standing}"
            task.progress.update(stage, len(best), self.generations)
            before = best[-1 - self.patience] if len(best) > self.patience else np.inf
            converged = before - best[-1] < OPTIMA.same_value
        return finished(task, converged=converged, polish=self.polish)


def _evolution(first: Array, seed: int) -> Any:
    """The genetic algorithm of pymoo, seeded, which is asked for one generation at a time."""
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.problem import Problem

    algorithm = GA(pop_size=len(first), sampling=first)
    cube = Problem(n_var=first.shape[1], n_obj=1, xl=0.0, xu=1.0)
    # The caller counts the generations, so that pymoo gets no limit.
    return algorithm.setup(cube, seed=seed, termination=("n_gen", np.inf), verbose=False)


@dataclass(frozen=True)
class DifferentialEvolution(TaskSearch):
    """Differential evolution (Storn and Price; SciPy's best1bin), one batch for each generation.

    There are at most `generations` generations of `population` alphas. The search has converged
    once the log-likelihoods of a population scatter by less than 0.01. The first population holds
    the start values, the guesses and Sobol' points. With `polish` a gradient ascent starts from the
    best alpha.

    Cost: population x generations evaluations without score. Where hyperparameters are strongly
    correlated it is so slow that it may not converge.
    Raises InputsError for a population below 5 or no generations.

    >>> DifferentialEvolution().name
    'differential_evolution(50)'
    """

    population: int = 50
    generations: int = 100
    polish: bool = True

    def __post_init__(self) -> None:
        at_least(
            "differential evolution", population=(self.population, 5),
            generations=(self.generations, 1),
        )  # fmt: skip

    @property
    def name(self) -> str:
        """The name of this search in a result."""
        return f"differential_evolution({self.population})"

    def _search(self, task: Task) -> SearchResult:
        """Let the population evolve, then improve its best alpha by a gradient ascent if asked."""
        done = 0

        def tell(intermediate_result: optimize.OptimizeResult) -> None:  # noqa: ARG001
            nonlocal done
            done += 1
            text = f"generation {done} of {self.generations}, {task.counted.standing}"
            task.progress.update(text, done, self.generations)

        end = optimize.differential_evolution(
            lambda u: task.cost(u.T),
            [(0.0, 1.0)] * task.coordinates.free.size,
            init=first_population(task.coordinates, task.guesses, self.population, task.seed),
            # The first population counts as a generation too.
            maxiter=self.generations - 1,
            tol=0.0,
            atol=OPTIMA.same_value,
            rng=np.random.default_rng(task.seed),
            callback=tell,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
        return finished(task, converged=bool(end.success), polish=self.polish)
