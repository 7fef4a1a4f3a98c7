"""What every search takes and returns: values with scores, objectives, limits, results."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.laws.hyperparameter import Hyperparameter, has_prior, log_prior, prior_score


@dataclass(frozen=True)
class LogLikelihood:
    """Value at one alpha: `each` (N,) log-densities, `scores` (N, K) or None, `status` (N,).

    Where hyperparameters have priors, `prior` is the sum of the logarithms of their densities and
    `prior_score` (K,) its derivative. The `total` and its `score` are of both, which is what is
    maximized; the prior is no experiment, and belongs to none of the N.
    """

    each: Array
    scores: Array | None
    status: NDArray[np.int64]
    prior: float = 0.0
    prior_score: Array | None = None

    @property
    def total(self) -> float:
        """The log-likelihood, summed over experiments, and the log prior."""
        return self.likelihood + self.prior

    @property
    def likelihood(self) -> float:
        """The log-likelihood alone."""
        return float(self.each.sum())

    @property
    def score(self) -> Array:
        """The derivative of the total by alpha, (K,)."""
        assert self.scores is not None
        score = np.asarray(self.scores.sum(axis=0))
        return score if self.prior_score is None else score + self.prior_score

    def believed(self, hyperparameters: Sequence[Hyperparameter], alpha: Array) -> LogLikelihood:
        """The same with the priors of the hyperparameters at this alpha (K,)."""
        if not has_prior(hyperparameters):
            return self
        slope = None if self.scores is None else prior_score(hyperparameters, alpha)
        return replace(self, prior=log_prior(hyperparameters, alpha), prior_score=slope)


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

    def expectation_step(self, alpha: Array) -> tuple[float, Array] | None:
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


@dataclass(frozen=True)
class OptimaSettings:
    """When two ends are one optimum, and which optima the result names; by judgement."""

    ruled_out: float = 1.92
    """A log-likelihood so far below the largest belongs to no interval of 95 %: chi2_1(0.95)/2."""
    rivals: int = 3
    """The most other optima that a result names."""
    same_value: float = 0.01
    """Two ends within this log-likelihood of each other may be the same optimum."""
    same_place: float = 0.3
    """Two ends within `same_value` are one optimum, if they are also within this many standard
    errors (outer product of scores)."""


OPTIMA = OptimaSettings()


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
class SearchResult:
    """The best alpha (K,), all starts, and the distinct optima, best first.

    `method` is the name of the search. `once` says that several starts were made, and the best
    log-likelihood was reached by one of them or by none.
    """

    alpha: Array
    log_likelihood: float
    ascents: tuple[Ascent, ...]
    optima: tuple[Optimum, ...]
    method: str = ""
    once: bool = False

    @property
    def evaluations(self) -> int:
        """Evaluations of the log-likelihood, with its score or without, all starts together."""
        return sum(ascent.evaluations for ascent in self.ascents)

    @property
    def rivals(self) -> list[Array]:
        """The next optima (K,) that a drop of 1.92, that of a 95 % interval, does not rule out."""
        near = [
            o for o in self.optima[1:] if self.log_likelihood - o.log_likelihood < OPTIMA.ruled_out
        ]
        return [optimum.alpha for optimum in near[: OPTIMA.rivals]]

    @property
    def converged(self) -> bool:
        """Whether a start that ended at the best optimum met its convergence test."""
        best = self.log_likelihood
        return any(
            a.converged and best - a.log_likelihood < OPTIMA.same_value for a in self.ascents
        )

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
        led = [self.log_likelihood - a.log_likelihood < OPTIMA.same_value for a in self.ascents]
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


@dataclass(frozen=True)
class SpanSettings:
    """When limits are wide for a value; by judgement."""

    wide: float = 1e6
    """Limits farther apart than this many times what is known of the value's size are wide."""
    nothing: float = 1e-30
    """A value below this share of the distance between its limits says nothing of its size."""


SPANS = SpanSettings()


def wide_limits(
    hyperparameters: Sequence[Hyperparameter], settings: SpanSettings = SPANS
) -> tuple[str, ...]:
    """Names of the free hyperparameters whose limits span six orders of magnitude or more.

    Measured against the smallest of limits and start that is not zero; where these are all of one
    size, as for -1e9 to 1e9, against 1. A scale is never one: it is seen by its logarithm, and by
    its square near zero.

    >>> far = Hyperparameter("b.value", -1e9, 1e9, 0.0, free=True)
    >>> near = Hyperparameter("v.mean", 1e9, 3e11, 2e11, free=True)
    >>> wide_limits([far, near])
    ('b.value',)
    """
    return tuple(
        h.name for h in hyperparameters if h.free and not h.log and _spans(h) >= settings.wide
    )


def outsized(width: Array, size: Array, settings: SpanSettings = SPANS) -> NDArray[np.bool_]:
    """Where limits this far apart (F,) are wide for values of this size (F,).

    >>> outsized(np.array([1e9, 1e9, 1e9]), np.array([1.0, 1e8, 0.0])).tolist()
    [True, False, False]
    """
    return (size > settings.nothing * width) & (width > settings.wide * size)


def _spans(h: Hyperparameter) -> float:
    sizes = [abs(v) for v in (h.lower, h.upper, h.start) if v != 0.0]
    smallest, largest = min(sizes), max(sizes)
    # one size all round says nothing of the value's own size
    unknown = h.lower <= 0.0 <= h.upper and largest <= 2.0 * smallest
    return (h.upper - h.lower) / (min(1.0, smallest) if unknown else smallest)


def nowhere_finite(hyperparameters: Sequence[Hyperparameter], evaluations: int) -> InputsError:
    """The refusal of a search that met no alpha where the log-likelihood is a number."""
    wide = wide_limits(hyperparameters)
    because = f": the limits of {', '.join(wide)} span many orders of magnitude" if wide else ""
    which = ", ".join(wide or [h.name for h in hyperparameters if h.free])
    return InputsError(
        f"search: the log-likelihood is not a finite number at any of the {evaluations} points "
        f"that were tried{because}",
        f"narrow the limits of {which} to values that are physically possible, or give a start",
    )


def written(result: SearchResult) -> str:
    """A result as JSON: numbers to the last bit."""
    return json.dumps(asdict(result), default=np.ndarray.tolist)


def read(text: str) -> SearchResult:
    """The result that was written.

    >>> one = SearchResult(np.array([0.1, 1 / 3]), -1.5, (), (), "climb")
    >>> again = read(written(one))
    >>> again.alpha.tolist() == one.alpha.tolist(), again.method
    (True, 'climb')
    """
    known = json.loads(text)
    return SearchResult(
        np.array(known["alpha"]),
        known["log_likelihood"],
        tuple(
            Ascent(**{**one, "start": np.array(one["start"]), "alpha": np.array(one["alpha"])})
            for one in known["ascents"]
        ),
        tuple(Optimum(**{**one, "alpha": np.array(one["alpha"])}) for one in known["optima"]),
        known["method"],
        known["once"],
    )
