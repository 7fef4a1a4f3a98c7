"""How far the estimates would move if the density were exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.inference.verification.choice import Score
from aleator.types import Array

SMALLEST = 1e-8
"""Least eigenvalue of the scores' correlation matrix that still tells a direction."""


@dataclass(frozen=True)
class Movement:
    """One step of Fisher scoring (F,) from the estimate, and its Monte Carlo error (F,).

    Both in standard errors of the estimate.
    """

    step: Array
    error: Array


def movement(score: Score, free: NDArray[np.intp], standard_error: Array) -> Movement | None:
    """The step J^-1 s of the checked score s = sum s_l, with J = sum s_l s_l'.

    J is the information by outer products (Berndt, Hall, Hall and Hausman, 1974) of the same
    scores. Where the density that was identified with is far off, its observed information is too:
    on stochastic frontiers a step of 2.5 where the maximum was 1.1 standard errors away, and 0.9
    by outer products. None where J is not of full rank or a standard error (K,) is not known.
    A step tells sign and size of a small movement, and of a large one only that it is large.

    >>> scores = np.array([[1.0], [-1.0], [1.0], [0.0]])
    >>> found = movement(Score(scores, np.zeros((1, 1))), np.array([0]), np.array([0.5]))
    >>> found.step.round(6).tolist()
    [0.666667]
    """
    each, scale = score.each[:, free], standard_error[free]
    outer = each.T @ each
    size = np.sqrt(np.diag(outer))
    if not free.size or not np.all(np.isfinite(scale) & (size > 0.0)):
        return None
    if np.linalg.eigvalsh(outer / np.outer(size, size))[0] < SMALLEST:
        return None
    inverse = np.linalg.inv(outer)
    variance = np.diag(inverse @ score.covariance[np.ix_(free, free)] @ inverse)
    step = inverse @ each.sum(axis=0)
    return Movement(step / scale, np.sqrt(np.maximum(variance, 0.0)) / scale)
