"""Intervals from the profile of the likelihood, which need not be symmetric nor have a curvature.

The interval of one hyperparameter holds the values v for which the largest log-likelihood with
that hyperparameter fixed at v is within chi2_1(0.95)/2 = 1.92 of the maximum (Wilks, 1938; the
MINOS errors of James and Roos, 1975). It stays meaningful where a standard deviation is
weakly determined or lies on its limit, where the quadratic approximation does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from aleator.core.types import Array, Flags, Indices
from aleator.inference.information import INTERVALS, Inference
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search import Objective
from aleator.search.interface import LogLikelihood, Scored, objective_of, reach_of
from aleator.search.newton import Summit, ascended, on_limits, positive
from aleator.search.objective import CountedObjective


@dataclass(frozen=True)
class BracketSettings:
    """How the next value is chosen, and when a profile jumps; by judgement.

    Distances are those from the maximum, enclosures the distance of the inner and the outer value.

    farthest: times the distance so far that a step outward may reach. nearest: times the distance
    so far that it reaches at least. outward: the same of a step without the help of a slope.
    beyond: times the target at which such a step aims, so that it passes it. least: the root is
    taken to be at least so large there.
    near, jump: share of the distance and growth of the root; a smaller enclosure over which the
    root grows by more is odd. closed: share of the distance; a smaller enclosure is one point, and
    there is a jump.
    newton: share of the enclosure at either end in which Newton's step is not trusted.
    margin: share of the enclosure that the next value stays away from either end.
    """

    farthest: float = 3.0
    nearest: float = 1.02
    outward: float = 1.2
    beyond: float = 1.1
    least: float = 0.3
    near: float = 0.05
    jump: float = 0.5
    closed: float = 1e-3
    newton: float = 0.02
    margin: float = 0.05


BRACKET = BracketSettings()


@dataclass(frozen=True)
class Bracket:
    """The values that enclose an end of an interval, on one side of a maximum at `center`.

    `inner` and `outer` are values with their roots below and above the target; `outer` is NaN
    until one was found. `stalled` counts the steps that did not halve the enclosure.
    """

    target: float
    center: float
    limit: float
    inner: tuple[float, float]
    outer: tuple[float, float] = (float("nan"), float("nan"))
    stalled: int = 0
    settings: BracketSettings = BRACKET

    @classmethod
    def from_center(cls, center: float, limit: float, target: float) -> Bracket:
        """A bracket of which only the maximum is known."""
        return cls(target, center, limit, (center, 0.0))

    @property
    def closed(self) -> bool:
        """Whether inner and outer value coincide: the root jumps over its target."""
        gap = abs(self.outer[0] - self.inner[0])
        least = self.settings.closed * abs(self.outer[0] - self.center)
        return bool(gap <= max(least, np.finfo(float).tiny))

    @property
    def jumps(self) -> bool:
        """Whether the root seems to jump, so that its outer value may be of a lower maximum."""
        gap = abs(self.outer[0] - self.inner[0])
        near = gap < self.settings.near * abs(self.outer[0] - self.center)
        grown = self.outer[1] - self.inner[1]
        return bool(grown < np.inf and (self.closed or (near and grown > self.settings.jump)))

    @property
    def without_outer(self) -> Bracket:
        """The bracket without its outer value."""
        return replace(self, outer=(float("nan"), float("nan")), stalled=0)

    def with_root(self, value: float, root: float) -> Bracket:
        """The bracket with the root at one more value; inf where there is no likelihood."""
        if root < self.target:
            found = replace(self, inner=(value, root))
        else:
            found = replace(self, outer=(value, root))
        before, after = (abs(b.outer[0] - b.inner[0]) for b in (self, found))
        return replace(found, stalled=found.stalled + 1 if after > 0.5 * before else 0)

    def next(self, value: float, root: float, slope: float) -> float:
        """The next value to evaluate; `slope` is the score at the last one.

        Newton's step on the root, which grows about linearly with the distance. Where its slope is
        of no use a secant, a middle, or a step outward, at most threefold.
        """
        # the profile's slope is the score of what is held (envelope theorem); root^2/2 is its drop
        steep = -slope / root if 0.0 < root < np.inf else 0.0
        newton = value + (self.target - root) / steep if steep else float("nan")
        if not np.isfinite(self.outer[0]):
            return self._outward(newton)
        gap = self.outer[0] - self.inner[0]
        share = (newton - self.inner[0]) / gap if gap else float("nan")
        if not self.settings.newton <= share <= 1.0 - self.settings.newton:
            share = (self.target - self.inner[1]) / (self.outer[1] - self.inner[1])
        if self.stalled > 1 or not np.isfinite(self.outer[1]):
            share = 0.5
        margin = self.settings.margin
        return float(self.inner[0] + min(max(share, margin), 1.0 - margin) * gap)

    def _outward(self, newton: float) -> float:
        reach, chosen = self.inner[0] - self.center, self.settings
        aim = chosen.beyond * self.target / max(self.inner[1], chosen.least)
        factor = min(chosen.farthest, aim)
        nearest = self.center + chosen.nearest * reach
        farthest = self.center + chosen.farthest * reach
        if not min(nearest, farthest) <= newton <= max(nearest, farthest):
            newton = self.center + max(factor, chosen.outward) * reach
        return self.within(newton)

    def within(self, value: float) -> float:
        """The value, or the limit where it lies beyond."""
        return float(
            max(value, self.limit) if self.limit <= self.center else min(value, self.limit)
        )


TARGET = float(np.sqrt(stats.chi2.ppf(INTERVALS.level, 1)))
DROP = 0.5 * TARGET**2
"""How far the profile has dropped at the ends of an interval: 1.92 (Wilks, 1938)."""


@dataclass(frozen=True)
class EndSettings:
    """How exactly the end of an interval is computed; by judgement.

    `tests/inference/test_profile.py` holds the ends and the cost.

    close: standard errors to which an end is found: 0.02 in log-likelihood. climbed: what a
    conditional maximum is found to in log-likelihood, as far as its curvature is known.
    left: log-likelihood that may be left to climb to a conditional maximum that counts.
    trials: conditional maxima of an end, at most. no_maximum: the same where the answer is no
    maximum, and no end is reported. evaluations: those of an end, as many as of five others; where
    they are spent, it is not known. again: times that a conditional maximum is climbed to, at
    most, from where the last climb ended.
    impossible: a drop of the log-likelihood from where on the likelihood is zero.
    steeper: times the root expected at a value above which a conditional maximum is sought from
    elsewhere. distance: standard errors that a guess may lie from what is known; where the
    likelihood has a kink, the parabola leads nowhere. beyond: times the root of an end beyond
    which a conditional maximum is not built upon. fair: log-likelihood; a guess that is less below
    the maximum is climbed from, without a look at others.
    better: log-likelihood; a conditional maximum so far above the maximum means that the search
    had missed it. first: share of the distance to the limit at which an end is first sought, where
    there is no standard error.
    """

    close: float = 0.01
    climbed: float = 2e-3
    left: float = 0.02
    trials: int = 40
    no_maximum: int = 8
    evaluations: int = 250
    again: int = 3
    impossible: float = 1e9
    steeper: float = 2.5
    distance: float = 6.0
    beyond: float = 2.0
    fair: float = 10.0
    better: float = 0.01
    first: float = 0.2


ENDS = EndSettings()


@dataclass(frozen=True)
class End:
    """One end of an interval with its drop and conditional maximum (K,); or a `better` maximum."""

    value: float
    drop: float
    point: Array
    better: bool = False


@dataclass(frozen=True)
class Trace:
    """The profile of hyperparameter k; `follow` (F,) is the slope of the others along it.

    `top` is the maximum of the log-likelihood, `scores` (N, K) are those of the experiments there.
    `rivals` (K,) are other maxima: where an end would be, the profile may be that of their hill. A
    hill behind a valley is not reached: a warning tells of two maxima.
    """

    objective: Objective
    hyperparameters: Sequence[Hyperparameter]
    k: int
    moving: Indices
    information: Array
    follow: Array
    top: float
    scores: Array
    rivals: Sequence[Array] = ()
    settings: EndSettings = ENDS

    def end(self, alpha: Array, sign: float, inference: Inference, about: Array) -> End:
        """The end on one side, where the profile has dropped by 1.92; or a better maximum.

        It is sought from a point (K,) that is `about` there, if one is known; else that is NaN.
        """
        counted = CountedObjective(self.objective)
        return replace(self, objective=counted)._end(alpha, sign, inference, about, counted)

    def _end(
        self, alpha: Array, sign: float, inference: Inference, about: Array, spent: CountedObjective
    ) -> End:
        h = self.hyperparameters[self.k]
        limit = h.lower if sign < 0 else h.upper
        if inference.at_bound[self.k] == ("lower" if sign < 0 else "upper"):
            return End(limit, 0.0, alpha)
        bracket = Bracket.from_center(alpha[self.k], limit, TARGET)
        inner = known = End(alpha[self.k], 0.0, alpha)
        information, value = self.information, self._first(bracket, sign, inference)
        if np.all(np.isfinite(about)) and about[self.k] != alpha[self.k]:
            value, known = about[self.k], replace(known, value=about[self.k], point=about)
        steep = 1.0 / inference.standard_error[self.k]
        doubted = float("nan")
        nearest = Summit(alpha, self.top, self.scores, self.information, 0.0)
        for _ in range(self._trials(inference)):
            guesses = self._best_first(alpha, known.point, inner.point, value, nearest)
            most = self.settings.steeper * steep * abs(value - alpha[self.k])
            if value == doubted:
                guesses, information, most = guesses[1:2], self.information, np.inf
            summit = self._summit(guesses, information, most)
            if value == doubted or abs(_root(self._drop(summit)) - TARGET) < self.settings.close:
                summit = self._above(summit, value)
            drop = self._drop(summit)
            if abs(_root(drop) - TARGET) < self.settings.close or (drop < DROP and value == limit):
                summit = self._verified(summit)
                drop = self._drop(summit)
            better = summit.value > self.top + self.settings.better
            here, root = End(value, drop, summit.alpha, better), _root(drop)
            if np.isfinite(root):
                nearest = summit
            if better or (root < TARGET and value == limit):
                return here
            if abs(root - TARGET) < self.settings.close and summit.gain < self.settings.left:
                return here
            if root < self.settings.beyond * TARGET:
                # what lies far below the maximum tells nothing of the curvature where the end is
                known, information = here, summit.information
                steep = root / abs(value - alpha[self.k])
            inner = here if root < TARGET else inner
            bracket = bracket.with_root(value, root)
            if bracket.jumps and bracket.outer[0] != doubted:
                value = doubted = bracket.outer[0]
                bracket = bracket.without_outer
                continue
            if bracket.closed:
                return inner
            if spent.evaluations > self.settings.evaluations:
                break
            value = bracket.next(value, root, float(summit.score[self.k]))
        return End(float("nan"), float("nan"), alpha)

    def _trials(self, inference: Inference) -> int:
        return self.settings.trials if inference.positive else self.settings.no_maximum

    def _drop(self, summit: Summit) -> float:
        """How far the profile has dropped at a summit; inf where the likelihood is no number."""
        # what little is left to climb is known well enough to be counted
        left = summit.gain if summit.gain < self.settings.left else 0.0
        drop = self.top - summit.value - left
        return drop if drop < self.settings.impossible else float("inf")

    def _summit(self, guesses: Sequence[Array], information: Array, most: float) -> Summit:
        """The conditional maximum; from each guess where the root there is larger than `most`."""
        best = self._arrived(guesses[0], information)
        if not _root(self._drop(best)) > most and best.gain < self.settings.left:
            return best
        for guess in guesses[1:]:
            again = self._arrived(guess, self.information)
            best = again if again.value > best.value or np.isnan(best.value) else best
        return best

    def _above(self, summit: Summit, value: float) -> Summit:
        """The conditional maximum, or that on the hill of a rival where this is higher."""
        for rival in self.rivals:
            other = self._arrived(self._beside(rival, value), self.information)
            summit = other if other.value > summit.value + self.settings.left else summit
        return summit

    def _arrived(self, guess: Array, information: Array) -> Summit:
        """The maximum climbed to from a guess; again from where a climb stopped too early."""
        summit = self._climbed(guess, information)
        for _ in range(self.settings.again - 1):
            if summit.gain < self.settings.left or not np.isfinite(summit.value):
                break
            before, summit = summit.value, self._climbed(summit.alpha, summit.outer(self.moving))
            if summit.value - before < self.settings.left:
                return replace(summit, gain=0.0)
        return summit

    def _verified(self, summit: Summit) -> Summit:
        """The summit, climbed on where the scores of the experiments say that more is left.

        Where nothing is gained by that, nothing was left.
        """
        information = summit.outer(self.moving)
        score = summit.score[self.moving]
        limits = limits_of(self.hyperparameters, self.moving)
        free = ~on_limits(summit.alpha[self.moving], score, *limits)
        inside = information[np.ix_(free, free)]
        left = 0.5 * float(score[free] @ np.linalg.lstsq(inside, score[free])[0])
        if left < self.settings.left:
            return summit
        again = self._climbed(summit.alpha, information)
        if again.value - summit.value < self.settings.left:
            return replace(summit, gain=min(summit.gain, again.gain))
        return replace(again, information=summit.information)

    def _climbed(self, guess: Array, information: Array) -> Summit:
        return ascended(
            self.objective, guess, self.hyperparameters, self.moving, information,
            self.settings.climbed, bent=True,
        )  # fmt: skip

    def _first(self, bracket: Bracket, sign: float, inference: Inference) -> float:
        reach = TARGET * inference.standard_error[self.k]
        if not np.isfinite(reach):
            reach = self.settings.first * abs(bracket.limit - bracket.center)
        return bracket.within(bracket.center + sign * reach)

    def _best_first(
        self, alpha: Array, known: Array, inner: Array, value: float, nearest: Summit
    ) -> list[Array]:
        """Guesses at a value, the best of them first where the first one is poor."""
        guesses = self._guesses(alpha, known, inner, value)
        if self._below(guesses[0]) < self.settings.fair:
            return guesses
        guesses.append(self._tangent(nearest, value))
        best = int(np.argmin([self._below(guess) for guess in guesses]))
        return [guesses[best], *guesses[:best], *guesses[best + 1 :]]

    def _below(self, guess: Array) -> float:
        """How far the log-likelihood at a guess lies below the maximum."""
        return float(np.nan_to_num(self.top - self.objective(guess).total, nan=np.inf))

    def _guesses(self, alpha: Array, known: Array, inner: Array, value: float) -> list[Array]:
        """Guesses of the conditional maximum, the most plausible first."""
        along, beside = self._guess(alpha, known, value), self._beside(inner, value)
        error = np.sqrt(np.diag(np.linalg.pinv(self.information, hermitian=True)))
        lost = np.any(np.abs(along - known)[self.moving] > self.settings.distance * error)
        return [beside if lost else along, beside, self._guess(alpha, alpha, value)]

    def _tangent(self, summit: Summit, value: float) -> Array:
        """A guess from a conditional maximum along the ridge that the scores give."""
        information = summit.outer(np.append(self.moving, self.k))
        limits = limits_of(self.hyperparameters, self.moving)
        free = ~on_limits(summit.alpha[self.moving], summit.score[self.moving], *limits)
        moved = summit.alpha.copy()
        moved[self.k] = value
        rows = self.moving[free]
        inside = information[:-1, :-1][np.ix_(free, free)]
        along = -np.linalg.lstsq(inside, information[:-1, -1][free])[0]
        ahead = summit.alpha[rows] + along * (value - summit.alpha[self.k])
        moved[rows] = np.clip(ahead, limits[0][free], limits[1][free])
        return moved

    def _beside(self, point: Array, value: float) -> Array:
        """A point (K,) with the hyperparameter at another value."""
        moved = point.copy()
        moved[self.k] = value
        return moved

    def _guess(self, alpha: Array, known: Array, value: float) -> Array:
        """A guess along the parabola from the maximum through `known`.

        Its slope at the maximum is `follow`. From the maximum itself it is a straight line.
        """
        k, distance = self.k, value - alpha[self.k]
        moved = known[self.moving] - alpha[self.moving]
        so_far = known[k] - alpha[k]
        ahead = self.follow * distance
        if so_far != 0.0:
            ahead = ahead + (moved - self.follow * so_far) * (distance / so_far) ** 2
        guess = alpha.copy()
        limits = limits_of(self.hyperparameters, self.moving)
        guess[self.moving] = np.clip(alpha[self.moving] + ahead, *limits)
        guess[k] = value
        return guess


def _root(drop: float) -> float:
    return float(np.sqrt(max(2.0 * drop, 0.0)))


@dataclass(frozen=True)
class Profile:
    """Intervals (K, 2), NaN where fixed; `better` is a higher maximum met on the way.

    `drops` (K, 2) is how far the profile has dropped at each end, as it was evaluated there: 1.92,
    less at a limit that the experiments do not rule out, or at a jump. An end whose drop could not
    be had is NaN, and so is its drop. `points` (K, 2, K) are the conditional maxima at the ends.
    """

    intervals: Array
    drops: Array
    points: Array
    better: Array | None

    @classmethod
    def unknown_ends(cls, size: int) -> Profile:
        """A profile of `size` hyperparameters of which no end is known."""
        ends = np.full((size, 2), np.nan)
        return cls(ends, ends.copy(), np.full((size, 2, size), np.nan), None)

    def masked(self, wrong: Flags) -> Profile:
        """The profile without the ends (K, 2) that are wrong."""
        intervals, drops = (np.where(wrong, np.nan, ends) for ends in (self.intervals, self.drops))
        return replace(self, intervals=intervals, drops=drops)

    def joined(self, other: Profile, rows: Indices) -> Profile:
        """The profile with these rows of another profile."""
        found = Profile(self.intervals.copy(), self.drops.copy(), self.points.copy(), other.better)
        found.intervals[rows] = other.intervals[rows]
        found.drops[rows], found.points[rows] = other.drops[rows], other.points[rows]
        return found

    def unknown(self, identified: Indices) -> Indices:
        """Those of the hyperparameters (G,) of which an end is not known."""
        return identified[np.any(np.isnan(self.drops[identified]), axis=1)]


class _Remembering:
    """An objective that remembers the last alphas, since guesses are judged and climbed from."""

    def __init__(self, objective: Objective, size: int = 4) -> None:
        """`size` is the number of alphas that are kept."""
        self.values = objective.values
        self._size = size
        self._objective = objective
        self._last: dict[bytes, LogLikelihood] = {}

    def reach(self, alpha: Array, ahead: Array) -> float:
        """The share of a step that may be taken (see `reach_of`)."""
        return reach_of(self._objective, alpha, ahead)

    def __call__(self, alpha: Array) -> LogLikelihood:
        key = alpha.tobytes()
        if key not in self._last:
            if len(self._last) == self._size:
                del self._last[next(iter(self._last))]
            self._last[key] = self._objective(alpha)
        return self._last[key]


def profile_intervals(
    objective: Objective | Scored,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    only: Indices | None = None,
    rivals: Sequence[Array] = (),
    about: Array | None = None,
    settings: EndSettings = ENDS,
) -> Profile:
    """The profile-likelihood interval of every free hyperparameter at the maximum alpha (K,).

    Each end is found by Newton steps on the signed root of twice the drop in log-likelihood, which
    is linear where the likelihood is normal; its slope is the score. Conditional maxima are climbed
    to from a parabola through those before, with the curvature that these taught: two or three an
    end, of one to five evaluations each, and up to thirty where a ridge is curved. What was found
    is taken for an end when the profile, climbed to anew with the curvature that the scores of the
    experiments tell, has dropped by 1.92 -+ 0.02; a limit, when it was evaluated there and has
    dropped by less. Where the profile jumps, the end is the last value before. Where an end would
    be, other maxima that are not ruled out, `rivals` (K,), are climbed from too. Stops early, with
    `better` set, when a conditional maximum exceeds the maximum. `only` some hyperparameters; the
    others are NaN. Points (K, 2, K) that are `about` the ends, where they are known, save trials.
    """
    maximum, size = objective(alpha), alpha.size
    assert maximum.scores is not None
    climbed = _Remembering(objective_of(objective))
    known = np.full((size, 2, size), np.nan) if about is None else about
    found = Profile.unknown_ends(size)
    for row, k in enumerate(inference.identified):
        if only is not None and k not in only:
            continue
        others = np.delete(np.arange(inference.identified.size), row)
        moving = inference.identified[others]
        tied = _tied(inference)
        information, coupling = positive(tied[np.ix_(others, others)]), tied[others, row]
        # along the profile the others follow the one by -I_oo^-1 I_ok
        follow = -np.linalg.pinv(information, hermitian=True) @ coupling
        trace = Trace(
            climbed, hyperparameters, k, moving, information, follow, maximum.total,
            maximum.scores, rivals, settings,
        )  # fmt: skip
        for side, sign in enumerate((-1.0, 1.0)):
            end = trace.end(alpha, sign, inference, known[k, side])
            if end.better:
                return replace(found, better=end.point)
            found.intervals[k, side], found.drops[k, side] = end.value, end.drop
            found.points[k, side] = end.point
    return found


def _tied(inference: Inference) -> Array:
    """The information (G, G) without correlations of hyperparameters on a limit.

    With a standard deviation on its lower limit the likelihood need not bend down, and the inverse
    would lead all others far away.
    """
    free = np.array([inference.at_bound[k] is None for k in inference.identified], dtype=np.bool_)
    alone = np.diag(np.abs(np.diag(inference.information)))
    return np.asarray(np.where(np.outer(free, free), inference.information, alone))
