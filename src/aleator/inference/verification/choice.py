"""What is asked of the check, and what it answers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.types import Array

REPLICATES = 8
"""Independently shifted copies of the points; their scatter gives the standard error."""


@dataclass(frozen=True)
class MonteCarlo:
    """The user's choice of the check: `samples` simulator runs an experiment (0: no check).

    They are spread over eight shifted copies of a Sobol' point set, and rounded up to eight times
    a power of two. An experiment far out under the law takes as many again. Raises InputsError for
    a number of samples between 1 and 49: a density needs more.

    >>> MonteCarlo(samples=1000).points  # of each copy: 8 * 128 = 1024 runs an experiment
    128
    """

    samples: int = 1024

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.samples != 0 and self.samples < 50:
            raise InputsError(f"verification: samples {self.samples}", "use 0 (off) or at least 50")

    @property
    def points(self) -> int:
        """Points of each of the eight copies, a power of two."""
        return 1 << math.ceil(math.log2(max(self.samples, 1) / REPLICATES))


@dataclass(frozen=True)
class Score:
    """Derivative of the checked log-likelihood by alpha, estimated by Monte Carlo.

    `each` (N, K) of every experiment, and `covariance` (K, K) of the error of their sum; zero
    where no step was given.
    """

    each: Array
    covariance: Array

    @property
    def value(self) -> Array:
        """(K,) of all experiments together."""
        return np.asarray(self.each.sum(axis=0))


@dataclass(frozen=True)
class Verification:
    """Monte Carlo log-likelihood at one alpha.

    `each` (N,) log-densities and `each_error` (N,) their standard errors; `effective` (N,) the
    number of samples that count, (sum t)^2/sum t^2: where it is below ten the outcome lies where
    hardly a sample falls, and neither value nor error means much; `reached` (N,) are the other
    experiments, `total` and `standard_error` of their sum; `outcomes` (N, S) of the simulator,
    noise-free, NaN where a run failed; `x` (N, S, n), drawn from the law.
    `score` is None where it was not asked for or could not be told.
    """

    each: Array
    each_error: Array
    effective: Array
    reached: NDArray[np.bool_]
    total: float
    standard_error: float
    outcomes: Array
    x: Array
    score: Score | None = None
