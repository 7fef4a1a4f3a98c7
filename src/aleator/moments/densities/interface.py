"""What every density of the outcome offers, and the ways in which it may fail."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.errors import InputsError
from aleator.moments.densities.moments import Moments
from aleator.types import Array

Codes = NDArray[np.int64]

FAILED_SOLVE_PENALTY = 5.0
"""Subtracted from the value that a search sees where a density could not be solved.

A factor e^5 = 150 in likelihood: more than any plausible gain of a fallback over the density that
it replaces, so that the search is repelled from places where it would be guessing.
"""

SMALLEST_SD = 1e-100
"""A standard deviation not above this is no scatter: its square underflows."""

FARTHEST = 1e100
"""Outcomes farther than this many standard deviations are seen at this distance, whose square
is finite."""


@dataclass(frozen=True)
class Sensitivity:
    """Value for the search at one outcome per experiment, with its exact partial derivatives.

    `value` (N,) is log f_Y(y) inside the support and its continuation outside; each partial holds
    the other quantities fixed. `d_standardized` (N, M+1) has a column for every standardized
    moment that was given; columns 0, 1, 2 are zero because these moments are constants.
    Units: `value` is the logarithm of 1/outcome, `d_mean`, `d_sd`, `d_lower` and `d_upper` are
    1/outcome. Always finite; `status` (N,) holds `Status` codes.
    """

    value: Array
    d_mean: Array
    d_sd: Array
    d_standardized: Array
    d_lower: Array
    d_upper: Array
    status: Codes


class FittedDensity(Protocol):
    """Densities of the outcomes of N experiments, each with a status.

    An outcome y is (N,), one for each experiment, or (N, G), G for each experiment; answers have
    the shape of y.
    """

    @property
    def status(self) -> Codes:
        """(N,) `Status` codes of the fits."""

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density; -inf outside the support."""

    def pdf(self, y: ArrayLike) -> Array:
        """The density; 0 outside the support."""

    def cdf(self, y: ArrayLike) -> Array:
        """Probability of an outcome not above y."""

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,)."""


class FittedMomentDensity(FittedDensity, Protocol):
    """Densities fitted to moments."""

    def sensitivity(self, y: ArrayLike) -> Sensitivity:
        """Value for the search at y (N,) with its partial derivatives."""


class Density(Protocol):
    """A choice of density that is fitted to moments of the outcome."""

    @property
    def order(self) -> int:
        """Number of moments that the density needs."""

    @property
    def name(self) -> str:
        """Name for reports."""

    def fit(self, moments: Moments, lower: ArrayLike, upper: ArrayLike) -> FittedMomentDensity:
        """Fit N densities to the moments on the physical ranges lower, upper (N,)."""


@runtime_checkable
class NearbyDensity(Density, Protocol):
    """A density that is found sooner where those of nearby moments are known."""

    def fit_near(
        self, moments: Moments, lower: ArrayLike, upper: ArrayLike, known: Any
    ) -> FittedMomentDensity:
        """What `fit` finds, to its tolerance; `known` are densities that this choice has fitted."""


def check_moments(moments: Moments, order: int, name: str) -> None:
    """Raise InputsError where there are fewer moments than the density needs."""
    if moments.standardized.shape[1] <= order:
        given = moments.standardized.shape[1] - 1
        raise InputsError(
            f"density {name} needs {order} moments, {given} given",
            f"ask the propagation for moments up to order {order}",
        )


def by_experiment(values: ArrayLike, experiments: int, what: str) -> Array:
    """Return values as (N, G); a vector (N,) becomes (N, 1). Raise InputsError otherwise."""
    array = np.asarray(values, dtype=float)
    if array.ndim not in (1, 2) or array.shape[0] != experiments:
        raise InputsError(
            f"{what} has shape {array.shape}, expected ({experiments},) or ({experiments}, G)",
            "give one row to each experiment",
        )
    return array[:, None] if array.ndim == 1 else array


def one_per_experiment(values: ArrayLike, experiments: int, what: str) -> Array:
    """Return values as (N,). Raise InputsError where the shape differs."""
    array = np.asarray(values, dtype=float)
    if array.shape != (experiments,):
        raise InputsError(
            f"{what} has shape {array.shape}, expected ({experiments},)",
            "give one number to each experiment",
        )
    return array


def in_sds(y: Array, mean: Array, sd: Array) -> Array:
    """(y - mean)/sd, cut at FARTHEST."""
    with np.errstate(over="ignore"):
        return np.clip((y - mean) / sd, -FARTHEST, FARTHEST)


def probabilities(values: ArrayLike) -> Array:
    """Return probabilities as (P,). Raise InputsError where one is not in [0, 1]."""
    p = np.atleast_1d(np.asarray(values, dtype=float))
    if p.ndim != 1 or not np.all((p >= 0.0) & (p <= 1.0)):
        raise InputsError(
            "a probability of a quantile is not in [0, 1]", "give a vector of numbers in [0, 1]"
        )
    return p


def range_end(values: ArrayLike, experiments: int, what: str) -> Array:
    """Return an end of the physical range as (N,); one number serves all experiments."""
    array = np.asarray(values, dtype=float)
    return one_per_experiment(
        np.full(experiments, array) if array.ndim == 0 else array, experiments, what
    )
