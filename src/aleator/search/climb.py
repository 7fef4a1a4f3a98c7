"""One quasi-Newton ascent (L-BFGS-B) on the exact score within the limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import optimize

from aleator.search.approach import approached
from aleator.search.coordinates import Coordinates
from aleator.search.counted import FLOOR, CountedObjective
from aleator.search.interface import Ascent
from aleator.search.joining import Reached, joined
from aleator.search.limits import outsized
from aleator.search.value import LogLikelihood
from aleator.types import Array

FLAT = 1e-4
"""Slope, in log-likelihood a standard error of the leg's own start, at which a leg ends."""
SETTLED = 1e-3
"""... of the leg's end, above which another leg follows: other starts may join this one."""
NOISE = 5.0
"""Roots of the objective's resolution below which a slope is none."""
LEG = 10
"""Evaluations of a leg, where the objective knows a way of its own that may be tried again."""
LITTLE = 1e-6
"""A leg that gains less than this in log-likelihood is the last."""


def climb(
    objective: CountedObjective,
    coordinates: Coordinates,
    start: Array,
    evaluations: int,
    reached: list[Reached],
) -> Ascent:
    """Climb from the alpha `start` (K,) with at most so many evaluations.

    The variables are steps in units of the standard errors, as the outer product of the scores
    estimates them. Far from the maximum that estimate is poor: where it no longer holds at the
    end, another leg begins there in new units. Where the objective knows a way of its own (see
    `Guiding`), it is tried before every leg. A climb that joins one of those that `reached` an
    optimum ends with it; the end of any other is added to them.
    """
    alpha, spent = approached(objective, coordinates, start, evaluations - 1)
    at, count, settled = objective(alpha), spent + 1, False
    if at.total <= FLOOR:
        return Ascent(start, start, -np.inf, count, converged=False)
    while not settled:
        left = evaluations - count
        leg = _Leg(objective, coordinates, alpha, at, min(left, LEG) if spent else left, reached)
        arrived = leg.run()
        gain, count = leg.best.total - at.total, count + leg.count
        if leg.joined is not None:
            return Ascent(start, leg.joined.alpha, leg.joined.at.total, count, converged=True)
        alpha, at = leg.highest, leg.best
        little = gain < max(LITTLE, objective.resolution)
        done = little or _settled(coordinates, alpha, at, objective.resolution)
        settled = done if arrived else leg.count >= left
        if spent and not settled:
            ahead, spent = approached(objective, coordinates, alpha, evaluations - count - 1)
            count += spent
            if ahead is not alpha:
                alpha, at, count = ahead, objective(ahead), count + 1
    if arrived:
        reached.append(Reached(alpha, at, coordinates.free))
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
    ) -> None:
        self._objective, self._coordinates, self._most = objective, coordinates, most
        self._reached, self.joined = reached, joined(reached, start, at)
        self._start, self._at, self._least = start, at, at.total
        self._scale = _scale(coordinates, at, start)
        self.highest, self.best, self.count = start, at, 0

    def run(self) -> bool:
        """Whether it came to its own end within the evaluations."""
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
                    "ftol": max(1e-11, resolution / max(1.0, abs(self._at.total))),
                    "gtol": max(FLAT, resolution**0.5),
                    "maxcor": 20,
                },
            )
        except _EndedError:
            return self.joined is not None
        return bool(end.success)

    def _negative(self, v: Array) -> tuple[float, Array]:
        moved = self._coordinates.moved(self._start, v * self._scale)
        alpha = moved if np.any(v) else self._start
        result = self._at if np.array_equal(alpha, self._start) else self._asked(alpha)
        if result.total <= FLOOR:
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


def _settled(coordinates: Coordinates, alpha: Array, at: LogLikelihood, resolution: float) -> bool:
    """Whether no direction within the limits has a slope worth another leg."""
    slope = coordinates.gradient(alpha, at.score) * _scale(coordinates, at, alpha)
    unit = coordinates.to_unit(alpha)
    outward = ((unit <= 0.0) & (slope < 0.0)) | ((unit >= 1.0) & (slope > 0.0))
    level = max(SETTLED, NOISE * resolution**0.5)
    return bool(np.all((np.abs(slope) < level) | outward))


def _scale(coordinates: Coordinates, at: LogLikelihood, alpha: Array) -> Array:
    """Standard errors (F,) in u, by the outer product of the scores at alpha."""
    assert at.scores is not None
    with np.errstate(over="ignore"):
        each = coordinates.gradient(alpha, at.scores)
        information = np.sum(each**2, axis=0)
    # no variable is scaled to more than its whole range, nor to nothing beside its own value
    size = np.abs(alpha[coordinates.free])
    width = coordinates.upper - coordinates.lower
    wide = ~coordinates.log & outsized(width, size)
    finest = 1e6 * np.where(wide, width, 1.0) / np.where(wide, size, 1.0)
    return np.asarray(1.0 / np.clip(np.sqrt(information), 1.0, finest))


class _EndedError(Exception):
    """All evaluations of a start are used up, or the rest of its way is known."""
