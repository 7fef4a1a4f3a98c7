"""Searches for the hyperparameters alpha with the largest log-likelihood within limits.

An `Objective` is the log-likelihood at one alpha with its score, or at many alphas without scores.
A `Search` maximizes it over the free hyperparameters. A `SearchResult` has the best alpha, the end
of the ascent from each start (`Ascent`), and the distinct optima (`Optimum`).

The modules are: `multistart`, the default, local ascents by quasi-Newton steps from several starts;
`populations`, CMA-ES, a genetic algorithm and differential evolution; `custom`, a function given by
the user; `newton`, an ascent from near a maximum with a known information matrix.
"""

from aleator.search.custom import CustomSearch
from aleator.search.interface import (
    Ascent,
    Objective,
    Optimum,
    Scored,
    Search,
    SearchResult,
    objective_of,
    wide_limits,
)
from aleator.search.multistart import GradientMultistart, WarmStart
from aleator.search.newton import ascend
from aleator.search.populations import CMAES, DifferentialEvolution, GeneticAlgorithm

__all__ = [
    "Ascent",
    "CMAES",
    "CustomSearch",
    "DifferentialEvolution",
    "GeneticAlgorithm",
    "GradientMultistart",
    "WarmStart",
    "Objective",
    "Optimum",
    "Scored",
    "Search",
    "SearchResult",
    "ascend",
    "objective_of",
    "wide_limits",
]
