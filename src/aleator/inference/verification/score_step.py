"""How far the estimates would move if the density were exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.inference.verification.choice import Score
from aleator.likelihood.scoring import scoring_step
from aleator.types import Array


@dataclass(frozen=True)
class Movement:
    """One step of Fisher scoring (F,) from the estimate, and its Monte Carlo error (F,).

    Both in standard errors of the estimate.
    """

    step: Array
    error: Array


def movement(
    score: Score,
    free: NDArray[np.intp],
    standard_error: Array,
    prior: Array | None = None,
    covariance: Array | None = None,
) -> Movement | None:
    """The scoring step of the checked scores in the hyperparameters `free` (F,).

    Where the density that was identified with is far off, its observed information is too: on
    stochastic frontiers a step of 2.5 where the maximum was 1.1 standard errors away, and 0.9 by
    outer products. Where few experiments leave these products small, their step is too long: with
    the `covariance` (F, F) of the estimates the shorter of both steps is taken. The score (K,) of a
    `prior` adds to theirs. None where no step is to be had or a standard error (K,) is not known.

    >>> scores = np.array([[1.0], [-1.0], [1.0], [0.0]])
    >>> found = movement(Score(scores, np.zeros((1, 1))), np.array([0]), np.array([0.5]))
    >>> found.step.round(6).tolist()
    [0.666667]
    """
    scale = standard_error[free]
    found = scoring_step(score.each[:, free], None if prior is None else prior[free])
    if found is None or not np.all(np.isfinite(scale)):
        return None
    variance = np.diag(found.inverse @ score.covariance[np.ix_(free, free)] @ found.inverse)
    step = found.step
    if covariance is not None:
        whole = score.value if prior is None else score.value + prior
        observed = covariance @ whole[free]
        step = np.where(np.abs(observed) < np.abs(step), observed, step)
    return Movement(step / scale, np.sqrt(np.maximum(variance, 0.0)) / scale)
