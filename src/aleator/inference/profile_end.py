"""One end of an interval: where the profile of the likelihood has dropped by 1.92."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from aleator.core.types import Array, Indices
from aleator.inference.bracket import Bracket
from aleator.inference.information import INTERVALS, Inference
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search import Objective
from aleator.search.newton import Summit, ascended, on_limits
from aleator.search.objective import CountedObjective

TARGET = float(np.sqrt(stats.chi2.ppf(INTERVALS.level, 1)))
DROP = 0.5 * TARGET**2
"""How far the profile has dropped at the ends of an interval: 1.92 (Wilks, 1938)."""


@dataclass(frozen=True)
class EndSettings:
    """How exactly the end of an interval is found; by judgement.

    `tests/inference/test_profile_ends.py` and `test_profile_cost.py` hold the ends and the cost.

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
    """One end, the drop (), and the conditional maximum (K,); or a `better` maximum."""

    value: float
    drop: float
    point: Array
    better: bool = False


@dataclass(frozen=True)
class Trace:
    """The profile of hyperparameter k; `follow` (F,) is how the moving ones go along.

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
        """Where the profile has dropped by 1.92 on one side, or a better maximum.

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
        bracket = Bracket.around(alpha[self.k], limit, TARGET)
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
        """The conditional maximum; where the root there is larger than `most`, from each guess."""
        best = self._arrived(guesses[0], information)
        if not _root(self._drop(best)) > most and best.gain < self.settings.left:
            return best
        for guess in guesses[1:]:
            again = self._arrived(guess, self.information)
            best = again if again.value > best.value or np.isnan(best.value) else best
        return best

    def _above(self, summit: Summit, value: float) -> Summit:
        """The conditional maximum, or that of the hill of a rival where this is higher."""
        for rival in self.rivals:
            other = self._arrived(self._beside(rival, value), self.information)
            summit = other if other.value > summit.value + self.settings.left else summit
        return summit

    def _arrived(self, guess: Array, information: Array) -> Summit:
        """Climbed from a guess, and anew where a climb ended below the maximum."""
        summit = self._climbed(guess, information)
        for _ in range(self.settings.again - 1):
            if summit.gain < self.settings.left or not np.isfinite(summit.value):
                break
            before, summit = summit.value, self._climbed(summit.alpha, summit.outer(self.moving))
            if summit.value - before < self.settings.left:
                return replace(summit, gain=0.0)
        return summit

    def _verified(self, summit: Summit) -> Summit:
        """Climbed on, where the scores of the experiments tell of more to climb than the steps.

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
            self.objective,
            guess,
            self.hyperparameters,
            self.moving,
            information,
            self.settings.climbed,
            bent=True,
        )

    def _first(self, bracket: Bracket, sign: float, inference: Inference) -> float:
        reach = TARGET * inference.standard_error[self.k]
        if not np.isfinite(reach):
            reach = self.settings.first * abs(bracket.limit - bracket.center)
        return bracket.within(bracket.center + sign * reach)

    def _best_first(
        self, alpha: Array, known: Array, inner: Array, value: float, nearest: Summit
    ) -> list[Array]:
        """Guesses at a value; where the likeliest is no good, the best of all comes first."""
        guesses = self._guesses(alpha, known, inner, value)
        if self._below(guesses[0]) < self.settings.fair:
            return guesses
        guesses.append(self._tangent(nearest, value))
        best = int(np.argmin([self._below(guess) for guess in guesses]))
        return [guesses[best], *guesses[:best], *guesses[best + 1 :]]

    def _below(self, guess: Array) -> float:
        """How far a guess lies below the maximum."""
        return float(np.nan_to_num(self.top - self.objective(guess).total, nan=np.inf))

    def _guesses(self, alpha: Array, known: Array, inner: Array, value: float) -> list[Array]:
        """Where the conditional maximum may be, the likeliest first; the second beside `inner`."""
        along, beside = self._guess(alpha, known, value), self._beside(inner, value)
        error = np.sqrt(np.diag(np.linalg.pinv(self.information, hermitian=True)))
        lost = np.any(np.abs(along - known)[self.moving] > self.settings.distance * error)
        return [beside if lost else along, beside, self._guess(alpha, alpha, value)]

    def _tangent(self, summit: Summit, value: float) -> Array:
        """From a conditional maximum along the ridge, as the scores of the experiments tell it."""
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
        """Where the conditional maximum may be: along a parabola from the maximum through `known`.

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
