"""What the searches by population share: the values of a population, and the end."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence

import numpy as np

from aleator.errors import AleatorError, InputsError
from aleator.search.climb import climb
from aleator.search.coordinates import Coordinates
from aleator.search.counted import CountedObjective
from aleator.search.interface import Ascent, Optimum, SearchResult
from aleator.search.limits import nowhere_finite
from aleator.search.starts import evenly
from aleator.search.task import Task
from aleator.types import Array

POLISH = 100
"""Evaluations with score that the final ascent may take."""
ARRIVED = 0.01
"""A population whose log-likelihoods, or whose gain, are below this has arrived."""


class Cube:
    """The objective in the unit cube, negative, for optimizers that minimize."""

    def __init__(self, counted: CountedObjective, coordinates: Coordinates) -> None:
        self._counted, self._coordinates = counted, coordinates

    def __call__(self, u: Array) -> Array:
        """Minus the log-likelihoods (A,) at u (A, F)."""
        return -self._counted.values(self._coordinates.to_alpha(u))


def first_population(
    coordinates: Coordinates, guesses: Sequence[Array], size: int, seed: int
) -> Array:
    """Points u (size, F): the hyperparameters' own start, the guesses, then Sobol' points."""
    known = coordinates.to_unit(np.stack([coordinates.start, *guesses]))
    missing = size - len(known)
    if missing <= 0:
        return np.asarray(known[:size])
    return np.concatenate([known, evenly(coordinates.free.size, missing, seed)])


def finished(task: Task, *, converged: bool, polish: bool) -> SearchResult:
    """The best alpha met, after a gradient ascent from there if `polish`, as one start.

    Raises InputsError where no finite log-likelihood was met.
    """
    counted, coordinates = task.counted, task.coordinates
    if counted.best is None:
        raise nowhere_finite(task.hyperparameters, counted.evaluations)
    alpha, value = counted.best
    if polish:
        end = climb(counted, coordinates, alpha, POLISH, [])
        if end.log_likelihood >= value:
            alpha, value, converged = end.alpha, end.log_likelihood, end.converged
    only = Ascent(coordinates.start, alpha, value, counted.evaluations, converged)
    optima = (Optimum(alpha, value, 1),)
    return SearchResult(alpha, value, (only,), optima, counted.trace, counted.method)


def at_least(search: str, **least: tuple[int, int]) -> None:
    """Raise InputsError for the first of `key=(value, least)` that is too small.

    >>> at_least("genetic", population=(50, 4))
    """
    for key, (value, smallest) in least.items():
        if value < smallest:
            raise InputsError(f"{search}: {key} {value}", f"{key} must be at least {smallest}")


def needs(package: str, search: str) -> None:
    """Raise AleatorError, with what to install, where an optional package is missing."""
    if importlib.util.find_spec(package) is None:
        raise AleatorError(
            f"{search} needs the package {package}, which is not installed",
            f"pip install {package}, or choose the gradient search",
        )
