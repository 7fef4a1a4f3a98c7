"""Probabilities of events, rare or not, and tolerance limits, with the uncertainty of alpha."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import stats

from aleator.core.progress import Progress
from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError, nearest
from aleator.inference.alpha_draws import AlphaDraws, quantiles
from aleator.inference.information import INTERVALS
from aleator.inference.rare_events import CrossEntropy, Event, content_interval, quantile_bound
from aleator.observations.responses import Transform
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
)
from aleator.tasks.new_experiments import Exploration, Points, PredictedValue, PredictionContext
from aleator.tasks.prediction import PREDICTION, heads, in_rows, tails


def requested_responses(context: PredictionContext, response: str | None) -> Indices:
    """The number of the named response, or of all. Raises InputsError if it is unknown.

    >>> from types import SimpleNamespace as Some
    >>> context = Some(seen=Some(responses=(Some(name="force"), Some(name="wear"))))
    >>> requested_responses(context, "wear").tolist(), requested_responses(context, None).tolist()
    ([1], [0, 1])
    """
    names = [r.name for r in context.seen.responses]
    # a table with one response may have been given without its name
    if response is None or names == [response] or len(names) == 1:
        return np.arange(len(names))
    if response not in names:
        raise InputsError(
            f"there is no response '{response}'{nearest(response, names)}",
            f"the responses are {', '.join(names)}",
        )
    return np.array([names.index(response)], dtype=np.intp)


def requested_events(
    context: PredictionContext,
    response: str | None,
    above: float | None,
    below: float | None,
    between: Sequence[float] | None,
) -> dict[int, Event]:
    """The event of one response by its number, in transformed values.

    Raises InputsError unless one of the three is given, of one response, with ends that are
    numbers in order and have a logarithm where the likelihood sees that.
    """
    if sum(part is not None for part in (above, below, between)) != 1:
        raise InputsError(
            "the probability of which outcomes?",
            "give one of above, below and between, in the unit of the outcome",
        )
    which = requested_responses(context, response)
    if which.size > 1:
        names = ", ".join(r.name for r in context.seen.responses)
        raise InputsError(
            f"the probability of which response? There are {names}", "name one with response"
        )
    transform = context.seen.responses[which[0]].transform
    low, high = between or (above, below)
    ends = _end(low, -np.inf, transform), _end(high, np.inf, transform)
    if not ends[0] < ends[1]:
        raise InputsError(f"between {low:g} and {high:g} lies nothing", "give the lower end first")
    return {int(which[0]): Event((ends,))}


def _end(value: float | None, other: float, transform: Transform) -> float:
    if value is None:
        return other
    if not np.isfinite(value):
        raise InputsError(f"an end at {value} is no number", "leave it out, or give a number")
    if transform is Transform.LOG and value <= 0.0:
        raise InputsError(
            f"an end at {value:g}, and the likelihood sees the logarithm of the outcome",
            "give a positive number: all outcomes are above zero",
        )
    return float(transform(value))


@dataclass(frozen=True)
class ProbabilitySettings:
    """Shares and batches of an interval; by judgement."""

    content: float = 0.95
    """Probability that an interval holds."""
    batches: int = 16
    """Batches of draws whose scatter is the error by the draws."""


PROBABILITY = ProbabilitySettings()

STUDENT = float(
    stats.t.ppf(INTERVALS.ends[1], SAMPLE.replicates - 1) / stats.norm.ppf(INTERVALS.ends[1])
)
"""What the standard error of few replicates is longer by, so that twice it holds 95 %."""


@dataclass(frozen=True)
class Probability:
    """A probability under the mixture of plausible laws, and its 95 % interval.

    `at_estimate` is that of the estimate alone, `error` the standard error of the computation,
    `checks` the runs of the simulator that it was held against. `distance` is that of the
    most probable point of the event, or of its contrary, from the middle of the law of the
    estimate in standard deviations; NaN where nothing is rare. `unseen` is the largest probability
    of a region that the fresh runs beside a surface do not exclude; NaN without a surface.
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
        """The probability of the contrary event."""
        return replace(
            self, probability=1.0 - self.probability, lower=1.0 - self.upper,
            upper=1.0 - self.lower, at_estimate=1.0 - self.at_estimate,
        )  # fmt: skip


def probabilities(
    context: PredictionContext,
    draws: AlphaDraws,
    events: dict[int, Event],
    checks: int = SAMPLE.checks,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """A row for each response that has an event (by its number) and each row of the conditions."""
    draws = context.taken(draws)
    requested = np.flatnonzero(np.isin(context.seen.response, [*events]))
    found: list[Probability] = []
    for place in requested.tolist():
        if progress is not None:
            progress.stage(f"probability {len(found) + 1} of {requested.size}")
        predicted = PredictedValue.of(context, place, draws, progress)
        event = events[int(context.seen.response[place])]
        found.append(probability(predicted, draws, event, checks, progress))
    names = ("probability", "lower", "upper", "error", "at_estimate", "distance", "checks",
             "unseen")  # fmt: skip
    columns = {name: np.array([getattr(p, name) for p in found]) for name in names}
    status = {"status": np.array([p.status for p in found])}
    columns = {**heads(context, requested), **columns, **tails(context, requested), **status}
    return in_rows(context, columns, requested)


def probability(
    predicted: PredictedValue,
    draws: AlphaDraws,
    event: Event,
    checks: int = SAMPLE.checks,
    progress: Progress | None = None,
    choice: Exploration | None = None,
) -> Probability:
    """P(y in the event) = sum_a w_a P(y in the event | alpha_a).

    By importance sampling from a density that is sought for the event, or for its contrary where
    that is less likely (`importance_density`). A surface is first made certain of the event by
    fresh runs (`Exploration`), and `checks` runs near the event's ends correct it. It is
    "unsettled" where the surface is not certain in the end, or where the last fresh runs or the
    checks change the probability by more than the `share` of the choice.
    """
    requested, turned, choice = event, False, choice or Exploration()
    if predicted.context.measured is not None:
        sample = of_law(predicted)
    else:
        turned = often(predicted, draws, event)
        requested = event.contrary if turned else event
        sample = event_sample(predicted, draws, requested)
    found = _SurfaceSample(sample, float("nan"), True)
    if predicted.surface is not None:
        found = _explored(predicted, draws, requested, sample, choice, progress)
    sample, settled = found.sample, found.settled
    told = _Told.of(predicted, draws, requested, sample)
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
    return whole.contrary if turned else whole


@dataclass(frozen=True, eq=False)
class _SurfaceSample:
    """A sample by an explored surface; `settled`: more runs would change little."""

    sample: Sample
    unseen: float
    settled: bool


def _explored(
    predicted: PredictedValue,
    draws: AlphaDraws,
    event: Event,
    sample: Sample,
    choice: Exploration,
    progress: Progress | None,
) -> _SurfaceSample:
    """Rounds of fresh runs all over the law, and of runs where kriging is uncertain."""
    surface, most, round_ = predicted.surface, predicted.context.surfaces.max_runs, 0
    assert surface is not None
    while True:
        if progress is not None:
            progress.stage(f"{choice.runs} runs of the simulator look for other regions")
        before = predicted.fixed
        probability = by_some(before, draws, event, sample.joined)
        seen = explored(predicted, draws, event, probability, choice, round_)
        surface.learn(seen.x)
        sample, certain = _sharpened(predicted, draws, event, choice)
        now, was = (by_some(one, draws, event, sample.joined) for one in (predicted, before))
        settled = certain and abs(now - was) <= choice.share * now
        if (settled and not seen.contrary.any()) or surface.runs + 2 * choice.runs > most:
            return _SurfaceSample(sample, seen.unseen, settled)
        round_ += 1


def _sharpened(
    predicted: PredictedValue, draws: AlphaDraws, event: Event, choice: Exploration
) -> tuple[Sample, bool]:
    """The sample once the surface is certain of the event, and whether it is."""
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
    """Probabilities (1 + A, R) under the estimate and each draw, by each of R replicates.

    Of a `plain` sample the error is at least that of half a point.
    """

    each: Array
    weights: Array
    lost: float
    plain: bool

    @classmethod
    def of(
        cls, predicted: PredictedValue, draws: AlphaDraws, event: Event, sample: Sample
    ) -> _Told:
        """The probabilities by outcomes at the points of the sample."""
        alphas = np.concatenate([draws.estimate[None], draws.alpha])
        parts, lost = [], 0.0
        for points in sample.replicates:
            y, found = predicted.outcomes(alphas, points)
            parts.append(
                _shares(event.holds(y), found.weights, predicted.context.measured is not None)
            )
            lost = max(lost, float(np.max(np.sum(found.weights, axis=1, where=np.isnan(y)))))
        each = np.stack(parts, axis=1)
        return cls(each, draws.weights, lost, sample.density is None)

    @property
    def by_replicate(self) -> Array:
        """Probabilities (R,) of the mixture."""
        return np.asarray(self.weights @ self.each[1:])

    @property
    def mixed(self) -> float:
        """The probability of the mixture."""
        return float(self.by_replicate.mean())

    @property
    def error(self) -> float:
        """Standard error of the mixture: of the points, and of the draws by batches of pairs."""
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
        """The probability with its interval, corrected by the simulator's runs in proportion."""
        mixed = self.mixed
        whole = float(np.clip(mixed + change.value, 0.0, 1.0))
        factor = whole / mixed if mixed > 0.0 else 1.0
        own = np.clip(self.each.mean(axis=1) * factor, 0.0, 1.0)
        ends = delta_interval(whole, own[1:], self.weights)
        if draws.certain:
            ends = np.full(2, np.nan)
        status = "unsettled" if not settled else "solved" if sample.reached else "not_reached"
        return Probability(
            whole, float(ends[0]), float(ends[1]), float(own[0]),
            float(np.hypot(self.error, change.error)), distance, change.runs,
            "runs_failed" if self.lost > PREDICTION.lost else status, unseen,
        )  # fmt: skip


def delta_interval(
    mean: float, values: Array, weights: Array, settings: ProbabilitySettings = PROBABILITY
) -> Array:
    """The ends (2,) of an interval that holds 95 % of the values (A,), and their mean.

    Tails of 2.5 % each; of a law so skew that the mean lies in one of them, the interval ends at
    the mean, and what that tail keeps beyond it is taken from the other. It holds 95 % either way.
    """
    low, high = quantiles(values, weights, np.array(INTERVALS.ends))
    if mean > high:
        below = float(np.sum(weights, where=values <= mean))
        low = quantiles(values, weights, np.array([below - settings.content]))[0]
    elif mean < low:
        below = float(np.sum(weights, where=values < mean))
        high = quantiles(values, weights, np.array([below + settings.content]))[0]
    return np.array([min(low, mean), max(high, mean)])


def _shares(holds: Flags, weights: Array, normalized: bool) -> Array:
    inside = np.sum(weights, axis=1, where=holds)
    whole = weights.sum(axis=1) if normalized else 1.0
    return np.asarray(np.minimum(inside / whole, 1.0))


@dataclass(frozen=True)
class ToleranceSettings:
    """When a design value has points of its own; by judgement."""

    far: float = 0.02
    """Share beyond a design value below which it has points of its own."""
    middle: tuple[float, float] = (0.16, 0.84)
    """Probabilities between whose quantiles the scatter is taken: two sd of a normal law."""
    rounds: int = 4
    """Rounds in which a design value gets points of its own, at most."""
    still: float = 0.01
    """A change of a design value over the scatter that is none."""


LIMITS = ToleranceSettings()


@dataclass(frozen=True)
class Tolerance:
    """A tolerance interval or a one-sided limit.

    `content` of the outcomes lie within, with this `confidence`: between two limits, or on one
    `side`, below an "upper" or above a "lower" one. Raises InputsError for shares that are not
    between zero and one, and another side.
    """

    content: float = 0.95
    confidence: float = 0.95
    side: str = "both"

    def __post_init__(self) -> None:
        for name, value in (("content", self.content), ("confidence", self.confidence)):
            if not 0.0 < value < 1.0:
                raise InputsError(f"{name} {value:g}", "choose a share between 0 and 1, as 0.95")
        if self.side not in ("both", "upper", "lower"):
            raise InputsError(f"side '{self.side}'", 'it is "both", "upper" or "lower"')


def limits(
    context: PredictionContext,
    draws: AlphaDraws,
    requested: Tolerance,
    which: Indices,
    progress: Progress | None = None,
    settings: ToleranceSettings = LIMITS,
) -> pd.DataFrame:
    """A row for each of the values `which`; limits are in the unit of the outcome."""
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
            # the error is one of the logarithm, where that is what the likelihood sees
            slope = back(np.array([value + error[row], value - error[row]]))
            error[row] = 0.5 * float(slope[0] - slope[1])
    columns = {"lower": lower, "upper": upper} if requested.side == "both" else {
        requested.side: upper if requested.side == "upper" else lower, "error": error
    }  # fmt: skip
    return in_rows(context, {**heads(context, which), **columns, **tails(context, which)}, which)


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

    Far out the points lie about the event beyond the value of the round before.
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
    """Weights completed to a sum of one at the far end of the other side.

    Points about a rare event determine its probability, but not that of the rest.
    """
    order = np.argsort(y, axis=1)
    first, last = order[:, 0], order[:, -1]
    found = weights.copy()
    rows = np.arange(len(y))
    end = first if probability > 0.5 else last
    found[rows, end] = 0.0
    found[rows, end] = np.maximum(1.0 - found.sum(axis=1), 0.0)
    return found
