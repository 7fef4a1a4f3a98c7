"""Searches for the alpha of largest log-likelihood: one interface, one file each."""

from aleator.search.custom import CustomSearch, Trial, compare
from aleator.search.interface import (
    Ascent,
    Objective,
    Optimum,
    Scored,
    Search,
    SearchResult,
    Step,
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
    "Step",
    "Trial",
    "ascend",
    "compare",
    "objective_of",
    "wide_limits",
]
