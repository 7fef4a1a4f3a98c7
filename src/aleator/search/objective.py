"""An objective as a search sees it: in scaled coordinates, counted, its ends sorted into optima."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

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
    """How a search sees values and log-likelihoods; by judgement."""

    knee: float = 1e-3
    """Share of its upper limit below which a scale that may be zero is seen as its square."""
    floor: float = -1e100
    """What a search sees where the log-likelihood is not a finite number."""


SIGHT = SightSettings()


class Coordinates:
    """Map between alpha (..., K) and u (..., F) in [0, 1]^F for the F free hyperparameters.

    u = (alpha - lower)/(upper - lower), or the same of logarithms where `log` is set. A scale s
    that may be zero is seen as log sqrt(s^2 + d^2), d a thousandth of its upper limit: at zero the
    log-likelihood is flat in s and not in s^2, and zero is not infinitely far. A hyperparameter
    with others `beside` it is seen as the sum.

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
        """The hyperparameters' start, as alpha (K,)."""
        return self._base.copy()

    def to_unit(self, alpha: Array) -> Array:
        """The free entries of alpha, clipped to their limits, as u."""
        free = np.clip(alpha[..., self.free], self.lower, self.upper)
        u = (self._shape(free) - self._from) / self._width
        # a sum may lie beyond its limits where what it is made of does not
        return np.asarray(u if self._beside is None else np.clip(u, 0.0, 1.0))

    def to_alpha(self, u: Array) -> Array:
        """Alpha (..., K) with fixed entries at their value."""
        return self.filled(self._unshape(self._from + u * self._width))

    def filled(self, free: Array) -> Array:
        """Alpha (..., K) whose free entries are these (..., F), clipped to their limits."""
        alpha = np.tile(self._base, (*free.shape[:-1], 1))
        alpha[..., self.free] = np.clip(free, self.lower, self.upper)
        return alpha

    def moved(self, alpha: Array, step: Array) -> Array:
        """Alpha (K,) after a step (F,) in u; a small step keeps its digits in a wide box."""
        return self.filled(self._unshape(self._shape(alpha[self.free]) + step * self._width))

    def gradient(self, alpha: Array, score: Array) -> Array:
        """The derivative by u, given the derivative by alpha (..., K)."""
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
            # what stands beside a sum is no sum itself
            free = free - (free @ self._beside.T + self._known)
        return np.asarray(free)

    def _curved(self, values: Array) -> Array:
        size = np.where(self._knee > 0.0, np.hypot(values, self._knee), values)
        return np.where(self.log, np.log(np.where(self.log, size, 1.0)), values)


def _sums(hyperparameters: Sequence[Hyperparameter], free: Indices) -> tuple[Array | None, Array]:
    """Factors (F, F) of the free ones that stand beside another, and what known ones add (F,)."""
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
    """The objective of one search, the `method`: it counts evaluations and keeps the best alpha
    met.

    Floating-point warnings of the objective are contained, because a search tries absurd alpha on
    purpose; a value, or a score, that is not finite counts as the floor with a score of zero.
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
        if not finite or result.total <= self.floor:
            each = np.zeros_like(result.each)
            each[0] = self.floor
            return LogLikelihood(each, np.zeros_like(result.scores), result.status)
        self.note(alpha, result.total)
        return result

    def values(self, alphas: Array) -> Array:
        """The log-likelihoods (A,) at alphas (A, K)."""
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
        """A difference of the log-likelihood that means nothing; 0 where none is known."""
        return float(getattr(self._objective, "resolution", 0.0))

    def reach(self, alpha: Array, ahead: Array) -> float:
        """See `reach_of`."""
        return reach_of(self._objective, alpha, ahead)

    def expectation_step(self, alpha: Array) -> tuple[float, Array] | None:
        """The log-likelihood at alpha (K,) and the next alpha; None where none is known."""
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
        """Keep this alpha (K,) where it is the best so far."""
        if self.best is None or value > self.best[1]:
            self.best = (alpha.copy(), value)


def gathered(
    ascents: Sequence[Ascent],
    objective: CountedObjective,
    hyperparameters: Sequence[Hyperparameter],
    settings: OptimaSettings = OPTIMA,
) -> SearchResult:
    """Distinct optima, best first: ends that differ in value, or in place by standard errors.

    Cost: one evaluation for each optimum. Raises InputsError where no start met a finite
    log-likelihood.
    """
    arrived = sorted(
        (a for a in ascents if np.isfinite(a.log_likelihood)), key=lambda a: -a.log_likelihood
    )
    if not arrived:
        raise nowhere_finite(hyperparameters, objective.evaluations)
    groups: list[tuple[Ascent, Array, int]] = []
    for ascent in arrived:
        for g, (head, information, count) in enumerate(groups):
            step = ascent.alpha - head.alpha
            near = float(step @ information @ step) < settings.same_place**2
            if head.log_likelihood - ascent.log_likelihood < settings.same_value and near:
                groups[g] = (head, information, count + 1)
                break
        else:
            groups.append((ascent, _information(ascent, objective), 1))
    optima = tuple(Optimum(a.alpha, a.log_likelihood, count) for a, _, count in groups)
    best = optima[0]
    return SearchResult(best.alpha, best.log_likelihood, tuple(ascents), optima, objective.method)


def reached_once(
    ascents: Sequence[Ascent],
    objective: CountedObjective,
    free: Indices,
    settings: OptimaSettings = OPTIMA,
) -> bool:
    """Whether no two starts came to the best log-likelihood, or to the hill that it is on.

    Where the objective is rough, or a climb is cut off, ends on one hill differ in value.
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
    """The result where no hyperparameter is free: one evaluation, nothing to search."""
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
    """The task of a search: the counted objective over F > 0 free hyperparameters.

    `guesses` are alphas (K,) worth a start; `seed` is that of everything random.
    """

    counted: CountedObjective
    coordinates: Coordinates
    hyperparameters: Sequence[Hyperparameter]
    guesses: Sequence[Array]
    seed: int
    progress: Progress

    def cost(self, u: Array) -> Array:
        """Minus the log-likelihoods (A,) at points u (A, F) of the unit cube."""
        return -self.counted.values(self.coordinates.to_alpha(u))


class TaskSearch(ABC):
    """Base of searches: a subclass gives `name`, and `_search` for at least one free
    hyperparameter."""

    @property
    @abstractmethod
    def name(self) -> str:
        """How the result names this choice."""

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Search within the limits; where nothing is free, one evaluation is the result.

        Raises InputsError where the log-likelihood is nowhere a finite number.
        """
        coordinates, counted = Coordinates(hyperparameters), CountedObjective(objective, self.name)
        if coordinates.free.size == 0:
            return only_point(counted, coordinates, hyperparameters)
        listener = progress or Silent()
        return self._search(Task(counted, coordinates, hyperparameters, guesses, seed, listener))

    @abstractmethod
    def _search(self, task: Task) -> SearchResult:
        """The result over the free hyperparameters."""
