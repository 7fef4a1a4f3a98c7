"""Searches compared with each other: the same objective, seed and guesses for all."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.search import Objective, Scored, Search, SearchResult
from aleator.search.interface import LogLikelihood
from aleator.search.objective import CountedObjective


@dataclass(frozen=True)
class Step:
    """A best log-likelihood so far, and the evaluations and seconds after which it was known."""

    evaluations: int
    seconds: float
    log_likelihood: float


class TracedObjective(CountedObjective):
    """An objective that notes every improvement of the best log-likelihood, and scores."""

    def __init__(self, objective: Objective | Scored) -> None:
        super().__init__(objective)
        self._began = time.perf_counter()
        self.scored, self.trace = 0, list[Step]()

    @property
    def seconds(self) -> float:
        """Seconds since it was made."""
        return time.perf_counter() - self._began

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood at alpha (K,) with its score."""
        self.scored += 1
        return super().__call__(alpha)

    def note(self, alpha: Array, value: float) -> None:
        """Keep this alpha (K,) where it is the best so far, with a Step."""
        if self.best is None or value > self.best[1]:
            self.trace.append(Step(self.evaluations, self.seconds, value))
        super().note(alpha, value)


@dataclass(frozen=True)
class Trial:
    """One search: its result, and what it took.

    `evaluations` count values of the log-likelihood, `scored` those of them with a score, which
    cost more each; `seconds` are of this machine. `trace` has a Step for every improvement.
    """

    name: str
    result: SearchResult
    evaluations: int
    scored: int
    seconds: float
    trace: tuple[Step, ...]

    @property
    def log_likelihood(self) -> float:
        """What the search reached."""
        return self.result.log_likelihood

    def reached(self, log_likelihood: float) -> Step | None:
        """The first step that was not below this log-likelihood, or None if there is none."""
        return next((step for step in self.trace if step.log_likelihood >= log_likelihood), None)


def compare(
    searches: Sequence[Search],
    objective: Objective | Scored,
    hyperparameters: Sequence[Hyperparameter],
    *,
    seed: int,
    guesses: Sequence[Array] = (),
) -> tuple[Trial, ...]:
    """Let every search maximize the same objective from the same seed and guesses, in turn.

    Raises InputsError for no search at all. Cost: that of all searches.

    >>> import numpy as np
    >>> from aleator.search.interface import LogLikelihood
    >>> from aleator.search import DifferentialEvolution, GradientMultistart
    >>> def parabola(alpha):  # log L = -(alpha - 2)^2, largest at 2
    ...     gap = alpha - 2.0
    ...     return LogLikelihood(-(gap**2), -2.0 * gap[None, :], np.zeros(1, dtype=int))
    >>> limits = [Hyperparameter("x.mean", 0.0, 10.0, 5.0, free=True)]
    >>> choices = [GradientMultistart(2), DifferentialEvolution(population=8)]
    >>> trials = compare(choices, parabola, limits, seed=0)
    >>> [(trial.name, abs(trial.log_likelihood) < 1e-6) for trial in trials]
    [('gradient_multistart(2)', True), ('differential_evolution(8)', True)]
    """
    if not searches:
        raise InputsError("compare: no search is given", "give at least one search")
    trials = []
    for search in searches:
        counted = TracedObjective(objective)
        result = search.maximize(counted, hyperparameters, seed=seed, guesses=guesses)
        trials.append(
            Trial(
                search.name, result, counted.evaluations, counted.scored,
                counted.seconds, tuple(counted.trace),
            )
        )  # fmt: skip
    return tuple(trials)
