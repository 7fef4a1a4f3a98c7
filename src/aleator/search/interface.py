"""The interface of every search: log-likelihoods with scores, objectives, limits, and results."""

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
    """The log-likelihood at one alpha, with its terms and its derivatives.

    `each` (N,) are the log-densities of the experiments, `scores` (N, K) their derivatives by alpha
    or None, and `status` (N,) `Status` codes. Where hyperparameters have priors, `prior` is the sum
    of the logarithms of their densities and `prior_score` (K,) its derivative. A search maximizes
    the `total` of log-likelihood and log prior, whose derivative is `score`. Where experiments
    share parameters, `cluster` (N,) is the number of the cluster of each: `each` and `status` are
    then (U,), those of the clusters, and the scores of its experiments add up to the derivative of
    a cluster's log-density.
    """

    each: Array
    scores: Array | None
    status: NDArray[np.int64]
    prior: float = 0.0
    prior_score: Array | None = None
    cluster: Indices | None = None

    @property
    def independent(self) -> Array:
        """The derivatives (U, K) of the independent terms `each`."""
        assert self.scores is not None
        return self.scores if self.cluster is None else self.summed(self.cluster)[1]

    def summed(self, group: Indices) -> tuple[Array, Array]:
        """The log-densities (G,) of groups of experiments, and their derivatives (G, K).

        `group` (N,) is the group of each experiment; no cluster is divided.
        """
        assert self.scores is not None
        first = np.arange(len(group))
        if self.cluster is not None:
            first = np.unique(self.cluster, return_index=True)[1]
        each, scores = (np.zeros((int(group.max()) + 1, *s)) for s in ((), self.scores.shape[1:]))
        np.add.at(each, group[first], self.each)
        np.add.at(scores, group, self.scores)
        return each, scores

    @property
    def total(self) -> float:
        """The sum of the log-likelihood over the experiments and the log prior."""
        return self.likelihood + self.prior

    @property
    def likelihood(self) -> float:
        """The sum of the log-likelihood over the experiments, without the prior."""
        return float(self.each.sum())

    @property
    def score(self) -> Array:
        """The derivative of the `total` by alpha, (K,)."""
        assert self.scores is not None
        score = np.asarray(self.scores.sum(axis=0))
        return score if self.prior_score is None else score + self.prior_score

    def believed(self, hyperparameters: Sequence[Hyperparameter], alpha: Array) -> LogLikelihood:
        """The log-likelihood plus the log prior density of the hyperparameters at alpha (K,)."""
        if not has_prior(hyperparameters):
            return self
        slope = None if self.scores is None else prior_score(hyperparameters, alpha)
        return replace(self, prior=log_prior(hyperparameters, alpha), prior_score=slope)


Scored = Callable[[Array], LogLikelihood]
"""A function of alpha (K,) that returns the log-likelihood with its score.

It is the least that a search needs.
"""


@runtime_checkable
class Objective(Protocol):
    """A function that searches maximize, at one alpha with its score or at many alphas at once."""

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood at alpha (K,) with its score."""

    def values(self, alphas: Array) -> Array:
        """The `total` (A,) of the log-likelihood at each of the alphas (A, K), without scores."""


@runtime_checkable
class Continuable(Protocol):
    """A log-likelihood that can be minus infinity, and provides a smooth continuation there."""

    @property
    def continued(self) -> Objective:
        """The continued log-likelihood, which a search maximizes instead."""


@runtime_checkable
class Guiding(Protocol):
    """A log-likelihood that proposes better alphas itself, as by expectation and maximization."""

    def expectation_step(self, alpha: Array) -> tuple[float, Array] | None:
        """The total at alpha (K,), and a proposed next alpha, which may lie outside the limits.

        None where the log-likelihood proposes nothing.
        """


@runtime_checkable
class Reaching(Protocol):
    """A log-likelihood that limits the steps of a search, since longer steps would cost much."""

    def reach(self, alpha: Array, ahead: Array) -> float:
        """The share, up to one, of the way from alpha (K,) to `ahead` (K,) that a step may go."""


@dataclass(frozen=True)
class _Looped:
    """An `Objective` made of a plain function, which is called once for each alpha."""

    function: Scored

    def __call__(self, alpha: Array) -> LogLikelihood:
        return self.function(alpha)

    def values(self, alphas: Array) -> Array:
        return np.array([self.function(alpha).total for alpha in alphas], dtype=np.float64)


def objective_of(function: Continuable | Objective | Scored) -> Objective:
    """The `Objective` that a search maximizes, made from the log-likelihood that it was given.

    It is the continuation of the log-likelihood if it has one, the log-likelihood itself if it is
    an `Objective`, and otherwise a loop that calls it.

    >>> def log_likelihood(alpha):
    ...     return LogLikelihood(-(alpha**2), -2.0 * alpha[None, :], np.zeros(1, dtype=int))
    >>> objective_of(log_likelihood).values(np.array([[1.0], [2.0]])).tolist()
    [-1.0, -4.0]
    """
    if isinstance(function, Continuable):
        return function.continued
    return function if isinstance(function, Objective) else _Looped(function)


def reach_of(objective: Objective, alpha: Array, ahead: Array) -> float:
    """The share of the way from alpha (K,) to `ahead` that a step may go; 1 without a limit."""
    return objective.reach(alpha, ahead) if isinstance(objective, Reaching) else 1.0


@dataclass(frozen=True)
class OptimaSettings:
    """Settings that tell distinct optima apart. The values are chosen by judgement."""

    ruled_out: float = 1.92
    """An optimum whose log-likelihood is this far below the largest lies in no 95 % confidence
    interval: chi2_1(0.95)/2."""
    rivals: int = 3
    """The largest number of other optima that a result names."""
    same_value: float = 0.01
    """Two ends of ascents may be the same optimum if their log-likelihoods differ by less than
    this."""
    same_place: float = 0.3
    """Two ends of ascents with almost the same log-likelihood (`same_value`) are the same optimum
    if they also lie within this many standard errors of each other (from outer products of scores).
    """


OPTIMA = OptimaSettings()


def one_hill(step: Array, scores: Array, free: Indices) -> bool:
    """Whether two ends of ascents, a step (K,) apart, belong to the same maximum.

    The step is measured in standard errors, from the outer product of the scores (N, K) at the
    higher end. The ends belong together if its root mean square over the F `free` hyperparameters
    is below one.

    >>> one_hill(np.array([1.0, 0.0]), np.array([[1.2, 0.0], [0.0, 9.0]]), np.arange(2))
    True
    """
    along = scores[:, free] @ step[free]
    return bool(along @ along < free.size)


@dataclass(frozen=True)
class Ascent:
    """The ascent from one start.

    It went from `start` (K,) to `alpha` (K,), where the log-likelihood is `log_likelihood`, and
    took so many `evaluations`; `converged` says whether it met its convergence test.
    """

    start: Array
    alpha: Array
    log_likelihood: float
    evaluations: int
    converged: bool


@dataclass(frozen=True)
class Optimum:
    """A local optimum at `alpha` (K,), and the number of starts that ended there."""

    alpha: Array
    log_likelihood: float
    starts: int


@dataclass(frozen=True)
class Hill:
    """A maximum at `alpha` (K,) with all ends of ascents that belong to it by `one_hill`.

    `starts` is the number of these ascents. `arrived` is False where all of them were stopped by
    their number of evaluations, so that it need not be a maximum.
    """

    alpha: Array
    log_likelihood: float
    starts: int
    arrived: bool


@dataclass(frozen=True)
class SearchResult:
    """The best alpha (K,), the ascents from all starts, and the distinct optima, best first.

    `method` is the name of the search. `once` says that there were several starts, and that neither
    in this search nor in the one whose maximum it began from two of them are known to have reached
    this maximum.
    """

    alpha: Array
    log_likelihood: float
    ascents: tuple[Ascent, ...]
    optima: tuple[Optimum, ...]
    method: str = ""
    once: bool = False

    @property
    def evaluations(self) -> int:
        """The number of evaluations of the log-likelihood in all ascents, with score or without."""
        return sum(ascent.evaluations for ascent in self.ascents)

    @property
    def rivals(self) -> list[Array]:
        """Other optima (K,) with a log-likelihood less than 1.92 below the best, at most three.

        1.92 is the drop that limits a 95 % confidence interval.
        """
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

    def improved(self, alpha: Array, log_likelihood: float) -> SearchResult:
        """This result with a better optimum at `alpha` (K,), found after the search had ended."""
        optimum = Optimum(alpha, log_likelihood, starts=0)
        return replace(
            self, alpha=alpha, log_likelihood=log_likelihood, optima=(optimum, *self.optima),
            once=len(self.ascents) > 1,
        )  # fmt: skip

    def raised(self, by: float) -> SearchResult:
        """This result with all log-likelihoods higher by a number."""
        ascents = tuple(replace(a, log_likelihood=a.log_likelihood + by) for a in self.ascents)
        optima = tuple(replace(o, log_likelihood=o.log_likelihood + by) for o in self.optima)
        value = self.log_likelihood + by
        return replace(self, log_likelihood=value, ascents=ascents, optima=optima)

    def moved(self, alpha: Array, log_likelihood: float) -> SearchResult:
        """This result with its best optimum moved to `alpha` (K,).

        It is used when the log-likelihood has changed since the search, and its best optimum was
        found again.
        """
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


def hills_of(found: SearchResult, scores: Array | None, free: Indices) -> tuple[Hill, ...]:
    """The maxima that a search met, the best first: its optima, joined by `one_hill`.

    `scores` (N, K) are those at the best alpha, and `free` (F,) the places of the free
    hyperparameters. Without finite scores no optima are joined.

    >>> ends = [Ascent(np.zeros(1), np.array([x]), -x, 5, x < 2.0) for x in (0.0, 0.1, 5.0)]
    >>> optima = tuple(Optimum(a.alpha, a.log_likelihood, 1) for a in ends)
    >>> met = SearchResult(np.zeros(1), 0.0, tuple(ends), optima)
    >>> [(hill.starts, hill.arrived) for hill in hills_of(met, np.ones((4, 1)), np.arange(1))]
    [(2, True), (1, False)]
    """
    known = scores is not None and bool(np.all(np.isfinite(scores)))

    def same(one: Array, other: Array) -> bool:
        if scores is None or not known:
            return np.array_equal(one, other)
        return one_hill(one - other, scores, free)

    kept: list[Optimum] = []
    for optimum in found.optima:
        if not any(same(optimum.alpha, one.alpha) for one in kept):
            kept.append(optimum)
    ends: list[list[Ascent]] = [[] for _ in kept]
    finite = [a for a in found.ascents if np.isfinite(a.log_likelihood)]
    finite.sort(key=lambda ascent: -ascent.log_likelihood)
    for j, ascent in enumerate(finite):
        # The best optimum may have been moved since its ascents ended.
        places = [k for k, one in enumerate(kept) if same(ascent.alpha, one.alpha)]
        for place in [0] if j < kept[0].starts else places[:1]:
            ends[place].append(ascent)
    return tuple(
        Hill(
            one.alpha,
            one.log_likelihood,
            max(len(own), one.starts),
            k == 0 or any(ascent.converged for ascent in own),
        )
        for k, (one, own) in enumerate(zip(kept, ends, strict=True))
    )


class Search(Protocol):
    """A method that maximizes the log-likelihood over the free hyperparameters within limits."""

    @property
    def name(self) -> str:
        """The name of this method in reports and comparisons."""

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Search from the hyperparameters' start values, the guesses (K,), and points of its own.

        `objective` may be a plain function of alpha, which is then called for one alpha at a time.
        """


@dataclass(frozen=True)
class SpanSettings:
    """Settings that tell when the limits of a hyperparameter are very wide.

    The values are chosen by judgement.
    """

    wide: float = 1e6
    """Limits are very wide if their distance exceeds this many times the size of the value."""
    nothing: float = 1e-30
    """A value below this share of the distance of its limits counts as zero, so that its size is
    unknown."""


SPANS = SpanSettings()


def wide_limits(
    hyperparameters: Sequence[Hyperparameter], settings: SpanSettings = SPANS
) -> tuple[str, ...]:
    """Names of the free hyperparameters whose limits span six orders of magnitude or more.

    The distance of the limits is compared with the smallest of limits and start that is not zero,
    or with 1 if these are all of the same size and zero lies between them, as for -1e9 to 1e9. A
    scale hyperparameter is never named, because it is searched on a logarithmic scale.

    >>> far = Hyperparameter("b.value", -1e9, 1e9, 0.0, free=True)
    >>> near = Hyperparameter("v.mean", 1e9, 3e11, 2e11, free=True)
    >>> wide_limits([far, near])
    ('b.value',)
    """
    return tuple(
        h.name for h in hyperparameters if h.free and not h.log and _spans(h) >= settings.wide
    )


def outsized(width: Array, size: Array, settings: SpanSettings = SPANS) -> NDArray[np.bool_]:
    """Whether limits with distances `width` (F,) are very wide for values of this `size` (F,).

    >>> outsized(np.array([1e9, 1e9, 1e9]), np.array([1.0, 1e8, 0.0])).tolist()
    [True, False, False]
    """
    return (size > settings.nothing * width) & (width > settings.wide * size)


def _spans(h: Hyperparameter) -> float:
    sizes = [abs(v) for v in (h.lower, h.upper, h.start) if v != 0.0]
    smallest, largest = min(sizes), max(sizes)
    # If limits and start have the same size, the size of the value is unknown.
    unknown = h.lower <= 0.0 <= h.upper and largest <= 2.0 * smallest
    return (h.upper - h.lower) / (min(1.0, smallest) if unknown else smallest)


def nowhere_finite(hyperparameters: Sequence[Hyperparameter], evaluations: int) -> InputsError:
    """The error of a search that found no alpha with a finite log-likelihood."""
    wide = wide_limits(hyperparameters)
    because = f": the limits of {', '.join(wide)} span many orders of magnitude" if wide else ""
    which = ", ".join(wide or [h.name for h in hyperparameters if h.free])
    return InputsError(
        f"search: the log-likelihood is not a finite number at any of the {evaluations} points "
        f"that were tried{because}",
        f"narrow the limits of {which} to values that are physically possible, or give a start",
    )


def written(result: SearchResult) -> str:
    """A search result as JSON text, with all digits of its numbers."""
    return json.dumps(asdict(result), default=np.ndarray.tolist)


def read(text: str) -> SearchResult:
    """The search result from a JSON text of `written`.

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
