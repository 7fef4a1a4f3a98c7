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

from aleator.inference import LEVEL, Inference
from aleator.laws import Hyperparameter
from aleator.search import Objective, ascend

Array = NDArray[np.float64]

TARGET = float(np.sqrt(stats.chi2.ppf(LEVEL, 1)))
CLOSE = 0.02
"""An end is found to this share of a standard error."""
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

    Each end is found by a secant search on the signed root of twice the drop in log-likelihood,
    which is linear where the likelihood is normal; three or four conditional maxima an end, of
    about five evaluations each. An end that lies beyond a limit is that limit. Stops early, with
    `better` set, when a conditional maximum exceeds the maximum.
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
        inner, outer = (alpha[self.k], 0.0), (float("nan"), float("nan"))
        known = alpha
        value = self._first(alpha, sign, inference, limit)
        for _ in range(TRIALS):
            known, height = self._maximum(known, value)
            if height > self.top + BETTER:
                return value, known
            root = float(np.sqrt(max(2.0 * (self.top - height), 0.0)))
            if abs(root - TARGET) < CLOSE:
                return value, None
            if root < TARGET:
                if value == limit:
                    return limit, None
                inner = (value, root)
            else:
                outer = (value, root)
            value = self._next(inner, outer, alpha[self.k], limit)
        return value, None

    def _first(self, alpha: Array, sign: float, inference: Inference, limit: float) -> float:
        reach = TARGET * inference.standard_error[self.k]
        if not np.isfinite(reach):
            reach = 0.2 * abs(limit - alpha[self.k])
        return float(_within(alpha[self.k] + sign * reach, alpha[self.k], limit))

    @staticmethod
    def _next(
        inner: tuple[float, float], outer: tuple[float, float], center: float, limit: float
    ) -> float:
        if not np.isfinite(outer[0]):
            # the root grows about linearly with the distance: extrapolate, at most threefold
            factor = min(3.0, 1.1 * TARGET / max(inner[1], 0.3))
            return _within(center + max(factor, 1.2) * (inner[0] - center), center, limit)
        share = (TARGET - inner[1]) / (outer[1] - inner[1])
        return inner[0] + min(max(share, 0.05), 0.95) * (outer[0] - inner[0])

    def _maximum(self, known: Array, value: float) -> tuple[Array, float]:
        """The conditional maximum with hyperparameter k at `value`, from a neighbouring one."""
        guess = known.copy()
        for j, rate in zip(self.moving, self.follow, strict=True):
            h = self.hyperparameters[j]
            guess[j] = np.clip(known[j] + rate * (value - known[self.k]), h.lower, h.upper)
        guess[self.k] = value
        return ascend(self.objective, guess, self.hyperparameters, self.moving, self.information)


def _within(value: float, center: float, limit: float) -> float:
    return max(value, limit) if limit <= center else min(value, limit)


def _positive(matrix: Array) -> Array:
    """The matrix with its eigenvalues, in units of its diagonal, raised to at least 1e-6."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    raised = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    return np.asarray(raised * np.outer(scale, scale))
