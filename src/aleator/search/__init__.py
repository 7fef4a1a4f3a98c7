"""Searches for the alpha of largest log-likelihood: one interface, one file each."""

from aleator.search.gradient import GradientMultistart
from aleator.search.interface import Ascent, Objective, Optimum, Search, SearchResult
from aleator.search.newton import ascend

__all__ = [
    "Ascent",
    "GradientMultistart",
    "Objective",
    "Optimum",
    "Search",
    "SearchResult",
    "ascend",
]
