"""Quasi-Newton ascent that starts from a known information matrix, near a maximum."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search.counted import CountedObjective
from aleator.search.interface import Objective, Scored
from aleator.types import Array, Flags, Indices

ARRIVED = 1e-5
"""Stop when this close to the maximum, in log-likelihood (0.5 g' H^-1 g)."""
STEPS = 40


@dataclass(frozen=True)
class Summit:
    """Where an ascent ended: `alpha` (K,), its `value` and `score` (K,).

    `information` (F, F) is what the steps taught of the curvature over what moved, and `gain`
    what is left to climb by it.
    """

    alpha: Array
    value: float
    score: Array
    information: Array
    gain: float


def ascend(
    objective: Objective | Scored,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    moving: Indices,
    information: Array,
) -> tuple[Array, float]:
    """Climb over the `moving` (F,) hyperparameters within their limits; return alpha and value."""
    end = ascended(objective, alpha, hyperparameters, moving, information)
    return end.alpha, end.value


def ascended(
    objective: Objective | Scored,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    moving: Indices,
    information: Array,
    arrived: float = ARRIVED,
) -> Summit:
    """Climb over the `moving` (F,) hyperparameters until `arrived` is all that is left to gain.

    BFGS whose first matrix is the given information (F, F), with an active set for the limits
    and a backtracking line search. WarmStart a maximum it needs two to six evaluations, where a
    method that has to learn the curvature needs twenty. It never returns a smaller value than
    that of the alpha given; it ends, without an error, when no step gains.
    """
    lower, upper = limits_of(hyperparameters, moving)
    matrix = information.copy()
    point = alpha[moving]
    counted = CountedObjective(objective)

    def at(x: Array) -> tuple[float, Array]:
        full = alpha.copy()
        full[moving] = x
        result = counted(full)
        return result.total, result.score

    value, whole = at(point)
    gain = 0.0
    for _ in range(STEPS):
        score = whole[moving]
        step = _newton_step(matrix, score, ~held(point, score, lower, upper))
        gain = 0.5 * float(score @ step)
        if gain < arrived:
            break
        moved = _line_search(at, point, value, 2.0 * gain, step, lower, upper)
        if moved is None:
            break
        new_point, new_value, new_whole = moved
        matrix = _updated(matrix, new_point - point, score - new_whole[moving])
        point, value, whole = new_point, new_value, new_whole
    end = alpha.copy()
    end[moving] = point
    return Summit(end, value, whole, matrix, gain)


def held(point: Array, score: Array, lower: Array, upper: Array) -> Flags:
    """Which of the values (F,) stay on a limit, as their score (F,) leads beyond it.

    >>> held(np.array([0.0, 0.0]), np.array([-1.0, 1.0]), np.zeros(2), np.ones(2)).tolist()
    [True, False]
    """
    return np.asarray(((point <= lower) & (score < 0.0)) | ((point >= upper) & (score > 0.0)))


def _newton_step(matrix: Array, score: Array, free: Flags) -> Array:
    step = np.zeros_like(score)
    if np.any(free):
        # least squares: a hyperparameter without effect makes the matrix singular
        step[free] = np.linalg.lstsq(matrix[np.ix_(free, free)], score[free])[0]
    return step


def _line_search(
    at: Callable[[Array], tuple[float, Array]],
    point: Array,
    value: float,
    gain: float,
    step: Array,
    lower: Array,
    upper: Array,
) -> tuple[Array, float, Array] | None:
    length = 1.0
    for _ in range(12):
        trial = np.clip(point + length * step, lower, upper)
        trial_value, trial_score = at(trial)
        if trial_value >= value + 1e-4 * length * gain:
            return trial, trial_value, trial_score
        length *= 0.4
    return None


def _updated(matrix: Array, s: Array, y: Array) -> Array:
    """BFGS update of the information with step s and change y = -(change of the score)."""
    sy, ms = float(s @ y), matrix @ s
    sms = float(s @ ms)
    if sms <= 0.0:
        return matrix
    if sy < 0.2 * sms:
        # Powell's damping keeps the matrix positive definite
        theta = 0.8 * sms / (sms - sy)
        y = theta * y + (1.0 - theta) * ms
        sy = float(s @ y)
    return np.asarray(matrix - np.outer(ms, ms) / sms + np.outer(y, y) / sy)
