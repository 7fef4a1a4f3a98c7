"""Tools of every search: scaled coordinates, counted evaluations, and a list of distinct optima."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Indices
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search.interface import (
    OPTIMA,
    Ascent,
    Guiding,
    LogLikelihood,
    Objective,
    OptimaSettings,
    Optimum,
    Scored,
    SearchResult,
    nowhere_finite,
    objective_of,
    one_hill,
    reach_of,
)


@dataclass(frozen=True)
class SightSettings:
    """Settings of the scaled values and log-likelihoods in a search, chosen by judgement."""

    knee: float = 1e-3
    """A scale that may be zero is searched by its logarithm, but by its square if it is below this
    share of its upper limit."""
    floor: float = -1e100
    """The value that replaces a log-likelihood that is not finite."""


SIGHT = SightSettings()


class Coordinates:
    """Map between alpha (..., K) and u (..., F) in [0, 1]^F for the F free hyperparameters.

    u = (alpha - lower)/(upper - lower); where `log` is set the three are replaced by their
    logarithms. A scale s that may be zero is replaced by log sqrt(s^2 + d^2), where d is a
    thousandth of its upper limit. Then zero is not infinitely far, and the log-likelihood, which is
    flat in s at zero, still has a slope there. A hyperparameter whose limits hold for a sum with
    others (`beside`) is replaced by that sum.

    >>> h = [Hyperparameter("x.sd", 0.01, 1.0, 0.1, free=True, log=True)]
    >>> c = Coordinates(h)
    >>> c.to_unit(np.array([0.1])).round(6).tolist(), c.to_alpha(np.array([1.0])).tolist()
    ([0.5], [1.0])
    """

    def __init__(
        self, hyperparameters: Sequence[Hyperparameter], settings: SightSettings = SIGHT
    ) -> None:
        self.free = np.array([k for k, h in enumerate(hyperparameters) if h.free], dtype=np.intp)
        self._base = np.array([h.start for h in hyperparameters])
        chosen = [hyperparameters[k] for k in self.free]
        self.log = np.array([h.log for h in chosen], dtype=bool)
        self.lower, self.upper = limits_of(chosen)
        self._knee = np.array([settings.knee * h.upper * h.reaches_zero for h in chosen])
        self._beside, self._known = _sums(hyperparameters, self.free)
        ends = np.array([(h.beside.lower, h.beside.upper) if h.beside else (h.lower, h.upper)
                         for h in chosen]).reshape(-1, 2)  # fmt: skip
        self._from = self._curved(ends[:, 0])
        self._width = self._curved(ends[:, 1]) - self._from

    @property
    def start(self) -> Array:
        """The start values of the hyperparameters, as alpha (K,)."""
        return self._base.copy()

    def to_unit(self, alpha: Array) -> Array:
        """The coordinates u (..., F) of the free entries of alpha, clipped to their limits."""
        free = np.clip(alpha[..., self.free], self.lower, self.upper)
        u = (self._shape(free) - self._from) / self._width
        # A sum may lie beyond its limits although its terms do not.
        return np.asarray(u if self._beside is None else np.clip(u, 0.0, 1.0))

    def to_alpha(self, u: Array) -> Array:
        """Alpha (..., K) at coordinates u (..., F), with the fixed entries at their values."""
        return self.filled(self._unshape(self._from + u * self._width))

    def filled(self, free: Array) -> Array:
        """Alpha (..., K) with these free entries (..., F), clipped to their limits."""
        alpha = np.tile(self._base, (*free.shape[:-1], 1))
        alpha[..., self.free] = np.clip(free, self.lower, self.upper)
        return alpha

    def moved(self, alpha: Array, step: Array) -> Array:
        """Alpha (K,) after a step (F,) in u; a small step keeps its digits between wide limits."""
        return self.filled(self._unshape(self._shape(alpha[self.free]) + step * self._width))

    def gradient(self, alpha: Array, score: Array) -> Array:
        """The derivative by u (..., F), from the derivative by alpha, `score` (..., K)."""
        free = alpha[self.free]
        slope = np.where(self.log, free, 1.0)
        at_knee = self._knee > 0.0
        slope[at_knee] += self._knee[at_knee] ** 2 / free[at_knee]
        by_free = score[..., self.free]
        if self._beside is not None:
            by_free = by_free - by_free @ self._beside
        return np.asarray(by_free * (self._width * slope))

    def _shape(self, free: Array) -> Array:
        if self._beside is not None:
            free = free + free @ self._beside.T + self._known
        return self._curved(free)

    def _unshape(self, inner: Array) -> Array:
        knee = np.where(self._knee > 0.0, self._knee, 1.0)
        grown = np.exp(np.where(self.log, inner, 0.0))
        squared = np.where(self._knee > 0.0, (grown - knee) * (grown + knee), 0.0)
        flat = np.where(self._knee > 0.0, np.sqrt(np.maximum(squared, 0.0)), grown)
        free = np.where(self.log, flat, inner)
        if self._beside is not None:
            # The other terms of a sum are no sums themselves.
            free = free - (free @ self._beside.T + self._known)
        return np.asarray(free)

    def _curved(self, values: Array) -> Array:
        size = np.where(self._knee > 0.0, np.hypot(values, self._knee), values)
        return np.where(self.log, np.log(np.where(self.log, size, 1.0)), values)


def _sums(hyperparameters: Sequence[Hyperparameter], free: Indices) -> tuple[Array | None, Array]:
    """The sums that replace free hyperparameters: factors (F, F) of free terms, known terms (F,).

    The factors are None if no hyperparameter is replaced by a sum.
    """
    factors, known = np.zeros((len(free), len(free))), np.zeros(len(free))
    place = {hyperparameters[k].name: i for i, k in enumerate(free)}
    values = {h.name: h.start for h in hyperparameters}
    for i, k in enumerate(free):
        beside = hyperparameters[k].beside
        for name, factor in beside.terms if beside else ():
            if name in place:
                factors[i, place[name]] = factor
            else:
                known[i] += factor * values[name]
    return (factors, known) if any(hyperparameters[k].beside for k in free) else (None, known)


class CountedObjective:
    """The objective of one search, which counts evaluations and keeps the best alpha evaluated.

    `method` is the name of the search. Floating-point warnings of the objective are suppressed,
    because a search also tries extreme values. Where the value or a score is not finite, the value
    is replaced by `floor` and the score by zero.
    """

    def __init__(
        self, objective: Objective | Scored, method: str = "", settings: SightSettings = SIGHT
    ) -> None:
        self.method, self.floor = method, settings.floor
        self._objective = objective_of(objective)
        self.evaluations = 0
        self.best: tuple[Array, float] | None = None

    @property
    def standing(self) -> str:
        """The best log-likelihood so far, in words for the report of progress.

        A search computes it with few nodes, and on surfaces that are not final: it is called rough,
        because that of the answer, which is computed accurately, may be lower.
        """
        if self.best is None:
            return "no finite log-likelihood yet"
        return f"best rough log-likelihood {self.best[1]:.2f}"

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood at alpha (K,) with its score."""
        with np.errstate(all="ignore"):
            result = self._objective(alpha)
            assert result.scores is not None
            # The squares must be finite too: their sum is the information that scales variables.
            finite = np.isfinite(result.total) and np.isfinite(np.sum(result.scores**2))
        self.evaluations += 1
        if not finite or result.total <= self.floor:
            each = np.zeros_like(result.each)
            each[0] = self.floor
            return LogLikelihood(each, np.zeros_like(result.scores), result.status)
        self.note(alpha, result.total)
        return result

    def values(self, alphas: Array) -> Array:
        """The log-likelihood at each of the alphas (A, K), as (A,)."""
        with np.errstate(all="ignore"):
            values = np.asarray(self._objective.values(alphas), dtype=np.float64)
        self.evaluations += len(alphas)
        values = np.where(np.isfinite(values), values, self.floor)
        if values.size and values.max() > self.floor:
            best = int(np.argmax(values))
            self.note(alphas[best], float(values[best]))
        return values

    @property
    def resolution(self) -> float:
        """A difference of the log-likelihood too small to mean anything; 0 if none is known."""
        return float(getattr(self._objective, "resolution", 0.0))

    def reach(self, alpha: Array, ahead: Array) -> float:
        """The share of the way from alpha (K,) to `ahead` (K,) that a step may go, up to one."""
        return reach_of(self._objective, alpha, ahead)

    def expectation_step(self, alpha: Array) -> tuple[float, Array] | None:
        """The log-likelihood at alpha (K,) and the next alpha that the objective proposes, or None.

        See `Guiding`.
        """
        if not isinstance(self._objective, Guiding):
            return None
        with np.errstate(all="ignore"):
            found = self._objective.expectation_step(alpha)
        if found is None:
            return None
        value, ahead = found
        self.evaluations += 1
        if not np.isfinite(value) or not np.all(np.isfinite(ahead)):
            return self.floor, alpha
        self.note(alpha, value)
        return value, ahead

    def note(self, alpha: Array, value: float) -> None:
        """Keep alpha (K,) with its log-likelihood `value` if it is the best so far."""
        if self.best is None or value > self.best[1]:
            self.best = (alpha.copy(), value)


def gathered(
    ascents: Sequence[Ascent],
    objective: CountedObjective,
    hyperparameters: Sequence[Hyperparameter],
    settings: OptimaSettings = OPTIMA,
) -> SearchResult:
    """The result of a search: the ends of all ascents, gathered into distinct optima, best first.

    Two ends are distinct optima if their log-likelihoods differ, or if they lie apart in standard
    errors (see `OptimaSettings`). Ends that are one optimum are told as one: the highest of them.
    Cost: one evaluation for each optimum. Raises InputsError where no ascent found a finite
    log-likelihood.
    """
    ends = list(ascents)
    arrived = [k for k, a in enumerate(ends) if np.isfinite(a.log_likelihood)]
    arrived.sort(key=lambda k: -ends[k].log_likelihood)
    if not arrived:
        raise nowhere_finite(hyperparameters, objective.evaluations)
    groups: list[tuple[Ascent, Array, int]] = []
    for k in arrived:
        ascent = ends[k]
        for g, (head, information, count) in enumerate(groups):
            step = ascent.alpha - head.alpha
            near = float(step @ information @ step) < settings.same_place**2
            if head.log_likelihood - ascent.log_likelihood < settings.same_value and near:
                groups[g] = (head, information, count + 1)
                ends[k] = replace(ascent, alpha=head.alpha, log_likelihood=head.log_likelihood)
                break
        else:
            groups.append((ascent, _information(ascent, objective), 1))
    optima = tuple(Optimum(a.alpha, a.log_likelihood, count) for a, _, count in groups)
    best = optima[0]
    return SearchResult(best.alpha, best.log_likelihood, tuple(ends), optima, objective.method)


def reached_once(
    ascents: Sequence[Ascent],
    objective: CountedObjective,
    free: Indices,
    settings: OptimaSettings = OPTIMA,
) -> bool:
    """Whether only one ascent ended at the best log-likelihood.

    Another ascent counts as having ended there if its value is the same, or if its end belongs to
    the same maximum by `one_hill`. The values of such ends can differ where the objective is rough,
    or where an ascent was stopped early.
    """
    best, *others = sorted(ascents, key=lambda a: -a.log_likelihood)
    if not np.isfinite(best.log_likelihood):
        return False
    if any(best.log_likelihood - a.log_likelihood < settings.same_value for a in others):
        return False
    scores = objective(best.alpha).scores
    assert scores is not None
    return not any(one_hill(a.alpha - best.alpha, scores, free) for a in others)


def only_point(
    objective: CountedObjective, coordinates: Coordinates, hyperparameters: Sequence[Hyperparameter]
) -> SearchResult:
    """The result where no hyperparameter is free: the one evaluation at the known values."""
    alpha = coordinates.start
    value = float(objective.values(alpha[None, :])[0])
    if value <= objective.floor:
        raise nowhere_finite(hyperparameters, 1)
    ascent = Ascent(alpha, alpha, value, 1, converged=True)
    optima = (Optimum(alpha, value, 1),)
    return SearchResult(alpha, value, (ascent,), optima, objective.method)


def _information(ascent: Ascent, objective: CountedObjective) -> Array:
    scores = objective(ascent.alpha).scores
    assert scores is not None
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(scores.T @ scores)


@dataclass(frozen=True, eq=False)
class Task:
    """The task of a search: to maximize an objective over F > 0 free hyperparameters.

    `counted` is the objective, `coordinates` the map of alpha to the unit cube. `guesses` are
    alphas (K,) from which to start as well, and `seed` determines all random numbers.
    """

    counted: CountedObjective
    coordinates: Coordinates
    hyperparameters: Sequence[Hyperparameter]
    guesses: Sequence[Array]
    seed: int
    progress: Progress

    def cost(self, u: Array) -> Array:
        """Minus the log-likelihood (A,) at each of the points u (A, F) of the unit cube."""
        return -self.counted.values(self.coordinates.to_alpha(u))


class TaskSearch(ABC):
    """Base class of searches.

    A subclass gives `name`, and `_search`, which is called with at least one free hyperparameter.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """The name of this search in a result."""

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Search within the limits; without a free hyperparameter the result is one evaluation.

        Raises InputsError where the log-likelihood is nowhere a finite number.
        """
        coordinates, counted = Coordinates(hyperparameters), CountedObjective(objective, self.name)
        if coordinates.free.size == 0:
            return only_point(counted, coordinates, hyperparameters)
        listener = progress or Silent()
        return self._search(Task(counted, coordinates, hyperparameters, guesses, seed, listener))

    @abstractmethod
    def _search(self, task: Task) -> SearchResult:
        """The result of maximizing the task's objective over the free hyperparameters."""
