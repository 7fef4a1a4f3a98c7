"""The maximum for other data or other weights, found surely, and told whether it was reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic

import numpy as np

from aleator.inference.fit import AnyFit, Weighted
from aleator.laws.hyperparameter import LIMITS, Hyperparameter
from aleator.search.counted import FLOOR
from aleator.search.newton import ARRIVED, Summit, ascended
from aleator.search.value import LogLikelihood
from aleator.types import Array

Objective = Callable[[Array], LogLikelihood]

LEFT = 1e-2
"""What may be left to climb, in log-likelihood, where a refit counts as arrived."""
TRIALS = 7
"""Scales between nearly zero and the upper limit from which another climb may begin."""
LEAST_CURVATURE = 1e-8
"""Smallest eigenvalue of a first matrix, over the largest."""


@dataclass(frozen=True)
class Refit(Generic[AnyFit]):
    """A fit at its maximum, the `value` that was climbed there, and whether it `arrived`.

    The value is the log-likelihood, of the weighted experiments where there are weights, with log
    priors.
    """

    fit: AnyFit
    value: float
    arrived: bool


def refitted(fit: AnyFit, weights: Array | None = None) -> Refit[AnyFit]:
    """The fit at the maximum near its alpha; experiments count `weights` (N,) times.

    As `climbed`, but a scale that ends at its lower limit or near zero is tried from seven larger
    values too: the score by a standard deviation is zero at zero, whether that is the maximum or
    not, so that no climb begins there. Cost: a climb, some ten evaluations; two with such a scale.
    """
    objective: Objective = fit.objective()
    if weights is not None:
        objective = Weighted(objective, weights)
    end = _climb(fit, objective, fit.alpha, fit.inference.information)
    for k in _near_zero(fit, end.alpha):
        start = _best(objective, end.alpha, k, fit.hyperparameters[k])
        other = _climb(fit, objective, start, _outer(fit, objective(start)))
        end = other if other.value > end.value else end
    return Refit(fit.at(end.alpha), end.value, end.value > FLOOR and end.gain < LEFT)


def _climb(fit: AnyFit, objective: Objective, alpha: Array, matrix: Array) -> Summit:
    return ascended(
        objective, alpha, fit.hyperparameters, fit.inference.identified, positive(matrix), ARRIVED
    )


def _near_zero(fit: AnyFit, alpha: Array) -> list[int]:
    found = []
    for k in fit.inference.identified.tolist():
        h = fit.hyperparameters[k]
        if h.log and alpha[k] <= max(h.lower, LIMITS.nearest * h.upper):
            found.append(k)
    return found


def _best(objective: Objective, alpha: Array, k: int, h: Hyperparameter) -> Array:
    """The best of alpha with hyperparameter k at scales above zero."""
    scales = np.geomspace(max(h.lower, LIMITS.nearest * h.upper), h.upper, TRIALS + 2)[1:-1]
    trials = np.repeat(alpha[None], TRIALS, axis=0)
    trials[:, k] = scales
    values = np.array([objective(trial).total for trial in trials])
    best: Array = trials[int(np.argmax(np.where(np.isfinite(values), values, -np.inf)))]
    return best


def _outer(fit: AnyFit, found: LogLikelihood) -> Array:
    """The sum of the outer products of the scores (G, G): positive wherever it is asked."""
    assert found.scores is not None
    scores = found.scores[:, fit.inference.identified]
    return np.asarray(scores.T @ scores)


def positive(matrix: Array) -> Array:
    """The nearest matrix with its eigenvalues' absolute values, none of them near zero.

    Scaled to a unit diagonal first. An information that is not positive leads a climb nowhere.

    >>> positive(np.array([[2.0, 0.0], [0.0, -3.0]])).tolist()
    [[2.0, 0.0], [0.0, 3.0]]
    """
    if not matrix.size:
        return matrix
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where((scale > 0.0) & np.isfinite(scale), scale, 1.0)
    unit = np.nan_to_num(matrix / np.outer(scale, scale))
    values, vectors = np.linalg.eigh(0.5 * (unit + unit.T))
    size = np.abs(values)
    size = np.maximum(size, LEAST_CURVATURE * max(size.max(), 1.0))
    return np.asarray((vectors * size) @ vectors.T * np.outer(scale, scale))
