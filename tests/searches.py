"""The searches that the tests put to the landscapes: with a polish, and without."""

from __future__ import annotations

import pytest
from scipy import optimize

from aleator.core.types import Array
from aleator.search import (
    CMAES,
    CustomSearch,
    DifferentialEvolution,
    GeneticAlgorithm,
    GradientMultistart,
)


def simplex(value, lower, upper, start, rng) -> Array:  # noqa: ARG001
    bounds = optimize.Bounds(lower, upper)
    options = {"xatol": 1e-10, "fatol": 1e-12, "maxfev": 4000, "maxiter": 4000}
    cost = lambda alpha: -value(alpha)  # noqa: E731
    return optimize.minimize(cost, start, method="Nelder-Mead", bounds=bounds, options=options).x


GENETIC = GeneticAlgorithm(population=40, generations=60, patience=15)
DIFFERENTIAL = DifferentialEvolution(population=40)
CMA = CMAES(runs=3)
POPULATIONS = [GENETIC, DIFFERENTIAL, CMA]
ALL = [GradientMultistart(6, evaluations=200), *POPULATIONS, CustomSearch(simplex)]
PLAIN = [
    GeneticAlgorithm(population=50, polish=False),
    DifferentialEvolution(polish=False),
    CMAES(polish=False),
    CustomSearch(simplex, polish=False),
]


def named(search) -> str:
    return search.name if getattr(search, "polish", True) else f"{search.name} plain"


def each(searches):
    return pytest.mark.parametrize("search", searches, ids=named)
