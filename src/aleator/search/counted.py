"""The objective as searches see it: counted, timed, and never anything but a number."""

from __future__ import annotations

import time

import numpy as np

from aleator.search.interface import Guiding, Objective, Scored, Step, objective_of, reach_of
from aleator.search.value import LogLikelihood
from aleator.types import Array

FLOOR = -1e100
"""What a search sees where the log-likelihood is not a finite number."""


class CountedObjective:
    """The objective of one search, the `method`: the best alpha it asked for, and what that took.

    Floating-point warnings of the objective are contained, because a search asks for absurd alpha
    on purpose; a value, or a score, that is not finite counts as FLOOR with a score of zero.
    """

    def __init__(self, objective: Objective | Scored, method: str = "") -> None:
        self.method = method
        self._objective = objective_of(objective)
        self._began = time.perf_counter()
        self._steps: list[Step] = []
        self.evaluations = 0
        self.scored = 0
        self.best: tuple[Array, float] | None = None

    @property
    def seconds(self) -> float:
        """Seconds since it was made."""
        return time.perf_counter() - self._began

    @property
    def trace(self) -> tuple[Step, ...]:
        """A Step for every improvement."""
        return tuple(self._steps)

    @property
    def standing(self) -> str:
        """The best log-likelihood so far, in words for the progress."""
        if self.best is None:
            return "no finite log-likelihood yet"
        return f"best log-likelihood {self.best[1]:.3f}"

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood at alpha (K,) with its score."""
        with np.errstate(all="ignore"):
            result = self._objective(alpha)
            assert result.scores is not None
            # squares of scores are the information that scales the variables
            finite = np.isfinite(result.total) and np.isfinite(np.sum(result.scores**2))
        self.evaluations += 1
        self.scored += 1
        if not finite or result.total <= FLOOR:
            each = np.zeros_like(result.each)
            each[0] = FLOOR
            return LogLikelihood(each, np.zeros_like(result.scores), result.status)
        self._note(alpha, result.total)
        return result

    def values(self, alphas: Array) -> Array:
        """The log-likelihoods (A,) at alphas (A, K)."""
        with np.errstate(all="ignore"):
            values = np.asarray(self._objective.values(alphas), dtype=np.float64)
        self.evaluations += len(alphas)
        values = np.where(np.isfinite(values), values, FLOOR)
        if values.size and values.max() > FLOOR:
            best = int(np.argmax(values))
            self._note(alphas[best], float(values[best]))
        return values

    @property
    def resolution(self) -> float:
        """A difference of the log-likelihood that means nothing; 0 where none is known."""
        return float(getattr(self._objective, "resolution", 0.0))

    def reach(self, alpha: Array, ahead: Array) -> float:
        """See `reach_of`."""
        return reach_of(self._objective, alpha, ahead)

    def toward(self, alpha: Array) -> tuple[float, Array] | None:
        """The log-likelihood at alpha (K,) and the next alpha; None where none is known."""
        if not isinstance(self._objective, Guiding):
            return None
        with np.errstate(all="ignore"):
            found = self._objective.toward(alpha)
        if found is None:
            return None
        value, ahead = found
        self.evaluations += 1
        if not np.isfinite(value) or not np.all(np.isfinite(ahead)):
            return FLOOR, alpha
        self._note(alpha, value)
        return value, ahead

    def _note(self, alpha: Array, value: float) -> None:
        if self.best is None or value > self.best[1]:
            self.best = (alpha.copy(), value)
            self._steps.append(Step(self.evaluations, self.seconds, value))
