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
FEW, LEAST, ALONE, FEWEST = 20, 16, 1024, 64
"""Runs an experiment: with surfaces, fewest with them, without, and fewest without."""


@dataclass(frozen=True)
class MonteCarlo:
    """The user's choice of the check: `samples` simulator runs an experiment (0: no check).

    None is up to 20 where response surfaces stand for the simulator, which these runs only
    correct: 2 where they expect hardly an error of themselves; and 1024 where none do. Experiments
    of equal conditions share theirs: eight of them at most pay. An experiment that the check cannot
    judge so takes 256 more, one in 64 experiments at most.
    Without surfaces the runs are spread over eight shifted copies of a Sobol' point set, rounded
    up to eight times a power of two, 64 at least, and an experiment far out takes as many again.
    Raises InputsError for a number of samples between 1 and 15.

    >>> MonteCarlo().near, MonteCarlo(samples=1000).points  # of each copy: 8 * 128 = 1024 runs
    (20, 128)
    """

    samples: int | None = None

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.samples is not None and self.samples != 0 and self.samples < LEAST:
            raise InputsError(
                f"verification: samples {self.samples}", f"use 0 (off) or at least {LEAST}"
            )

    @property
    def wanted(self) -> bool:
        """Whether there is a check."""
        return self.samples != 0

    @property
    def near(self) -> int:
        """Runs an experiment that correct surfaces, an even number."""
        return 2 * math.ceil((FEW if self.samples is None else self.samples) / 2)

    @property
    def points(self) -> int:
        """Points of each of the eight copies without surfaces, a power of two."""
        samples = ALONE if self.samples is None else max(self.samples, FEWEST)
        return 1 << math.ceil(math.log2(samples / REPLICATES))


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
    hardly a sample falls, and neither value nor error means much; `reached` (N,) are the
    experiments that are judged, `total` and `standard_error` of their sum. `scatter` (N,) is the
    standard deviation of the noise-free outcome under the law, `surface_error` (N,) the
    root-mean-square error of the emulator at the runs, both in units of the outcome and the latter
    NaN without one; `near_error` (N,) is the largest where the emulator or the simulator is near
    the measured outcome, NaN without a run there. `contradicted` (N,) are experiments of which the
    error is so large that their runs say nothing of the density that the emulator has.
    `score` is None where it was not asked for or could not be told.
    """

    each: Array
    each_error: Array
    effective: Array
    reached: NDArray[np.bool_]
    total: float
    standard_error: float
    scatter: Array
    surface_error: Array
    near_error: Array
    contradicted: NDArray[np.bool_]
    score: Score | None = None
