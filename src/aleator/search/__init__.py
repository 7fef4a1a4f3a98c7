"""Searches for the alpha of largest log-likelihood: one interface, one file each."""

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
from aleator.search.newton import ascend

__all__ = [
    "Ascent",
    "GradientMultistart",
    "Objective",
    "Optimum",
    "Scored",
    "Search",
    "SearchResult",
    "Step",
    "ascend",
    "objective_of",
]
