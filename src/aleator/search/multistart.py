"""Climbs by quasi-Newton steps from several starts; the default search."""

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
    """Where starts lie; by judgement."""

    margin: float = 0.05
    """Share of the distance between limits that a start stays away from either."""
    nearest: float = 0.01
    """Least distance from a guess, over its size in wide limits, else over their distance."""


STARTS = StartSettings()


@dataclass(frozen=True)
class ClimbSettings:
    """Legs of a climb, their end, and when a climb joins another; by judgement."""

    near: float = 0.5
    """Standard errors (outer product of scores) within which two optima may be one."""
    agrees: float = 0.05
    """Optima within `near` are one, if the log-likelihood between them rises as the slopes at both
    ends say, to this error."""
    guided_gain: float = 1.0
    """Log-likelihood that a step of the objective itself (see `Guiding`) must gain for another one;
    near a maximum quasi-Newton steps are faster."""
    guided_steps: int = 10
    """The most steps of the objective itself."""
    flat: float = 1e-4
    """Slope, in log-likelihood a standard error of the leg's own start, at which a leg ends."""
    settled: float = 1e-3
    """Slope, in log-likelihood a standard error of the leg's end, above which another leg
    follows."""
    noise: float = 5.0
    """Roots of the objective's resolution below which a slope is none."""
    leg: int = 10
    """Evaluations of a leg, where steps of the objective itself may be tried again after it."""
    little: float = 1e-6
    """A leg that gains less than this in log-likelihood is the last."""
    digits: float = 1e-11
    """Relative gain of the log-likelihood at which a leg ends."""
    memory: int = 20
    """Steps from which L-BFGS-B learns the curvature."""
    finest: float = 1e6
    """Values are scaled to no less than their own size over this, where their limits are wide."""


CLIMBS = ClimbSettings()


@dataclass(frozen=True, eq=False)
class Reached:
    """An optimum alpha (K,) that an ascent over the `free` (F,) came to, and what is there."""

    alpha: Array
    at: LogLikelihood
    free: Indices
    settings: ClimbSettings = CLIMBS

    def joins(self, alpha: Array, at: LogLikelihood) -> bool:
        """Whether a climb from alpha, with this log-likelihood, would only end here again."""
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
        """Whether the scores give a distance: of more experiments than F, in every direction."""
        size = np.sqrt(np.sum(self._scores**2, axis=0))
        if len(self._scores) <= self.free.size or not np.all(size > 0.0):
            return False
        return bool(np.linalg.matrix_rank(self._scores / size) == self.free.size)


def joined(reached: Sequence[Reached], alpha: Array, at: LogLikelihood) -> Reached | None:
    """The optimum that a climb from alpha joins, if any."""
    return next((one for one in reached if one.joins(alpha, at)), None)


def approached(
    objective: CountedObjective,
    coordinates: Coordinates,
    start: Array,
    most: int,
    settings: ClimbSettings = CLIMBS,
) -> tuple[Array, int]:
    """The best alpha (K,) by steps of the objective itself from `start`, and how many evaluations.

    It is the start itself where no step gains, or the objective has none (see `Guiding`).
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
    """The hyperparameters' own start, the guesses, and scrambled Sobol' points: alphas (count, K).

    Of more starts the first are the same. A guess that is given twice is one start.

    Points of a box that is a million times wider than every guess is large would all be far from
    anything: there they lie at distances of every size from the guesses.
    """
    given = coordinates.filled(
        np.array([a[coordinates.free] for a in (coordinates.start, *guesses)])
    )
    known = given[np.sort(np.unique(given, axis=0, return_index=True)[1])]
    missing = count - len(known)
    if missing <= 0:
        return known[:count]
    # a start on a limit gives the search little
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
    """Scrambled Sobol' points (count, dimensions) of the unit cube.

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
    """The points' free entries; those of wide linear limits at any distance from a center."""
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
    """Climb from the alpha `start` (K,) with at most so many evaluations.

    The variables are steps in units of the standard errors, as the outer product of the scores
    estimates them. Far from the maximum that estimate is poor: where it no longer holds at the end,
    another leg begins there in new units. Where the objective has steps of its own (see `Guiding`),
    these are tried before every leg. A climb that joins one of those that `reached` an optimum ends
    with it; the end of any other is added to them.
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
    """A run of L-BFGS-B in the units of its start, which remembers its highest point."""

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
        """Whether the method ended by itself within the evaluations."""
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
            # no number: the line search sees less than all it has met, and comes back
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
            # the method's own limit is not looked at within a line search
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
    """Whether no direction within the limits has a slope worth another leg."""
    slope = coordinates.gradient(alpha, at.score) * _scale(coordinates, at, alpha, settings)
    unit = coordinates.to_unit(alpha)
    outward = ((unit <= 0.0) & (slope < 0.0)) | ((unit >= 1.0) & (slope > 0.0))
    level = max(settings.settled, settings.noise * resolution**0.5)
    return bool(np.all((np.abs(slope) < level) | outward))


def _scale(
    coordinates: Coordinates, at: LogLikelihood, alpha: Array, settings: ClimbSettings = CLIMBS
) -> Array:
    """Standard errors (F,) in u, by the outer product of the scores at alpha."""
    assert at.scores is not None
    with np.errstate(over="ignore"):
        each = coordinates.gradient(alpha, at.scores)
        information = np.sum(each**2, axis=0)
    # no variable is scaled to more than its whole range, nor to nothing beside its own value
    size = np.abs(alpha[coordinates.free])
    width = coordinates.upper - coordinates.lower
    wide = ~coordinates.log & outsized(width, size)
    finest = settings.finest * np.where(wide, width, 1.0) / np.where(wide, size, 1.0)
    return np.asarray(1.0 / np.clip(np.sqrt(information), 1.0, finest))


class _EndedError(Exception):
    """All evaluations of a start are used up, or the rest of its way is known."""


@dataclass(frozen=True)
class GradientMultistart(TaskSearch):
    """Bounded quasi-Newton (L-BFGS-B) on the exact score from `starts` points or more.

    The starts are the hyperparameters' own start, the guesses of the baselines, and scrambled
    Sobol' points of the limits. Of several starts, more follow until a second one comes to the best
    log-likelihood, `most` in all (three times `starts` where left out): a maximum that one start
    found need not be the highest. Variables are scaled by the outer product of the scores at the
    start, which is the information matrix's estimate there. At most `evaluations` of the
    log-likelihood a start; a start that needs more ends as not converged. Raises InputsError for
    values below one, for `most` below `starts`, and where the log-likelihood is not finite at any
    start.

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
        """How the result names this choice."""
        return f"gradient_multistart({self.starts})"

    def _search(self, task: Task) -> SearchResult:
        """Climb from every start and gather the distinct optima, best first."""
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
    """Climb from `alpha` (K,), the hyperparameters' start and a guess: `GradientMultistart(3)`.

    For a likelihood that costs much, after a search of a cheaper one that is nearly the same. It
    finds no optimum that the other search did not lead to; whether only one start of that search
    reached it is `once`.

    >>> import numpy as np
    >>> WarmStart(np.array([1.0])).name
    'gradient_multistart(3)'
    """

    alpha: Array
    once: bool = False

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return self._multistart.name

    def maximize(
        self,
        objective: Objective | Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """The best of the three ends; errors as `GradientMultistart`."""
        known = [self.alpha, *guesses]
        found = self._multistart.maximize(
            objective, hyperparameters, seed=seed, guesses=known, progress=progress
        )
        return replace(found, once=self.once)

    @property
    def _multistart(self) -> GradientMultistart:
        return GradientMultistart(3, most=3)
