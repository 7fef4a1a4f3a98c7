"""Probabilities of events (rare or not) and tolerance limits, with the uncertainty of alpha.

An event is an outcome above a value, below a value, or between two values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import stats

from aleator.core.blocks import blocks
from aleator.core.progress import Progress
from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError, nearest
from aleator.inference.alpha_draws import AlphaDraws, quantiles
from aleator.inference.information import INTERVALS
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.outcome_question import Tolerance
from aleator.inference.rare_events import CrossEntropy, Event, content_interval, quantile_bound
from aleator.tasks.event_points import (
    SAMPLE,
    Correction,
    Sample,
    SurfaceDoubt,
    by_some,
    corrected,
    distance_of,
    event_sample,
    explored,
    of_law,
    often,
    possible,
    settling,
    sought,
    unseen_after,
    variates,
)
from aleator.tasks.new_experiments import (
    CONTEXT,
    Exploration,
    Points,
    PredictedValue,
    PredictionContext,
)
from aleator.tasks.prediction import PREDICTION, in_rows


def requested_responses(context: PredictionContext, outcome: str | None) -> Indices:
    """The index of the response that is this outcome, or without a name all indices.

    Raises InputsError for an unknown name.

    >>> from types import SimpleNamespace as Some
    >>> context = Some(seen=Some(responses=(Some(name="force"), Some(name="wear"))))
    >>> requested_responses(context, "wear").tolist(), requested_responses(context, None).tolist()
    ([1], [0, 1])
    """
    names = [r.name for r in context.seen.responses]
    if outcome is None:
        return np.arange(len(names))
    if outcome in names:
        return np.array([names.index(outcome)], dtype=np.intp)
    # The only response may be unnamed in the table: any name stands for it, but a parameter's.
    if len(names) == 1 and outcome not in context.inputs.names:
        return np.zeros(1, dtype=np.intp)
    raise InputsError(
        f"there is no outcome '{outcome}'{nearest(outcome, names)}",
        f"the outcomes are {', '.join(names)}",
    )


@dataclass(frozen=True)
class ProbabilitySettings:
    """Settings of the error of a probability; the values are chosen by judgement."""

    batches: int = 16
    """The number of batches of draws, whose scatter gives the error due to the draws."""


PROBABILITY = ProbabilitySettings()

STUDENT = float(
    stats.t.ppf(INTERVALS.ends[1], SAMPLE.replicates - 1) / stats.norm.ppf(INTERVALS.ends[1])
)
"""The factor of a standard error from few replicates, by which twice the error has 95 % coverage.

It is the ratio of the 97.5 % quantiles of Student's t and of the normal law.
"""


@dataclass(frozen=True)
class Probability:
    """A probability under the mixture of plausible laws, and its 95 % interval.

    The interval contains `at_estimate`, the probability under the estimated law, too. `error` is
    the standard error of the computation, and `checks` the number of simulator runs that checked
    it. `distance` is the distance of the event's most probable point from the centre of the
    estimated law, in standard deviations. If the complement of the event is less probable, it is
    that of the complement. It is NaN without an importance density. `unseen` is the largest
    probability of a region that the runs all over the law do not exclude, in all their rounds; NaN
    without a surface. Checking runs do not count: they lie near the event that the surface shows.
    """

    probability: float
    lower: float
    upper: float
    at_estimate: float
    error: float
    distance: float
    checks: int
    status: str
    unseen: float

    @property
    def contrary(self) -> Probability:
        """The probability of the complementary event, with its interval."""
        return replace(
            self, probability=1.0 - self.probability, lower=1.0 - self.upper,
            upper=1.0 - self.lower, at_estimate=1.0 - self.at_estimate,
            status=CERTAIN.get(self.status, self.status),
        )  # fmt: skip


CERTAIN = {"never": "always", "always": "never"}
"""The statuses of an event that a law cannot reach or cannot miss, each with its contrary's."""


def probabilities(
    context: PredictionContext,
    draws: AlphaDraws,
    asked: OutcomeEvent,
    checks: int = SAMPLE.checks,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """The table of probabilities of an event, with a row for each row of the conditions."""
    draws = context.taken(draws)
    (which,) = requested_responses(context, asked.outcome).tolist()
    event = asked.on(context.seen.responses[which].transform)
    requested = np.flatnonzero(context.seen.response == which)
    found: list[Probability] = []
    for place in requested.tolist():
        if progress is not None:
            progress.stage(f"probability {len(found) + 1} of {requested.size}")
        predicted = PredictedValue.of(context, place, draws, progress)
        found.append(probability(predicted, draws, event, checks, progress))
    names = ("probability", "lower", "upper", "at_estimate", "error", "distance", "checks",
             "unseen")  # fmt: skip
    columns = {name: np.array([getattr(p, name) for p in found]) for name in names}
    return in_rows(context, columns, [p.status for p in found], requested)


def probability(
    predicted: PredictedValue,
    draws: AlphaDraws,
    event: Event,
    checks: int = SAMPLE.checks,
    progress: Progress | None = None,
    choice: Exploration | None = None,
) -> Probability:
    """The probability of an event: P(y in event) = sum_a w_a P(y in event | alpha_a).

    It is computed by importance sampling for the event, or for its complement if that is less
    probable (`importance_density`). A response surface is first refined by new runs until it
    determines the event (`Exploration`). Then `checks` runs near the event's ends correct the
    probability. The status is "unsettled" if the surface does not determine the event in the end,
    or if the last runs change the probability by more than the share `choice.share`.
    """
    choice = choice or Exploration()
    found = event_on_surface(predicted, draws, event, choice, progress)
    requested, sample, settled = found.event, found.sample, found.settled
    told = _Told.of(predicted, draws, requested, sample, progress)
    distance = float("nan")
    if sample.density is not None:
        distance = distance_of(predicted, draws.estimate, requested, sample.replicates)
    change = Correction(0.0, 0.0, 0)
    if predicted.surface is not None and checks and sample.reached:
        if progress is not None:
            progress.stage(f"{checks} runs of the simulator check a probability")
        change = corrected(predicted, draws, requested, sample.joined, checks)
        settled = settled and np.hypot(change.value, change.error) <= choice.share * told.mixed
    whole = told.estimate(draws, change, sample, distance, found.unseen, settled)
    return whole.contrary if found.turned else whole


@dataclass(frozen=True, eq=False)
class EventSample:
    """A sample of an event, or of its complement if that is less probable (`turned`).

    `event` is the one that is sampled. `settled` says whether a response surface determines it:
    more runs would change little. `unseen` is as in `Probability`.
    """

    event: Event
    turned: bool
    sample: Sample
    unseen: float = float("nan")
    settled: bool = True


def event_on_surface(
    predicted: PredictedValue,
    draws: AlphaDraws,
    event: Event,
    choice: Exploration | None = None,
    progress: Progress | None = None,
) -> EventSample:
    """A sample of an event, or of its complement, by the simulator or by a refined surface."""
    if predicted.context.measured is not None:
        found = EventSample(event, False, of_law(predicted))
    else:
        turned = often(predicted, draws, event)
        requested = event.contrary if turned else event
        found = EventSample(requested, turned, event_sample(predicted, draws, requested))
    if predicted.surface is None:
        return found
    return _explored(predicted, draws, found, choice or Exploration(), progress)


def _explored(
    predicted: PredictedValue,
    draws: AlphaDraws,
    found: EventSample,
    choice: Exploration,
    progress: Progress | None,
) -> EventSample:
    """Refine the surface by runs all over the law and where kriging is uncertain, in rounds."""
    event, sample = found.event, found.sample
    surface, most = predicted.surface, predicted.context.surfaces.max_runs
    radii: list[float] = []
    assert surface is not None
    while True:
        if progress is not None:
            progress.stage(f"{choice.runs} runs of the simulator look for other regions")
        before = predicted.fixed
        probability = by_some(before, draws, event, sample.joined)
        seen = explored(predicted, draws, event, probability, choice, len(radii))
        radii.append(seen.radius)
        surface.learn(seen.x)
        if progress is not None:
            progress.stage("runs of the simulator near the ends of the event")
        sample, certain = _sharpened(predicted, draws, event, choice)
        now, was = (by_some(one, draws, event, sample.joined) for one in (predicted, before))
        settled = certain and abs(now - was) <= choice.share * now
        if (settled and not seen.contrary.any()) or surface.runs + 2 * choice.runs > most:
            unseen = unseen_after(radii, choice.runs, variates(predicted))
            return replace(found, sample=sample, unseen=unseen, settled=settled)


def _sharpened(
    predicted: PredictedValue, draws: AlphaDraws, event: Event, choice: Exploration
) -> tuple[Sample, bool]:
    """Refine the surface until it determines the event; the sample, and whether it does."""
    assert predicted.surface is not None
    runs, seek = 0, CrossEntropy()
    while True:
        seen = possible(predicted, draws, event, seek)
        doubt = SurfaceDoubt.of(predicted, draws, event, seen.joined, SAMPLE.followed)
        certain = not seen.reached or bool(doubt.wrong.sum() <= choice.doubt * doubt.probability)
        if certain or runs + choice.batch > choice.runs:
            return sought(predicted, draws, event, seek), certain
        predicted.surface.correct(settling(predicted, doubt, choice.batch))
        runs += choice.batch


@dataclass(frozen=True, eq=False)
class _Told:
    """The probabilities `each` (1 + A, R) of an event, under the estimate and A draws of alpha.

    R is the number of independent samples, `weights` (A,) are those of the draws, and `lost` is the
    probability of a failing run. A `plain` sample, drawn from the law itself, has a standard error
    of at least half a point.
    """

    each: Array
    weights: Array
    lost: float
    plain: bool

    @classmethod
    def of(
        cls,
        predicted: PredictedValue,
        draws: AlphaDraws,
        event: Event,
        sample: Sample,
        progress: Progress | None = None,
    ) -> _Told:
        """The probabilities from outcomes at the points of the sample."""
        alphas = np.concatenate([draws.estimate[None], draws.alpha])
        if progress is not None:
            progress.stage(f"probability under {len(alphas)} plausible laws")
        further = predicted.context.measured is not None
        # A measured experiment has the same points, its own, in each sample.
        points = sample.replicates[0] if further else sample.joined
        samples, parts, lost = 1 if further else len(sample.replicates), [], 0.0
        width = len(points.score) * len(predicted.context.inputs.names)
        for laws in blocks(len(alphas), width, CONTEXT.largest):
            if progress is not None and laws.start:
                text = f"law {laws.start} of {len(alphas)}"
                progress.update(text, done=laws.start, total=len(alphas))
            y, found = predicted.outcomes(alphas[laws], points)
            shape = (len(y), -1, samples, len(points.score) // samples)
            weights = samples * found.weights.reshape(shape)
            y = y.reshape(shape)
            parts.append(_shares(event.holds(y), weights, further))
            lost = max(lost, float(np.max(np.sum(weights, axis=(1, 3), where=np.isnan(y)))))
        each = np.concatenate(parts)
        whole = np.broadcast_to(each, (len(each), len(sample.replicates)))
        return cls(whole, draws.weights, lost, sample.density is None)

    @property
    def by_replicate(self) -> Array:
        """The probability (R,) under the mixture of all draws, from each independent sample."""
        return np.asarray(self.weights @ self.each[1:])

    @property
    def mixed(self) -> float:
        """The probability under the mixture of all draws of alpha."""
        return float(self.by_replicate.mean())

    @property
    def error(self) -> float:
        """The standard error of the mixture's probability, from the points and from the draws.

        The error due to the draws is computed from batches of pairs of draws.
        """
        points = STUDENT * float(self.by_replicate.std(ddof=1) / np.sqrt(SAMPLE.replicates))
        if self.plain:
            points = max(points, float(0.5 / (SAMPLE.each * np.sqrt(SAMPLE.replicates))))
        if len(self.weights) < 4 * PROBABILITY.batches:
            return points
        batch = (np.arange(len(self.weights)) // 2) % PROBABILITY.batches
        own = self.each[1:].mean(axis=1)
        means = [
            np.average(own[batch == b], weights=self.weights[batch == b] + np.finfo(float).tiny)
            for b in range(PROBABILITY.batches)
        ]
        return float(
            np.hypot(points, STUDENT * np.std(means, ddof=1) / np.sqrt(PROBABILITY.batches))
        )

    def estimate(
        self,
        draws: AlphaDraws,
        change: Correction,
        sample: Sample,
        distance: float,
        unseen: float,
        settled: bool,
    ) -> Probability:
        """The probability with its interval, both scaled by the correction from simulator runs."""
        mixed = self.mixed
        whole = float(np.clip(mixed + change.value, 0.0, 1.0))
        factor = whole / mixed if mixed > 0.0 else 1.0
        own = np.clip(self.each.mean(axis=1) * factor, 0.0, 1.0)
        ends = widened_interval(np.array([whole, own[0]]), own[1:], self.weights)
        if draws.certain:
            ends = np.full(2, np.nan)
        status = "unsettled" if not settled else "solved" if sample.reached else "never"
        return Probability(
            whole, float(ends[0]), float(ends[1]), float(own[0]),
            float(np.hypot(self.error, change.error)), distance, change.runs,
            "runs_failed" if self.lost > PREDICTION.lost else status, unseen,
        )  # fmt: skip


def widened_interval(estimates: Array, values: Array, weights: Array) -> Array:
    """The ends (2,) of an interval that has at most 2.5 % of the values (A,) on either side.

    It is widened to contain the `estimates`: the mean of skew values may lie in one of their tails,
    and the value at an estimate of alpha on its limit is below or above all of them.

    >>> values, weights = np.arange(1.0, 101.0), np.full(100, 0.01)
    >>> widened_interval(np.array([0.0]), values, weights).round(0).tolist()
    [0.0, 98.0]
    """
    low, high = quantiles(values, weights, np.array(INTERVALS.ends))
    return np.array([min(low, estimates.min()), max(high, estimates.max())])


def _shares(holds: Flags, weights: Array, normalized: bool) -> Array:
    """The weights (A, R) inside an event, from points (A, classes, R, J) of R samples."""
    inside = np.sum(weights, axis=(1, 3), where=holds)
    whole = weights.sum(axis=(1, 3)) if normalized else 1.0
    return np.asarray(np.minimum(inside / whole, 1.0))


@dataclass(frozen=True)
class ToleranceSettings:
    """Settings of one-sided tolerance limits (design values); chosen by judgement."""

    far: float = 0.02
    """The tail probability up to which a design value is computed by importance sampling."""
    middle: tuple[float, float] = (0.16, 0.84)
    """The probabilities of two quantiles that are two sd apart for a normal law; half of their
    difference is the scatter of the outcome."""
    rounds: int = 4
    """The largest number of importance samples drawn one after the other for a design value."""
    still: float = 0.01
    """The change of a design value, as a share of the scatter, that counts as zero."""


LIMITS = ToleranceSettings()


def limits(
    context: PredictionContext,
    draws: AlphaDraws,
    requested: Tolerance,
    which: Indices,
    progress: Progress | None = None,
    settings: ToleranceSettings = LIMITS,
) -> pd.DataFrame:
    """The table of tolerance limits in the outcome's unit, with a row for each value `which`."""
    draws = context.taken(draws)
    lower, upper, error = np.full((3, which.size), np.nan)
    for row, place in enumerate(which.tolist()):
        if progress is not None:
            progress.stage(f"limits {row + 1} of {which.size}")
        predicted = PredictedValue.of(context, place, draws, progress, context.surfaces.max_runs)
        back = context.seen.responses[context.seen.response[place]].transform.inverse
        if requested.side == "both":
            low, high = _interval(predicted, draws, requested)
            lower[row], upper[row] = back(np.array([low, high]))
        else:
            value, error[row] = _bound(predicted, draws, requested, settings)
            (upper if requested.side == "upper" else lower)[row] = back(np.array(value))
            # The error is transformed back too, which matters for a "log" transform.
            slope = back(np.array([value + error[row], value - error[row]]))
            error[row] = 0.5 * float(slope[0] - slope[1])
    columns = {"lower": lower, "upper": upper} if requested.side == "both" else {
        requested.side: upper if requested.side == "upper" else lower, "error": error
    }  # fmt: skip
    return in_rows(context, columns, None, which)


def _interval(
    predicted: PredictedValue, draws: AlphaDraws, requested: Tolerance
) -> tuple[float, float]:
    points = of_law(predicted).joined
    y, found = predicted.outcomes(draws.alpha, points)
    return content_interval(
        y, found.weights, draws.weights, requested.content, requested.confidence
    )


def _bound(
    predicted: PredictedValue, draws: AlphaDraws, requested: Tolerance, settings: ToleranceSettings
) -> tuple[float, float]:
    """The confidence bound of a quantile, and the standard error of its computation.

    For a small tail probability it is computed in rounds. Each round samples the event that an
    outcome lies beyond the bound of the round before.
    """
    upper = requested.side == "upper"
    probability = requested.content if upper else 1.0 - requested.content
    confidence = requested.confidence if upper else 1.0 - requested.confidence
    y, scatter, sample = 0.0, 1.0, of_law(predicted)
    for _ in range(settings.rounds):
        before = y
        y, scatter = _once(predicted, draws, sample.joined, probability, confidence)
        settled = abs(y - before) < settings.still * scatter
        if (
            1.0 - requested.content > settings.far
            or predicted.context.measured is not None
            or settled
        ):
            break
        event = Event(((y, np.inf),) if upper else ((-np.inf, y),))
        found = event_sample(predicted, draws, event)
        if not found.reached:
            break
        sample = found
    parts = [_once(predicted, draws, p, probability, confidence)[0] for p in sample.replicates]
    return y, float(np.std(parts, ddof=1) / np.sqrt(len(parts)))


def _once(
    predicted: PredictedValue,
    draws: AlphaDraws,
    points: Points,
    probability: float,
    confidence: float,
) -> tuple[float, float]:
    y, found = predicted.outcomes(draws.alpha, points)
    weights = _completed(y, found.weights, probability)
    value, _ = quantile_bound(y, weights, draws.weights, probability, confidence)
    middle = quantiles(y[0], found.weights[0], np.array(LIMITS.middle))
    return value, 0.5 * float(middle[1] - middle[0])


def _completed(y: Array, weights: Array, probability: float) -> Array:
    """Weights made to sum to one by changing that of the point farthest from the rare event.

    Points drawn around a rare event determine its probability, but do not cover the rest of the
    law. That point gets all the remaining probability.
    """
    order = np.argsort(y, axis=1)
    first, last = order[:, 0], order[:, -1]
    found = weights.copy()
    rows = np.arange(len(y))
    end = first if probability > 0.5 else last
    found[rows, end] = 0.0
    found[rows, end] = np.maximum(1.0 - found.sum(axis=1), 0.0)
    return found
