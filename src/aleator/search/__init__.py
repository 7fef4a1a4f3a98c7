"""Searches for the alpha of largest log-likelihood within limits.

Three nouns: an `Objective` is the log-likelihood at one alpha with its score, or at many without; a
`Search` maximizes it over the free hyperparameters; a `SearchResult` has the best alpha, what each
start came to (`Ascent`), and the distinct optima (`Optimum`).

`multistart` climbs by quasi-Newton steps and is the default, `populations` are CMA-ES, a genetic
algorithm and differential evolution, `custom` is a function of the user's; `newton` climbs from
near a maximum, with an information matrix.
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
