"""What every search takes and returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aleator.laws import Hyperparameter
from aleator.likelihood import LogLikelihood
from aleator.progress import Progress

Array = NDArray[np.float64]
Objective = Callable[[Array], LogLikelihood]


@dataclass(frozen=True)
class Ascent:
    """One start: where it began, where it ended, and at what cost."""

    start: Array
    alpha: Array
    log_likelihood: float
    evaluations: int
    converged: bool


@dataclass(frozen=True)
class Optimum:
    """A distinct local optimum and the number of starts that ended there."""

    alpha: Array
    log_likelihood: float
    starts: int


@dataclass(frozen=True)
class SearchResult:
    """The best alpha (K,), all starts, and the distinct optima, best first."""

    alpha: Array
    log_likelihood: float
    ascents: tuple[Ascent, ...]
    optima: tuple[Optimum, ...]

    @property
    def evaluations(self) -> int:
        """Evaluations of the log-likelihood with its score, all starts together."""
        return sum(ascent.evaluations for ascent in self.ascents)

    @property
    def converged(self) -> bool:
        """Whether a start that ended at the best optimum met its convergence test."""
        best = self.log_likelihood
        return any(a.converged and best - a.log_likelihood < 0.01 for a in self.ascents)

    def improved(self, alpha: Array, log_likelihood: float) -> SearchResult:
        """The result with a better optimum in front, met after the starts had ended."""
        optimum = Optimum(alpha, log_likelihood, starts=0)
        return SearchResult(alpha, log_likelihood, self.ascents, (optimum, *self.optima))


class Search(Protocol):
    """A way to maximize the log-likelihood over the free hyperparameters within their limits."""

    def maximize(
        self,
        objective: Objective,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Search from the hyperparameters' start, the guesses (K,), and points of its own."""
        ...
