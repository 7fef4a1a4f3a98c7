"""Quasi-Newton ascent that starts from a known information matrix, near a maximum."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array, Flags, Indices
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search.interface import LogLikelihood, Objective, Scored
from aleator.search.objective import CountedObjective


@dataclass(frozen=True)
class AscentSettings:
    """Steps of a quasi-Newton ascent, their lengths and their end; by judgement."""

    arrived: float = 1e-5
    """It ends when this close to the maximum, in log-likelihood (0.5 g' H^-1 g)."""
    steps: int = 40
    """The most steps."""
    believed: float = 1.0
    """A step with a larger predicted gain goes no farther than the objective's reach."""
    tries: int = 12
    """The most lengths of a step that are tried."""
    doubted: int = 4
    """The same of a step by a matrix that outer products of scores can replace."""
    experiments: int = 5
    """Experiments for each hyperparameter from which on outer products of scores give a
    curvature."""
    rise: float = 1e-4
    """Share of the gain by the slope that a step must bring (Armijo)."""
    shorter: float = 0.4
    """Length of the next step that is tried, over that of the last."""
    damped: float = 0.2
    """Share of the curvature of the matrix below which a step's own is raised (Powell)."""
    curvature: float = 1e-6
    """The least eigenvalue of an information matrix, in units of its diagonal."""
    smallest: float = 1e-300
    """The least entry of the diagonal, which a hyperparameter without effect has."""


ASCENT = AscentSettings()


@dataclass(frozen=True)
class Summit:
    """Where an ascent ended: `alpha` (K,), its `value` and `scores` (N, K).

    `information` (F, F) of the hyperparameters that moved is what the steps have taught, and `gain`
    is what is left to climb by it.
    """

    alpha: Array
    value: float
    scores: Array
    information: Array
    gain: float

    @property
    def score(self) -> Array:
        """The sum of the scores, (K,)."""
        return np.asarray(self.scores.sum(axis=0))

    def outer(self, rows: Indices) -> Array:
        """The information (F, F) about these hyperparameters by outer products of scores."""
        return outer(self.scores[:, rows])


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
    arrived: float = ASCENT.arrived,
    *,
    bent: bool = False,
    settings: AscentSettings = ASCENT,
) -> Summit:
    """Climb over the `moving` (F,) hyperparameters until `arrived` is all that is left to gain.

    BFGS whose first matrix is the given information (F, F), with an active set for the limits
    and a backtracking line search. Where a ridge may be `bent` and a step gains nothing, the outer
    products of the scores of the experiments take the matrix's place (Berndt et al. 1974): what
    was learned behind the bend leads away from the ridge; and no step is tried that is too short
    to gain `arrived`. From near a maximum it needs two to
    six evaluations, where a method that has to learn the curvature needs twenty. It never returns
    a smaller value than that of the alpha given; it ends, without an error, when no step gains.
    """
    lower, upper = limits_of(hyperparameters, moving)
    matrix, point = information.copy(), alpha[moving]
    counted = CountedObjective(objective)

    def whole(x: Array) -> Array:
        full = alpha.copy()
        full[moving] = x
        return full

    def at(x: Array) -> LogLikelihood:
        return counted(whole(x))

    here, gain = at(point), 0.0
    # the outer products of a small number of experiments say little: then there is no other matrix
    another = bent and len(here.each) > settings.experiments * moving.size
    least = arrived if bent else 0.0
    doubted = another
    for _ in range(settings.steps):
        score = here.score[moving]
        free = ~on_limits(point, score, lower, upper)
        step = _newton_step(matrix, score, free)
        if score @ step < 0.0:
            # a matrix that is not positive definite leads downhill
            assert here.scores is not None
            matrix = outer(here.scores[:, moving])
            step = _newton_step(matrix, score, free)
        gain = 0.5 * float(score @ step)
        if gain < arrived:
            break
        if gain > settings.believed:
            step *= counted.reach(whole(point), whole(np.clip(point + step, lower, upper)))
        tries, rise = settings.doubted if doubted else settings.tries, float(score @ step)
        moved = _line_search(
            at, point, here.total, rise, step, lower, upper, tries, least, settings
        )
        if moved is None:
            if not doubted:
                break
            assert here.scores is not None
            matrix, doubted = outer(here.scores[:, moving]), False
            continue
        new_point, there = moved
        matrix = _updated(matrix, new_point - point, score - there.score[moving], settings)
        point, here, doubted = new_point, there, another
    assert here.scores is not None
    return Summit(whole(point), here.total, here.scores, matrix, gain)


def positive(matrix: Array, settings: AscentSettings = ASCENT) -> Array:
    """The matrix with its eigenvalues, in units of its diagonal, raised to a least one."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), settings.smallest))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    raised = (vectors * np.maximum(values, settings.curvature)) @ vectors.T
    return np.asarray(raised * np.outer(scale, scale))


def outer(scores: Array) -> Array:
    """The information (F, F) by outer products of the scores (N, F) of the experiments.

    >>> outer(np.array([[2.0, 0.0], [0.0, 3.0]])).tolist()
    [[4.0, 0.0], [0.0, 9.0]]
    """
    finite = np.nan_to_num(scores)
    return positive(finite.T @ finite)


def on_limits(point: Array, score: Array, lower: Array, upper: Array) -> Flags:
    """Which of the values (F,) stay on a limit, as their score (F,) leads beyond it.

    >>> on_limits(np.array([0.0, 0.0]), np.array([-1.0, 1.0]), np.zeros(2), np.ones(2)).tolist()
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
    at: Callable[[Array], LogLikelihood],
    point: Array,
    value: float,
    gain: float,
    step: Array,
    lower: Array,
    upper: Array,
    tries: int,
    least: float,
    settings: AscentSettings = ASCENT,
) -> tuple[Array, LogLikelihood] | None:
    """The first of ever shorter steps that gains, but for those that cannot gain `least`.

    `gain` is the slope along the step: where the likelihood bends down, none gains more than that.
    """
    length, before = 1.0, point
    for _ in range(tries):
        if length * gain < least:
            break
        trial = np.clip(point + length * step, lower, upper)
        if not np.array_equal(trial, before):
            found = at(trial)
            if found.total >= value + settings.rise * length * gain:
                return trial, found
            before = trial
        length *= settings.shorter
    return None


def _updated(matrix: Array, s: Array, y: Array, settings: AscentSettings = ASCENT) -> Array:
    """BFGS update of the information with step s and change y = -(change of the score)."""
    sy, ms = float(s @ y), matrix @ s
    sms = float(s @ ms)
    if sms <= 0.0:
        return matrix
    if sy < settings.damped * sms:
        # Powell's damping keeps the matrix positive definite
        theta = (1.0 - settings.damped) * sms / (sms - sy)
        y = theta * y + (1.0 - theta) * ms
        sy = float(s @ y)
    return np.asarray(matrix - np.outer(ms, ms) / sms + np.outer(y, y) / sy)
