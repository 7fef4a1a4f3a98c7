"""Searches for the alpha of largest log-likelihood: one interface, one file each."""

from aleator.search.cmaes import CMAES
from aleator.search.comparison import Trial, compare
from aleator.search.custom import CustomSearch
from aleator.search.differential import DifferentialEvolution
from aleator.search.genetic import GeneticAlgorithm
from aleator.search.gradient import GradientMultistart
from aleator.search.interface import (
    Ascent,
    Objective,
    Optimum,
    Scored,
    Search,
    SearchResult,
    Step,
    objective_of,
)
from aleator.search.limits import wide_limits
from aleator.search.newton import ascend
from aleator.search.warm_start import WarmStart

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
