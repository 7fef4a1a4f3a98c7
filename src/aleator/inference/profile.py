"""Intervals from the profile of the likelihood, which need not be symmetric nor have a curvature.

The interval of one hyperparameter holds the values v for which the largest log-likelihood with
that hyperparameter fixed at v is within chi2_1(0.95)/2 = 1.92 of the maximum (Wilks, 1938; the
MINOS errors of James and Roos, 1975). It stays meaningful where a standard deviation is
weakly determined or lies on its limit, where the quadratic approximation does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from aleator.inference.information import LEVEL, Inference
from aleator.laws import Hyperparameter
from aleator.search import Objective
from aleator.search.newton import ascended
from aleator.types import Array

TARGET = float(np.sqrt(stats.chi2.ppf(LEVEL, 1)))
CLOSE = 0.02
"""An end is found to this share of a standard error."""
CLIMBED = 2e-3
"""A conditional maximum is found to this in log-likelihood, as far as its curvature is known."""
TRIALS = 8
BETTER = 0.01
"""A conditional maximum this far above the maximum means that the search had missed it."""


@dataclass(frozen=True)
class Profile:
    """Intervals (K, 2), NaN where fixed; `better` is a larger maximum met on the way, or None."""

    intervals: Array
    better: Array | None


def profile_intervals(
    objective: Objective,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
) -> Profile:
    """The profile-likelihood interval of every free hyperparameter at the maximum alpha (K,).

    Each end is found by Newton steps on the signed root of twice the drop in log-likelihood, which
    is linear where the likelihood is normal; its slope is the score. Conditional maxima are climbed
    to from a parabola through those before, with the curvature that these taught: two or three an
    end, of one to five evaluations each, and up to thirty where a ridge is curved. An end that lies
    beyond a limit is that limit. Stops early, with `better` set, when a conditional maximum exceeds
    the maximum.
    """
    top = objective(alpha).total
    intervals = np.full((alpha.size, 2), np.nan)
    for row, k in enumerate(inference.identified):
        others = np.delete(np.arange(inference.identified.size), row)
        moving = inference.identified[others]
        information = _positive(inference.information[np.ix_(others, others)])
        coupling = inference.information[others, row]
        # along the profile the others follow the one by -I_oo^-1 I_ok
        follow = -np.linalg.pinv(information, hermitian=True) @ coupling
        for side, sign in enumerate((-1.0, 1.0)):
            trace = _Trace(objective, hyperparameters, k, moving, information, follow, top)
            end, better = trace.end(alpha, sign, inference)
            if better is not None:
                return Profile(intervals, better)
            intervals[k, side] = end
    return Profile(intervals, None)


@dataclass(frozen=True)
class _Trace:
    """The profile of hyperparameter k; `follow` (F,) is how the moving ones go along."""

    objective: Objective
    hyperparameters: Sequence[Hyperparameter]
    k: int
    moving: NDArray[np.intp]
    information: Array
    follow: Array
    top: float

    def end(self, alpha: Array, sign: float, inference: Inference) -> tuple[float, Array | None]:
        """Where the profile has dropped by 1.92 on one side, or a better maximum."""
        h = self.hyperparameters[self.k]
        limit = h.lower if sign < 0 else h.upper
        if inference.at_bound[self.k] == ("lower" if sign < 0 else "upper"):
            return limit, None
        bracket = _Bracket(alpha[self.k], limit)
        known, information = alpha, self.information
        value = self._first(alpha, sign, inference, limit)
        for _ in range(TRIALS):
            guess = self._guess(alpha, known, value)
            summit = ascended(
                self.objective, guess, self.hyperparameters, self.moving, information, CLIMBED
            )
            if summit.value > self.top + BETTER:
                return value, summit.alpha
            known, information = summit.alpha, summit.information
            # what is left to climb is known well enough to be counted
            root = float(np.sqrt(max(2.0 * (self.top - summit.value - summit.gain), 0.0)))
            if abs(root - TARGET) < CLOSE or (root < TARGET and value == limit):
                return value, None
            value = bracket.next(value, root, float(summit.score[self.k]))
        return value, None

    def _first(self, alpha: Array, sign: float, inference: Inference, limit: float) -> float:
        reach = TARGET * inference.standard_error[self.k]
        if not np.isfinite(reach):
            reach = 0.2 * abs(limit - alpha[self.k])
        return float(_within(alpha[self.k] + sign * reach, alpha[self.k], limit))

    def _guess(self, alpha: Array, known: Array, value: float) -> Array:
        """Where the conditional maximum may be: along a parabola from the maximum through `known`.

        Its slope at the maximum is `follow`. From the maximum itself it is a straight line.
        """
        k, distance = self.k, value - alpha[self.k]
        moved = known[self.moving] - alpha[self.moving]
        so_far = known[k] - alpha[k]
        ahead = self.follow * distance
        if so_far != 0.0:
            ahead = ahead + (moved - self.follow * so_far) * (distance / so_far) ** 2
        guess = alpha.copy()
        for j, step in zip(self.moving, ahead, strict=True):
            h = self.hyperparameters[j]
            guess[j] = np.clip(alpha[j] + step, h.lower, h.upper)
        guess[k] = value
        return guess


class _Bracket:
    """The search for the root on one side of the maximum, at `center`, up to a limit."""

    def __init__(self, center: float, limit: float) -> None:
        self._center, self._limit = center, limit
        self._inner, self._outer = (center, 0.0), (float("nan"), float("nan"))

    def next(self, value: float, root: float, slope: float) -> float:
        """Where to look after a root was found at a value, with the profile's slope there.

        Newton's step on the root, which grows about linearly with the distance; where its slope is
        of no use a secant, or a step outward, at most threefold. Kept within what encloses the end.
        """
        if root < TARGET:
            self._inner = (value, root)
        else:
            self._outer = (value, root)
        inner, outer = self._inner, self._outer
        # the profile's slope is the score of what is held (envelope theorem); root^2/2 is its drop
        steep = -slope / root if root > 0.0 else 0.0
        newton = value + (TARGET - root) / steep if steep else float("nan")
        if not np.isfinite(outer[0]):
            reach = inner[0] - self._center
            factor = min(3.0, 1.1 * TARGET / max(inner[1], 0.3))
            nearest, farthest = self._center + 1.02 * reach, self._center + 3.0 * reach
            low, high = min(nearest, farthest), max(nearest, farthest)
            if not low <= newton <= high:
                newton = self._center + max(factor, 1.2) * reach
            return _within(newton, self._center, self._limit)
        gap = outer[0] - inner[0]
        share = (newton - inner[0]) / gap
        if not 0.02 <= share <= 0.98:
            share = (TARGET - inner[1]) / (outer[1] - inner[1])
        return float(inner[0] + min(max(share, 0.05), 0.95) * gap)


def _within(value: float, center: float, limit: float) -> float:
    return max(value, limit) if limit <= center else min(value, limit)


def _positive(matrix: Array) -> Array:
    """The matrix with its eigenvalues, in units of its diagonal, raised to at least 1e-6."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    raised = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    return np.asarray(raised * np.outer(scale, scale))
