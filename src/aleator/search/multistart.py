"""The default search: local quasi-Newton ascents from several starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import optimize
from scipy.stats import qmc

from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.search.interface import (
    Ascent,
    LogLikelihood,
    Objective,
    Scored,
    SearchResult,
    outsized,
)
from aleator.search.objective import (
    Coordinates,
    CountedObjective,
    Task,
    TaskSearch,
    gathered,
    reached_once,
)


@dataclass(frozen=True)
class StartSettings:
    """Settings of the starts of ascents. The values are chosen by judgement."""

    margin: float = 0.05
    """The least distance of a start from a limit, as a share of the distance of the limits."""
    nearest: float = 0.01
    """The least distance of a start from a guess, as a share of the distance of the limits; where
    these are very wide, as a share of the size of the guess."""


STARTS = StartSettings()


@dataclass(frozen=True)
class ClimbSettings:
    """Settings of an ascent. The values are chosen by judgement.

    An ascent is a sequence of legs. A leg is one run of L-BFGS-B with variables in units of the
    standard errors at its start.
    """

    near: float = 0.5
    """Two points may belong to the same optimum if they lie within this many standard errors of
    each other (from outer products of scores)."""
    agrees: float = 0.05
    """Two points near each other (`near`) belong to the same optimum if the difference of their
    log-likelihoods agrees with the mean of their slopes up to this error."""
    guided_gain: float = 1.0
    """Steps that the objective itself proposes (see `Guiding`) are repeated as long as they gain
    more than this in log-likelihood; near a maximum quasi-Newton steps are faster."""
    guided_steps: int = 10
    """The largest number of steps in a row that the objective itself proposes."""
    flat: float = 1e-4
    """A run of L-BFGS-B ends when the slope of the log-likelihood, per standard error at the start
    of the run, is below this."""
    settled: float = 1e-3
    """Another run of L-BFGS-B follows if the slope of the log-likelihood, per standard error at the
    end of the last run, is above this."""
    noise: float = 5.0
    """A slope below this many times the square root of the objective's resolution counts as zero.
    """
    leg: int = 10
    """The largest number of evaluations of a run of L-BFGS-B, if the objective itself proposes
    steps between such runs."""
    little: float = 1e-6
    """An ascent ends after a run of L-BFGS-B that gains less than this in log-likelihood."""
    digits: float = 1e-11
    """A run of L-BFGS-B ends when a step gains less than this share of the log-likelihood."""
    memory: int = 20
    """The number of past steps from which L-BFGS-B estimates the curvature."""
    finest: float = 1e6
    """A standard error is not taken smaller than the distance of the limits divided by this; where
    they are very wide, not smaller than the size of the value divided by this."""


CLIMBS = ClimbSettings()


@dataclass(frozen=True, eq=False)
class Reached:
    """An optimum at alpha (K,) that an ascent over the `free` (F,) hyperparameters has reached.

    `at` is the log-likelihood there with its scores.
    """

    alpha: Array
    at: LogLikelihood
    free: Indices
    settings: ClimbSettings = CLIMBS

    def joins(self, alpha: Array, at: LogLikelihood) -> bool:
        """Whether an ascent from alpha, with log-likelihood `at`, would only end here again."""
        if not self._tells:
            return False
        step = self.alpha - alpha
        gain, along = self.at.total - at.total, self._scores @ step[self.free]
        predicted = 0.5 * float((self.at.score + at.score) @ step)
        return bool(
            along @ along < self.settings.near**2 and abs(gain - predicted) < self.settings.agrees
        )

    @property
    def _scores(self) -> Array:
        assert self.at.scores is not None
        return self.at.scores[:, self.free]

    @cached_property
    def _tells(self) -> bool:
        """Whether the scores determine a standard error in every direction.

        That takes more than F experiments, whose scores are linearly independent.
        """
        size = np.sqrt(np.sum(self._scores**2, axis=0))
        if len(self._scores) <= self.free.size or not np.all(size > 0.0):
            return False
        return bool(np.linalg.matrix_rank(self._scores / size) == self.free.size)


def joined(reached: Sequence[Reached], alpha: Array, at: LogLikelihood) -> Reached | None:
    """The optimum among `reached` at which an ascent from alpha would end, or None."""
    return next((one for one in reached if one.joins(alpha, at)), None)


def approached(
    objective: CountedObjective,
    coordinates: Coordinates,
    start: Array,
    most: int,
    settings: ClimbSettings = CLIMBS,
) -> tuple[Array, int]:
    """The best alpha (K,) after steps that the objective itself proposes, and the evaluations made.

    It is `start` where no step gains, or where the objective proposes none (see `Guiding`).
    """
    best, alpha, value = start, start, -np.inf
    for count in range(min(settings.guided_steps, most)):
        found = objective.expectation_step(alpha)
        if found is None:
            return start, 0
        gain = found[0] - value
        if gain > 0.0:
            best, value = alpha, found[0]
        if gain < settings.guided_gain:
            return best, count + 1
        alpha = coordinates.filled(found[1][coordinates.free])
    return best, max(min(settings.guided_steps, most), 0)


def starting_points(
    coordinates: Coordinates,
    guesses: Sequence[Array],
    count: int,
    seed: int,
    settings: StartSettings = STARTS,
) -> Array:
    """The starts of a search, alphas (count, K): start values, guesses, scrambled Sobol' points.

    A larger number of starts begins with the same ones. A guess that is given twice is one start.

    Where limits are a million times wider than the size of every guess, points spread evenly
    between them would all be far from any plausible value. There the points lie at distances of all
    orders of magnitude from the guesses.
    """
    given = coordinates.filled(
        np.array([a[coordinates.free] for a in (coordinates.start, *guesses)])
    )
    known = given[np.sort(np.unique(given, axis=0, return_index=True)[1])]
    missing = count - len(known)
    if missing <= 0:
        return known[:count]
    # Starts keep away from the limits, where a search gains little.
    spread = settings.margin + (1.0 - 2.0 * settings.margin) * evenly(
        coordinates.free.size, missing, seed
    )
    points = coordinates.to_alpha(spread)
    if guesses:
        centers = given[1:][np.arange(missing) % len(guesses)]
        free = _around(coordinates, given[1:], centers, points, spread, settings)
        points = coordinates.filled(free)
    return np.concatenate([known, points])


def evenly(dimensions: int, count: int, seed: int) -> Array:
    """Scrambled Sobol' points (count, dimensions) in the unit cube.

    >>> evenly(2, 4, seed=0).round(0).sum(axis=0).tolist()  # two in either half
    [2.0, 2.0]
    """
    sobol = qmc.Sobol(dimensions, rng=np.random.default_rng(seed))
    return np.asarray(sobol.random_base2(int(np.ceil(np.log2(count))))[:count])


def _around(
    coordinates: Coordinates,
    guesses: Array,
    centers: Array,
    points: Array,
    spread: Array,
    settings: StartSettings = STARTS,
) -> Array:
    """The free entries of starting points, moved near the guesses where limits are very wide."""
    free, middle = points[:, coordinates.free], centers[:, coordinates.free]
    width = coordinates.upper - coordinates.lower
    size = np.max(np.abs(guesses[:, coordinates.free]), axis=0)
    wide = ~coordinates.log & outsized(width, size)
    nearest = settings.nearest * np.where(wide, size, width)
    share = np.abs(2.0 * spread - 1.0)
    distance = nearest * (width / nearest) ** share * np.sign(spread - 0.5)
    return np.where(wide, middle + distance, free)


def climb(
    objective: CountedObjective,
    coordinates: Coordinates,
    start: Array,
    evaluations: int,
    reached: list[Reached],
    settings: ClimbSettings = CLIMBS,
) -> Ascent:
    """A local ascent from the alpha `start` (K,) with at most so many evaluations.

    The variables are in units of standard errors, which the outer product of the scores estimates.
    Far from the maximum this estimate is poor. Where it no longer holds at the end of a run of
    L-BFGS-B (a leg), another leg begins there with new units. Steps that the objective itself
    proposes (see `Guiding`) are tried before every leg. An ascent that comes close to an optimum in
    `reached` ends with that optimum; otherwise its end is added to `reached`.
    """
    alpha, spent = approached(objective, coordinates, start, evaluations - 1, settings)
    at, count, settled = objective(alpha), spent + 1, False
    if at.total <= objective.floor:
        return Ascent(start, start, -np.inf, count, converged=False)
    while not settled:
        left = evaluations - count
        most = min(left, settings.leg) if spent else left
        leg = _Leg(objective, coordinates, alpha, at, most, reached, settings)
        arrived = leg.run()
        gain, count = leg.best.total - at.total, count + leg.count
        if leg.joined is not None:
            return Ascent(start, leg.joined.alpha, leg.joined.at.total, count, converged=True)
        alpha, at = leg.highest, leg.best
        little = gain < max(settings.little, objective.resolution)
        done = little or _settled(coordinates, alpha, at, objective.resolution, settings)
        settled = done if arrived else leg.count >= left
        if spent and not settled:
            ahead, spent = approached(
                objective, coordinates, alpha, evaluations - count - 1, settings
            )
            count += spent
            if ahead is not alpha:
                alpha, at, count = ahead, objective(ahead), count + 1
    if arrived:
        reached.append(Reached(alpha, at, coordinates.free, settings))
    return Ascent(start, alpha, at.total, count, arrived)


class _Leg:
    """A run of L-BFGS-B in units of the standard errors at its start; it keeps its best point."""

    def __init__(
        self,
        objective: CountedObjective,
        coordinates: Coordinates,
        start: Array,
        at: LogLikelihood,
        most: int,
        reached: Sequence[Reached],
        settings: ClimbSettings = CLIMBS,
    ) -> None:
        self._objective, self._coordinates, self._most = objective, coordinates, most
        self._reached, self.joined = reached, joined(reached, start, at)
        self._start, self._at, self._least = start, at, at.total
        self._scale, self._settings = _scale(coordinates, at, start, settings), settings
        self.highest, self.best, self.count = start, at, 0

    def run(self) -> bool:
        """Run L-BFGS-B; return whether it converged in its evaluations, or joined an optimum."""
        if self.joined is not None:
            return True
        unit, resolution = self._coordinates.to_unit(self._start), self._objective.resolution
        try:
            end = optimize.minimize(
                self._negative,
                np.zeros_like(unit),
                jac=True,
                method="L-BFGS-B",
                bounds=list(zip(-unit / self._scale, (1.0 - unit) / self._scale, strict=True)),
                options={
                    "ftol": max(self._settings.digits, resolution / max(1.0, abs(self._at.total))),
                    "gtol": max(self._settings.flat, resolution**0.5),
                    "maxcor": self._settings.memory,
                },
            )
        except _EndedError:
            return self.joined is not None
        return bool(end.success)

    def _negative(self, v: Array) -> tuple[float, Array]:
        moved = self._coordinates.moved(self._start, v * self._scale)
        alpha = moved if np.any(v) else self._start
        result = self._at if np.array_equal(alpha, self._start) else self._asked(alpha)
        if result.total <= self._objective.floor:
            # Without a finite value the line search gets a value worse than all before, so that it
            # turns back.
            return 1.0 + self.best.total - 2.0 * self._least, np.zeros_like(v)
        self._least = min(self._least, result.total)
        if result.total > self.best.total:
            self.highest, self.best = alpha, result
            self.joined = joined(self._reached, alpha, result)
            if self.joined is not None:
                raise _EndedError
        return -result.total, -self._coordinates.gradient(alpha, result.score) * self._scale

    def _asked(self, alpha: Array) -> LogLikelihood:
        if self.count >= self._most:
            # L-BFGS-B does not check its own limit within a line search.
            raise _EndedError
        self.count += 1
        return self._objective(alpha)


def _settled(
    coordinates: Coordinates,
    alpha: Array,
    at: LogLikelihood,
    resolution: float,
    settings: ClimbSettings = CLIMBS,
) -> bool:
    """Whether the slope in every direction is too small for another run of L-BFGS-B.

    Directions that lead beyond the limits do not count.
    """
    slope = coordinates.gradient(alpha, at.score) * _scale(coordinates, at, alpha, settings)
    unit = coordinates.to_unit(alpha)
    outward = ((unit <= 0.0) & (slope < 0.0)) | ((unit >= 1.0) & (slope > 0.0))
    level = max(settings.settled, settings.noise * resolution**0.5)
    return bool(np.all((np.abs(slope) < level) | outward))


def _scale(
    coordinates: Coordinates, at: LogLikelihood, alpha: Array, settings: ClimbSettings = CLIMBS
) -> Array:
    """Standard errors (F,) in coordinates u, from the outer product of the scores at alpha."""
    assert at.scores is not None
    with np.errstate(over="ignore"):
        each = coordinates.gradient(alpha, at.scores)
        information = np.sum(each**2, axis=0)
    # A standard error is at most the range of a variable, and not negligible beside its value.
    size = np.abs(alpha[coordinates.free])
    width = coordinates.upper - coordinates.lower
    wide = ~coordinates.log & outsized(width, size)
    finest = settings.finest * np.where(wide, width, 1.0) / np.where(wide, size, 1.0)
    return np.asarray(1.0 / np.clip(np.sqrt(information), 1.0, finest))


class _EndedError(Exception):
    """Ends a run of L-BFGS-B whose evaluations are used up, or that joins a known optimum."""


@dataclass(frozen=True)
class GradientMultistart(TaskSearch):
    """Bounded quasi-Newton ascents (L-BFGS-B) with the exact score, from `starts` points or more.

    The starts are the start values of the hyperparameters, guesses that the caller gives, and
    scrambled Sobol' points between the limits. A maximum that only one ascent found need not be the
    highest. Therefore, if `starts` is above one, further ascents follow until a second one reaches
    the best log-likelihood, up to `most` in all (default: three times `starts`). Variables are
    scaled by the outer product of the scores, which estimates the information matrix. Each ascent
    has at most `evaluations` evaluations; if it needs more, it ends as not converged. Raises
    InputsError for values below one, for `most` below `starts`, and where the log-likelihood is not
    finite at any start.

    >>> GradientMultistart(starts=5).name
    'gradient_multistart(5)'
    """

    starts: int = 10
    evaluations: int = 60
    most: int | None = None

    def __post_init__(self) -> None:
        if self.starts < 1 or self.evaluations < 1:
            raise InputsError(
                f"search: starts {self.starts} and evaluations {self.evaluations}",
                "both must be at least 1; 10 starts find most second optima",
            )
        if self.most is not None and self.most < self.starts:
            raise InputsError(
                f"search: most {self.most}, and {self.starts} starts",
                "let most be as many starts as there may be in all, or leave it out",
            )

    @property
    def name(self) -> str:
        """The name of this search in a result."""
        return f"gradient_multistart({self.starts})"

    def _search(self, task: Task) -> SearchResult:
        """Make an ascent from every start, and gather the distinct optima, best first."""
        ascents: list[Ascent] = []
        reached: list[Reached] = []
        most = self.most or (3 * self.starts if self.starts > 1 else 1)
        counted, free = task.counted, task.coordinates.free
        for start in starting_points(task.coordinates, task.guesses, most, task.seed):
            if len(ascents) >= self.starts and not reached_once(ascents, counted, free):
                break
            ascents.append(climb(task.counted, task.coordinates, start, self.evaluations, reached))
            count = self.starts if len(ascents) <= self.starts else most
            text = f"start {len(ascents)} of {count}, {task.counted.standing}"
            task.progress.update(text, len(ascents), count)
        found = gathered(ascents, task.counted, task.hyperparameters)
        return replace(found, once=most > 1 and reached_once(ascents, counted, free))


@dataclass(frozen=True)
class WarmStart:
    """Ascents from a known optimum `alpha` (K,), the start values and a guess, three in all.

    It is used for a costly likelihood, after a search of a cheaper one that is almost the same.
    It finds only optima near those starts.

    >>> import numpy as np
    >>> WarmStart(np.array([1.0])).name
    'warm_start(3)'
    """

    alpha: Array

    @property
    def name(self) -> str:
        """The name of this search in a result."""
        return f"warm_start({self._multistart.starts})"

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """The result of the three ascents; raises the errors of `GradientMultistart`."""
        known = [self.alpha, *guesses]
        found = self._multistart.maximize(
            objective, hyperparameters, seed=seed, guesses=known, progress=progress
        )
        return replace(found, method=self.name)

    @property
    def _multistart(self) -> GradientMultistart:
        return GradientMultistart(3, most=3)
