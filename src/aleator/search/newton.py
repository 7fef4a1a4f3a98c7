"""A quasi-Newton ascent from near a maximum, which starts with a known information matrix."""

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
    """Settings of the quasi-Newton ascent. The values are chosen by judgement."""

    arrived: float = 1e-5
    """The ascent ends when the predicted gain in log-likelihood that is left, 0.5 g' H^-1 g, is
    below this."""
    steps: int = 40
    """The largest number of steps."""
    believed: float = 1.0
    """A step with a larger predicted gain than this is shortened to the length that the objective
    allows (see `Reaching`)."""
    tries: int = 12
    """The largest number of lengths of one step that are tried."""
    doubted: int = 4
    """The largest number of lengths of one step that are tried if the matrix that gave the step can
    still be replaced by outer products of scores."""
    experiments: int = 5
    """Outer products of scores can replace the information matrix if there are more than this many
    experiments for each hyperparameter."""
    rise: float = 1e-4
    """The share of the gain predicted by the slope that a step must at least bring (Armijo)."""
    shorter: float = 0.4
    """Ratio of the next length of a step that is tried to the last."""
    damped: float = 0.2
    """If the curvature along a step is below this share of the matrix's curvature, it is raised
    (Powell's damping)."""
    curvature: float = 1e-6
    """The least eigenvalue of an information matrix that is scaled to a unit diagonal."""
    smallest: float = 1e-300
    """The least diagonal entry of an information matrix, for a hyperparameter without effect."""


ASCENT = AscentSettings()


@dataclass(frozen=True)
class Summit:
    """The end of an ascent: `alpha` (K,), its log-likelihood `value`, and `scores` (N, K).

    `information` (F, F) is the estimate of the information matrix of the hyperparameters that
    moved, updated by the steps. `gain` is the increase of the log-likelihood that it predicts for
    the next step.
    """

    alpha: Array
    value: float
    scores: Array
    information: Array
    gain: float

    @property
    def score(self) -> Array:
        """The sum of the scores over the experiments, (K,)."""
        return np.asarray(self.scores.sum(axis=0))

    def outer(self, rows: Indices) -> Array:
        """The information (F, F) about the hyperparameters `rows` by outer products of scores."""
        return outer(self.scores[:, rows])


def ascend(
    objective: Objective | Scored,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    moving: Indices,
    information: Array,
) -> tuple[Array, float]:
    """Maximize over the `moving` (F,) hyperparameters within limits; return alpha and its value.

    See `ascended`.
    """
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
    """Maximize over the `moving` (F,) hyperparameters, from alpha (K,), by quasi-Newton steps.

    The method is BFGS with the given information (F, F) as its first matrix, an active set for the
    limits, and a backtracking line search. It ends when the predicted gain that is left is below
    `arrived`. `bent` says that the likelihood may have a curved ridge. Then, if a step gains
    nothing, the outer products of the scores of the experiments replace the matrix (Berndt et al.
    1974), because curvature from before a bend of the ridge leads away from it; and no step is
    tried that is too short to gain `arrived`. From near a maximum the ascent needs two to six
    evaluations; a method that must first estimate the curvature needs twenty. It never returns a
    smaller value than that of the given alpha, and ends without an error when no step gains.
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
    # Outer products of few experiments are a poor estimate; they replace the matrix only if there
    # are enough experiments.
    another = bent and len(here.each) > settings.experiments * moving.size
    least = arrived if bent else 0.0
    doubted = another
    for _ in range(settings.steps):
        score = here.score[moving]
        free = ~on_limits(point, score, lower, upper)
        step = _newton_step(matrix, score, free)
        if score @ step < 0.0:
            # A matrix that is not positive definite can lead downhill.
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
    """The symmetric matrix made positive definite: small eigenvalues are raised to a least value.

    The eigenvalues are those of the matrix scaled to a unit diagonal.
    """
    scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), settings.smallest))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    raised = (vectors * np.maximum(values, settings.curvature)) @ vectors.T
    return np.asarray(raised * np.outer(scale, scale))


def outer(scores: Array) -> Array:
    """The information matrix (F, F) estimated by outer products of the scores (N, F).

    >>> outer(np.array([[2.0, 0.0], [0.0, 3.0]])).tolist()
    [[4.0, 0.0], [0.0, 9.0]]
    """
    finite = np.nan_to_num(scores)
    return positive(finite.T @ finite)


def on_limits(point: Array, score: Array, lower: Array, upper: Array) -> Flags:
    """Which values (F,) lie on a limit and stay there, because their score (F,) points beyond it.

    >>> on_limits(np.array([0.0, 0.0]), np.array([-1.0, 1.0]), np.zeros(2), np.ones(2)).tolist()
    [True, False]
    """
    return np.asarray(((point <= lower) & (score < 0.0)) | ((point >= upper) & (score > 0.0)))


def _newton_step(matrix: Array, score: Array, free: Flags) -> Array:
    step = np.zeros_like(score)
    if np.any(free):
        # Least squares is used because a hyperparameter without effect makes the matrix singular.
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
    """Try ever shorter parts of a step; return the first point that gains enough, or None.

    `value` is the log-likelihood at `point`, and `gain` the slope along the whole step. A part that
    cannot gain `least` is not tried: where the log-likelihood is concave, a part of a step gains at
    most its length times `gain`.
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
    """BFGS update of the information matrix with step s and y = -(change of the score)."""
    sy, ms = float(s @ y), matrix @ s
    sms = float(s @ ms)
    if sms <= 0.0:
        return matrix
    if sy < settings.damped * sms:
        # Powell's damping keeps the matrix positive definite.
        theta = (1.0 - settings.damped) * sms / (sms - sy)
        y = theta * y + (1.0 - theta) * ms
        sy = float(s @ y)
    return np.asarray(matrix - np.outer(ms, ms) / sms + np.outer(y, y) / sy)
