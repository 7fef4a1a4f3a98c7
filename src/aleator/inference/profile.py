"""Confidence intervals from the profile of the likelihood, which need not be symmetric.

The interval of a hyperparameter contains the values v for which the largest log-likelihood with
that hyperparameter fixed at v is within chi2_1(0.95)/2 = 1.92 of the maximum (Wilks, 1938; the
MINOS errors of James and Roos, 1975). It remains valid where a standard deviation is weakly
determined or lies on its limit, where the quadratic approximation is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Flags, Indices
from aleator.inference.information import INTERVALS, Inference
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search import Objective
from aleator.search.interface import LogLikelihood, Scored, objective_of, reach_of
from aleator.search.newton import Summit, ascended, on_limits, positive
from aleator.search.objective import CountedObjective


@dataclass(frozen=True)
class BracketSettings:
    """Settings of the root search for an interval's end. The values are chosen by judgement.

    The root is the square root of twice the drop of the profile log-likelihood below its maximum.
    The enclosure is the range between the inner value (root below its target) and the outer value
    (root above its target); the distance of a value is measured from the maximum.

    farthest: largest factor by which a step outward multiplies the distance.
    nearest: smallest factor of a step outward by Newton's method.
    outward: smallest factor of a step outward without Newton's method.
    beyond: factor on the target, so that a step without Newton's method passes the end.
    least: least root by which the length of such a step is computed.
    near, jump: the profile is suspected to jump where the root grows by more than `jump` over an
    enclosure that is smaller than the share `near` of the distance.
    closed: share of the distance; a smaller enclosure is a single point, where the profile jumps.
    newton: share of the enclosure next to either end in which Newton's step is not trusted.
    margin: share of the enclosure that the next value keeps away from either end.
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
    """The two values that enclose an end of an interval, on one side of a maximum at `center`.

    The root is the square root of twice the drop of the profile log-likelihood. `inner` and `outer`
    are pairs of a value and its root; the root of `inner` is below the `target`, that of `outer`
    above. `outer` is NaN until it is found. `stalled` counts the steps that did not halve the
    enclosure.
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
        """Whether inner and outer value coincide: the root jumps over its target there."""
        gap = abs(self.outer[0] - self.inner[0])
        least = self.settings.closed * abs(self.outer[0] - self.center)
        return bool(gap <= max(least, np.finfo(float).tiny))

    @property
    def jumps(self) -> bool:
        """Whether the root seems to jump: its outer value may belong to a lower local maximum."""
        gap = abs(self.outer[0] - self.inner[0])
        near = gap < self.settings.near * abs(self.outer[0] - self.center)
        grown = self.outer[1] - self.inner[1]
        return bool(grown < np.inf and (self.closed or (near and grown > self.settings.jump)))

    @property
    def without_outer(self) -> Bracket:
        """The bracket without its outer value."""
        return replace(self, outer=(float("nan"), float("nan")), stalled=0)

    def with_root(self, value: float, root: float) -> Bracket:
        """The bracket updated with the root at one more value; inf for zero likelihood."""
        if root < self.target:
            found = replace(self, inner=(value, root))
        else:
            found = replace(self, outer=(value, root))
        before, after = (abs(b.outer[0] - b.inner[0]) for b in (self, found))
        return replace(found, stalled=found.stalled + 1 if after > 0.5 * before else 0)

    def next(self, value: float, root: float, slope: float) -> float:
        """The next value to evaluate; `slope` is the score at the last one.

        It is Newton's step on the root, which grows about linearly with the distance from the
        maximum. Where Newton's step is not usable, a secant, the middle, or a step outward is
        taken; a step outward at most triples the distance.
        """
        # The slope of the profile is the score of the fixed hyperparameter (envelope theorem), and
        # root^2/2 is the drop of the profile.
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
        """The value, or the limit where the value lies beyond it."""
        return float(
            max(value, self.limit) if self.limit <= self.center else min(value, self.limit)
        )


TARGET = float(np.sqrt(stats.chi2.ppf(INTERVALS.level, 1)))
DROP = 0.5 * TARGET**2
"""The drop of the profile log-likelihood at the ends of an interval: 1.92 (Wilks, 1938)."""


@dataclass(frozen=True)
class EndSettings:
    """Settings of the computation of an interval's end. The values are chosen by judgement.

    `tests/inference/test_profile.py` checks the ends and the cost. A conditional maximum is the
    maximum over the other hyperparameters, with one hyperparameter fixed at a value. Its root is
    the square root of twice its drop below the overall maximum.

    close: tolerance of the root at an end: 0.01 standard errors, or 0.02 in log-likelihood.
    climbed: tolerance of a conditional maximum in log-likelihood, as far as the curvature is known.
    left: largest remaining rise, in log-likelihood, of a conditional maximum that is accepted.
    trials: largest number of conditional maxima for an end.
    no_maximum: largest number of conditional maxima where the result is not a maximum, so that no
    end is reported.
    evaluations: largest number of evaluations for an end, as many as five usual ends need; where it
    is reached, the end is unknown.
    again: largest number of searches for a conditional maximum, each from the end of the last one.
    impossible: drop of the log-likelihood from which the likelihood counts as zero.
    steeper: factor on the expected root; if a root is larger, other starting points are tried.
    distance: largest distance, in standard errors, of an extrapolated starting point from the last
    known point. Where the likelihood has a kink, the extrapolating parabola can lead far away.
    beyond: factor on the root of an end; conditional maxima with a larger root are not
    extrapolated.
    fair: drop in log-likelihood up to which the first starting point is used without comparing
    others.
    better: rise in log-likelihood above the maximum which means that the search had missed a
    maximum.
    first: share of the distance to the limit for the first trial where there is no standard error.
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
    """One end of an interval, with its drop and conditional maximum (K,); or a `better` maximum."""

    value: float
    drop: float
    point: Array
    better: bool = False


@dataclass(frozen=True)
class Trace:
    """The profile of hyperparameter k, by which the ends of its interval are computed.

    `moving` (F,) are the other free hyperparameters, and `follow` (F,) their derivatives along the
    profile. `top` is the maximum of the log-likelihood, and `scores` (N, K) are the experiments'
    scores there. `rivals` (K,) are other local maxima, from which the search is repeated where an
    end would be, since the profile may be higher there. A maximum that is separated by a valley is
    not included in the interval; a warning then reports the two maxima. `lower` and `upper` are the
    roots at the two ends.
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
    lower: float = TARGET
    upper: float = TARGET
    settings: EndSettings = ENDS

    def end(self, alpha: Array, sign: float, inference: Inference, about: Array) -> End:
        """The end on one side, where the root of the profile is the target; or a better maximum.

        The search starts at the point `about` (K,) if the end is known approximately; otherwise
        `about` is NaN.
        """
        counted = CountedObjective(self.objective)
        return replace(self, objective=counted)._end(alpha, sign, inference, about, counted)

    def _end(
        self, alpha: Array, sign: float, inference: Inference, about: Array, spent: CountedObjective
    ) -> End:
        h = self.hyperparameters[self.k]
        limit = h.lower if sign < 0 else h.upper
        target = self.lower if sign < 0 else self.upper
        if inference.at_bound[self.k] == ("lower" if sign < 0 else "upper"):
            return End(limit, 0.0, alpha)
        bracket = Bracket.from_center(alpha[self.k], limit, target)
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
            if value == doubted or abs(_root(self._drop(summit)) - target) < self.settings.close:
                summit = self._above(summit, value)
            drop = self._drop(summit)
            close = abs(_root(drop) - target) < self.settings.close
            if close or (_root(drop) < target and value == limit):
                summit = self._verified(summit)
                drop = self._drop(summit)
            better = summit.value > self.top + self.settings.better
            here, root = End(value, drop, summit.alpha, better), _root(drop)
            if np.isfinite(root):
                nearest = summit
            if better or (root < target and value == limit):
                return here
            if abs(root - target) < self.settings.close and summit.gain < self.settings.left:
                return here
            if root < self.settings.beyond * target:
                # A point far below the maximum has no information about the curvature at the end.
                known, information = here, summit.information
                steep = root / abs(value - alpha[self.k])
            inner = here if root < target else inner
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
        """The drop of the profile at a conditional maximum; inf if the likelihood is no number."""
        # The small remaining rise is known well enough to be included.
        left = summit.gain if summit.gain < self.settings.left else 0.0
        drop = self.top - summit.value - left
        return drop if drop < self.settings.impossible else float("inf")

    def _summit(self, guesses: Sequence[Array], information: Array, most: float) -> Summit:
        """The conditional maximum from the first guess; from all if its root exceeds `most`."""
        best = self._arrived(guesses[0], information)
        if not _root(self._drop(best)) > most and best.gain < self.settings.left:
            return best
        for guess in guesses[1:]:
            again = self._arrived(guess, self.information)
            best = again if again.value > best.value or np.isnan(best.value) else best
        return best

    def _above(self, summit: Summit, value: float) -> Summit:
        """The conditional maximum, or a higher one that is reached from a rival."""
        for rival in self.rivals:
            other = self._arrived(self._beside(rival, value), self.information)
            summit = other if other.value > summit.value + self.settings.left else summit
        return summit

    def _arrived(self, guess: Array, information: Array) -> Summit:
        """The maximum reached from a guess; the search is repeated where it stopped too early."""
        summit = self._climbed(guess, information)
        for _ in range(self.settings.again - 1):
            if summit.gain < self.settings.left or not np.isfinite(summit.value):
                break
            before, summit = summit.value, self._climbed(summit.alpha, summit.outer(self.moving))
            if summit.value - before < self.settings.left:
                return replace(summit, gain=0.0)
        return summit

    def _verified(self, summit: Summit) -> Summit:
        """The conditional maximum, improved if the experiments' scores predict a further rise.

        If this gains almost nothing, the smaller one of both estimates of the remaining rise is
        kept.
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
        reach = bracket.target * inference.standard_error[self.k]
        if not np.isfinite(reach):
            reach = self.settings.first * abs(bracket.limit - bracket.center)
        return bracket.within(bracket.center + sign * reach)

    def _best_first(
        self, alpha: Array, known: Array, inner: Array, value: float, nearest: Summit
    ) -> list[Array]:
        """Starting points for the conditional maximum at one value of the hyperparameter.

        If the first one is poor, the one of highest log-likelihood comes first.
        """
        guesses = self._guesses(alpha, known, inner, value)
        if self._below(guesses[0]) < self.settings.fair:
            return guesses
        guesses.append(self._tangent(nearest, value))
        best = int(np.argmin([self._below(guess) for guess in guesses]))
        return [guesses[best], *guesses[:best], *guesses[best + 1 :]]

    def _below(self, guess: Array) -> float:
        """The drop of the log-likelihood at a guess below the maximum."""
        return float(np.nan_to_num(self.top - self.objective(guess).total, nan=np.inf))

    def _guesses(self, alpha: Array, known: Array, inner: Array, value: float) -> list[Array]:
        """Guesses of the conditional maximum at one value, the most plausible first."""
        along, beside = self._guess(alpha, known, value), self._beside(inner, value)
        error = np.sqrt(np.diag(np.linalg.pinv(self.information, hermitian=True)))
        lost = np.any(np.abs(along - known)[self.moving] > self.settings.distance * error)
        return [beside if lost else along, beside, self._guess(alpha, alpha, value)]

    def _tangent(self, summit: Summit, value: float) -> Array:
        """A guess along the ridge from a conditional maximum, by the experiments' scores."""
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
        """A point (K,) that differs from `point` only in the value of hyperparameter k."""
        moved = point.copy()
        moved[self.k] = value
        return moved

    def _guess(self, alpha: Array, known: Array, value: float) -> Array:
        """A guess on the parabola from the maximum through the point `known`.

        The parabola's slope at the maximum is `follow`. If `known` is the maximum itself, the guess
        is on a straight line.
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
    """Profile intervals (K, 2), NaN where fixed; `better` is a higher maximum that was met.

    `drops` (K, 2) is the computed drop of the profile at each end. It is 1.92, or less at a limit
    that the experiments do not rule out, or at a jump. An end whose drop could not be computed is
    NaN, and so is its drop. `points` (K, 2, K) are the conditional maxima at the ends.

    For few experiments `targets` (K, 2) are the roots at the ends instead of 1.96, NaN where none
    is known and 1.96 is kept, and `unadjusted` (K, 2) are the intervals before.
    """

    intervals: Array
    drops: Array
    points: Array
    better: Array | None
    targets: Array | None = None
    unadjusted: Array | None = None

    @classmethod
    def unknown_ends(cls, size: int) -> Profile:
        """A profile of `size` hyperparameters for which no end is known."""
        ends = np.full((size, 2), np.nan)
        return cls(ends, ends.copy(), np.full((size, 2, size), np.nan), None)

    def masked(self, wrong: Flags) -> Profile:
        """The profile with the `wrong` ends (K, 2) replaced by NaN."""
        intervals, drops = (np.where(wrong, np.nan, ends) for ends in (self.intervals, self.drops))
        return replace(self, intervals=intervals, drops=drops)

    def joined(self, other: Profile, rows: Indices) -> Profile:
        """The profile with the given rows replaced by those of another profile."""
        wanted = np.zeros((len(self.drops), 1), dtype=np.bool_)
        wanted[rows] = True
        return replace(self.with_ends(other, wanted), better=other.better)

    def with_ends(self, other: Profile, wanted: Flags) -> Profile:
        """The profile with the `wanted` ends (K, 2), or (K, 1) for both, of another profile."""
        return replace(
            self,
            intervals=np.where(wanted, other.intervals, self.intervals),
            drops=np.where(wanted, other.drops, self.drops),
            points=np.where(wanted[..., None], other.points, self.points),
        )

    def unknown(self, identified: Indices) -> Indices:
        """The `identified` hyperparameters whose interval has an unknown end."""
        return identified[np.any(np.isnan(self.drops[identified]), axis=1)]


class _Remembering:
    """An objective that stores its last values: a search begins where a guess was compared."""

    def __init__(self, objective: Objective, size: int = 4) -> None:
        """`size` is the number of alphas whose values are stored."""
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
    progress: Progress | None = None,
    targets: Array | None = None,
    settings: EndSettings = ENDS,
) -> Profile:
    """The profile-likelihood interval of every free hyperparameter at the maximum alpha (K,).

    Each end is found by Newton steps on the signed root of twice the drop in log-likelihood. This
    root is linear where the likelihood is normal, and its slope follows from the score. The search
    for a conditional maximum starts on a parabola through the earlier ones and uses the curvature
    learned from them. An end needs two or three conditional maxima of one to five evaluations each,
    and up to thirty where a ridge is curved. A value counts as an end when the profile there has
    dropped by 1.92 -+ 0.02, after a renewed search with the curvature that the experiments' scores
    give. A limit is the end when the profile has dropped by less there. Where the profile jumps,
    the end is the last value before the jump. Where an end would be, the search also starts from
    other maxima that are not ruled out, `rivals` (K,).

    The search stops early, with `better` set, when a conditional maximum exceeds the maximum.
    `only` restricts it to some hyperparameters; the others are NaN. `about` (K, 2, K) are points
    near the ends, if known, which save trials. `progress` is told of each end as it begins.
    `targets` (K, 2) are the roots at the ends if these are not 1.96.
    """
    maximum, size, ends = objective(alpha), alpha.size, 2 * inference.identified.size
    assert maximum.scores is not None
    progress = progress or Silent()
    climbed = _Remembering(objective_of(objective))
    known = np.full((size, 2, size), np.nan) if about is None else about
    roots = np.full((size, 2), TARGET) if targets is None else targets
    found = Profile.unknown_ends(size)
    for row, k in enumerate(inference.identified):
        if only is not None and k not in only:
            continue
        others = np.delete(np.arange(inference.identified.size), row)
        moving = inference.identified[others]
        tied = _tied(inference)
        information, coupling = positive(tied[np.ix_(others, others)]), tied[others, row]
        # Along the profile the others move by -I_oo^-1 I_ok for each unit of the fixed
        # hyperparameter.
        follow = -np.linalg.pinv(information, hermitian=True) @ coupling
        trace = Trace(
            climbed, hyperparameters, k, moving, information, follow, maximum.total,
            maximum.scores, rivals, float(roots[k, 0]), float(roots[k, 1]), settings,
        )  # fmt: skip
        for side, sign in enumerate((-1.0, 1.0)):
            done, name = 2 * row + side, hyperparameters[k].name
            progress.update(f"end {done + 1} of {ends} of the intervals, {name}", done, ends)
            end = trace.end(alpha, sign, inference, known[k, side])
            if end.better:
                return replace(found, better=end.point)
            found.intervals[k, side], found.drops[k, side] = end.value, end.drop
            found.points[k, side] = end.point
    return found


def _tied(inference: Inference) -> Array:
    """The information (G, G), with zero correlation for hyperparameters on a limit.

    With a standard deviation on its lower limit the likelihood need not be concave, and the inverse
    of its information would move all other hyperparameters far away.
    """
    free = np.array([inference.at_bound[k] is None for k in inference.identified], dtype=np.bool_)
    alone = np.diag(np.abs(np.diag(inference.information)))
    return np.asarray(np.where(np.outer(free, free), inference.information, alone))
