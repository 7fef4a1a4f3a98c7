"""What every search takes and returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from aleator.laws import Hyperparameter
from aleator.progress import Progress
from aleator.search.value import LogLikelihood
from aleator.types import Array, Indices

Scored = Callable[[Array], LogLikelihood]
"""The log-likelihood at one alpha (K,), with its score: all that a search needs to work."""


@runtime_checkable
class Objective(Protocol):
    """What searches maximize: one alpha with its score, or the values of many alphas at once."""

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood at alpha (K,) with its score."""

    def values(self, alphas: Array) -> Array:
        """The totals (A,) of the same log-likelihood at alphas (A, K), without scores."""


@runtime_checkable
class Continuable(Protocol):
    """A log-likelihood that is minus infinity in places, and knows a smooth continuation."""

    @property
    def continued(self) -> Objective:
        """What a search climbs in its place."""


@runtime_checkable
class Guiding(Protocol):
    """A log-likelihood that knows where it may be larger, as by expectation and maximization."""

    def toward(self, alpha: Array) -> tuple[float, Array] | None:
        """The total at alpha (K,) and the next alpha, which need not keep limits; None for none."""


@runtime_checkable
class Reaching(Protocol):
    """A log-likelihood that knows how far a step may go, beyond which it costs much."""

    def reach(self, alpha: Array, ahead: Array) -> float:
        """The share of the way from alpha (K,) to another alpha, up to one."""


@dataclass(frozen=True)
class _Looped:
    """A plain function as an Objective."""

    function: Scored

    def __call__(self, alpha: Array) -> LogLikelihood:
        return self.function(alpha)

    def values(self, alphas: Array) -> Array:
        return np.array([self.function(alpha).total for alpha in alphas], dtype=np.float64)


def objective_of(function: Continuable | Objective | Scored) -> Objective:
    """What a search climbs: a continuation, an Objective itself, else a loop over calls.

    >>> def log_likelihood(alpha):
    ...     return LogLikelihood(-(alpha**2), -2.0 * alpha[None, :], np.zeros(1, dtype=int))
    >>> objective_of(log_likelihood).values(np.array([[1.0], [2.0]])).tolist()
    [-1.0, -4.0]
    """
    if isinstance(function, Continuable):
        return function.continued
    return function if isinstance(function, Objective) else _Looped(function)


def reach_of(objective: Objective, alpha: Array, ahead: Array) -> float:
    """The share of the way from alpha (K,) to another that a step may go; all, if not known."""
    return objective.reach(alpha, ahead) if isinstance(objective, Reaching) else 1.0


RULED_OUT = 1.92
"""A log-likelihood so far below the largest belongs to no interval of 95 %: chi2_1(0.95)/2."""
MOST_RIVALS = 3
SAME_VALUE = 0.01
"""Two ends within this log-likelihood of each other may be the same optimum."""


def one_hill(step: Array, scores: Array, free: Indices) -> bool:
    """Whether two ends a step (K,) apart are on one hill, by the scores (N, K) at the higher one.

    They are within a standard error for each of the F `free` hyperparameters (outer product of
    scores), as the root of the mean of squares.

    >>> one_hill(np.array([1.0, 0.0]), np.array([[1.2, 0.0], [0.0, 9.0]]), np.arange(2))
    True
    """
    along = scores[:, free] @ step[free]
    return bool(along @ along < free.size)


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
class Step:
    """A best log-likelihood so far, and the evaluations and seconds after which it was known."""

    evaluations: int
    seconds: float
    log_likelihood: float


@dataclass(frozen=True)
class SearchResult:
    """The best alpha (K,), all starts, and the distinct optima, best first.

    `trace` has a Step for every improvement; its seconds are all that a seed does not reproduce.
    `method` is the name of the search. `once` says that several starts were made, and the best
    log-likelihood was reached by one of them or by none.
    """

    alpha: Array
    log_likelihood: float
    ascents: tuple[Ascent, ...]
    optima: tuple[Optimum, ...]
    trace: tuple[Step, ...] = ()
    method: str = ""
    once: bool = False

    @property
    def evaluations(self) -> int:
        """Evaluations of the log-likelihood, with its score or without, all starts together."""
        return sum(ascent.evaluations for ascent in self.ascents)

    @property
    def exhaustive(self) -> bool:
        """Whether another optimum is unlikely, after all starts of a multistart.

        Of n starts that ended at w optima, w (n - 1)/(n - w - 2) optima are to be expected, if
        before the search any number was as likely (Boender and Rinnooy Kan, 1987): to be less than
        half an optimum more than w.
        """
        w, n = len(self.optima), sum(optimum.starts for optimum in self.optima)
        return n > w + 2 and w * (n - 1) / (n - w - 2) < w + 0.5

    @property
    def rivals(self) -> list[Array]:
        """The next optima (K,) that a drop of 1.92, that of a 95 % interval, does not rule out."""
        near = [o for o in self.optima[1:] if self.log_likelihood - o.log_likelihood < RULED_OUT]
        return [optimum.alpha for optimum in near[:MOST_RIVALS]]

    @property
    def converged(self) -> bool:
        """Whether a start that ended at the best optimum met its convergence test."""
        best = self.log_likelihood
        return any(a.converged and best - a.log_likelihood < SAME_VALUE for a in self.ascents)

    def improved(self, alpha: Array, at: LogLikelihood, free: Indices) -> SearchResult:
        """The result with a better optimum in front, met after the starts had ended.

        `at` has the scores there, and the `free` (F,) hyperparameters are those that were sought.
        """
        assert at.scores is not None
        optimum = Optimum(alpha, at.total, starts=0)
        near = sum(one_hill(a.alpha - alpha, at.scores, free) for a in self.ascents)
        return replace(
            self, alpha=alpha, log_likelihood=at.total, optima=(optimum, *self.optima),
            once=len(self.ascents) > 1 and near < 2,
        )  # fmt: skip

    def moved(self, alpha: Array, log_likelihood: float) -> SearchResult:
        """The result where the best optimum has moved, as the objective has since the search."""
        best, *others = self.optima
        led = [self.log_likelihood - a.log_likelihood < SAME_VALUE for a in self.ascents]
        ascents = tuple(
            replace(ascent, alpha=alpha, log_likelihood=log_likelihood) if same else ascent
            for ascent, same in zip(self.ascents, led, strict=True)
        )
        optima = (replace(best, alpha=alpha, log_likelihood=log_likelihood), *others)
        return replace(
            self, alpha=alpha, log_likelihood=log_likelihood, ascents=ascents, optima=optima
        )


class Search(Protocol):
    """A way to maximize the log-likelihood over the free hyperparameters within their limits."""

    @property
    def name(self) -> str:
        """How reports and comparisons name this choice."""

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Search from the hyperparameters' start, the guesses (K,), and points of its own.

        A plain function of alpha does for an objective; a population is then a loop over it.
        """
