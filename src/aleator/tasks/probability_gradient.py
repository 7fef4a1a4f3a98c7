"""The gradient of the probability of an event with respect to alpha, however rare the event is.

The space of standard normal variates of the parameters and the error is cut into parallel lines. On
each line the ends of the event are found, and its probability is that of the normal law between
them. Both are smooth in alpha, so that differences by alpha are accurate (`probability_gradient`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from aleator.core.progress import Progress
from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError
from aleator.inference.alpha_draws import AlphaDraws
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.rare_events import Event, ImportanceDensity, uniform_points
from aleator.tasks.event_points import Sample, points_at, variates
from aleator.tasks.new_experiments import CONTEXT, PredictedValue, PredictionContext
from aleator.tasks.probability import event_on_surface, requested_responses


@dataclass(frozen=True)
class LineSamplingSettings:
    """Settings of the lines along which an event is integrated, all chosen by judgement."""

    lines: int = 1024
    """The number of lines, a power of two."""
    steps: int = 65
    """The number of points of a line among which the ends of the event are located."""
    halvings: int = 36
    """The number of bisections of an end; the last interval is 1e-11 standard deviations long."""
    points: int = 128
    """The number of points of the event at which its direction is computed."""
    slope: float = 1e-3
    """The distance of the two points of a derivative of the outcome by a standard normal variate,
    in standard deviations; half of it."""
    seed: int = 17
    """The seed of the lines."""


LINE_SAMPLING = LineSamplingSettings()


@dataclass(frozen=True, eq=False)
class EventGradient:
    """The probability of an event (A, G) under A laws and G conditions, and gradients (A, G, K).

    `settled` is false if a response surface does not determine some event.
    """

    probability: Array
    gradient: Array
    settled: bool


def event_gradient(
    context: PredictionContext,
    laws: Array,
    asked: OutcomeEvent,
    steps: Array,
    limits: tuple[Array, Array],
    progress: Progress | None = None,
) -> EventGradient:
    """The probability of an event and its gradient by alpha, under the laws (A, K).

    There is a row for each row of the conditions. A response surface is refined near the event as
    for `probability`, by runs of the simulator. `steps` (K,) are the steps of alpha in the
    differences, which end at the `limits` (K,). Raises InputsError for conditions in a group that
    was measured, and for an event that nothing within 6.5 standard deviations leads to.
    """
    if context.measured is not None:
        raise InputsError(
            f"the probability of {asked}: a condition is of a group that was measured",
            "name new groups in the conditions, or leave their column out",
        )
    (which,) = requested_responses(context, asked.outcome).tolist()
    event = asked.on(context.seen.responses[which].transform)
    draws = AlphaDraws.at(laws[0])
    if len(laws) > 1:
        draws = replace(
            draws, alpha=laws, weights=np.full(len(laws), 1.0 / len(laws)),
            z=np.zeros(laws.shape), log_density=np.zeros(len(laws)),
        )  # fmt: skip
    values, gradients, settled = [], [], True
    for place in np.flatnonzero(context.seen.response == which).tolist():
        if progress is not None:
            progress.stage("probability")
        predicted = PredictedValue.of(context, place, draws, progress)
        found = event_on_surface(predicted, draws, event, progress=progress)
        if not found.sample.reached:
            raise InputsError(
                f"the probability of {asked}: no parameters within {CONTEXT.reach:g} standard "
                "deviations lead to the event, or none avoid it",
                "aim at a less extreme event, at a quantile or at a hyperparameter",
            )
        own = [
            probability_gradient(predicted.fixed, one, found.event, found.sample, steps, limits)
            for one in laws
        ]
        sign = -1.0 if found.turned else 1.0
        values.append([1.0 - p if found.turned else p for p, _ in own])
        gradients.append([sign * gradient for _, gradient in own])
        settled = settled and found.settled
    return EventGradient(np.array(values).T, np.array(gradients).swapaxes(0, 1), settled)


def probability_gradient(
    predicted: PredictedValue,
    alpha: Array,
    event: Event,
    sample: Sample,
    steps: Array,
    limits: tuple[Array, Array],
    settings: LineSamplingSettings = LINE_SAMPLING,
) -> tuple[float, Array]:
    """P(y in event | alpha) and its gradient (K,), by line sampling.

    With lines u = v + t a, where the v are drawn in the space normal to the direction a,

        P = sum_v w_v sum_ends +-Phi(-t_end(v, alpha))

    (Koutsourelakis, Pradlwarter and Schueller, 2004). The v are drawn from the importance density
    of the event, so that the relative error is small. The gradient is the difference quotient of
    this sum, for the same v, with ends that are found again for each alpha. Cost: for 1024 lines
    67,000 outcomes, and 36 for each end and each of 1 + 2 K values of alpha.
    """
    lines = _SampledLines.of(predicted, alpha, event, sample, settings)
    ends = lines.ends(alpha)
    low, high = np.maximum(alpha - steps, limits[0]), np.minimum(alpha + steps, limits[1])
    gradient = np.zeros(alpha.size)
    for k in np.flatnonzero(high > low):
        values = []
        for value in (low[k], high[k]):
            moved = alpha.copy()
            moved[k] = value
            values.append(lines.probability(moved, [lines.near(end, moved) for end in ends]))
        gradient[k] = (values[1] - values[0]) / (high[k] - low[k])
    return lines.probability(alpha, ends), gradient


@dataclass(frozen=True, eq=False)
class _EndCrossings:
    """The R places t where outcomes cross one end of the event, on lines and in classes (R,).

    The probability that the outcome is above the end has the factor `sign` in that of the event.
    `rising` (R,) says whether it is above beyond t, and `first` (C, L) whether it is above where a
    line begins.
    """

    end: float
    sign: float
    first: Flags
    line: Indices
    number: Indices
    rising: Flags
    t: Array

    @property
    def probability(self) -> Array:
        """The probability (C, L) of an outcome above the end on each line, in each class."""
        found = self.first.astype(float)
        change = np.where(self.rising, 1.0, -1.0) * special.ndtr(-self.t)
        np.add.at(found, (self.number, self.line), change)
        return found


@dataclass(frozen=True, eq=False)
class _SampledLines:
    """Lines v + t a: the direction a (d,), the v (L, d) normal to it, and weights (L,)."""

    predicted: PredictedValue
    event: Event
    direction: Array
    across: Array
    weights: Array
    settings: LineSamplingSettings

    @classmethod
    def of(
        cls, predicted: PredictedValue, alpha: Array, event: Event, sample: Sample,
        settings: LineSamplingSettings,
    ) -> _SampledLines:  # fmt: skip
        """Lines in the direction in which the outcome changes most at the points of the event."""
        a, density = _direction(predicted, alpha, event, sample, settings), sample.density
        if a.size == 1 or density is None:
            return cls(predicted, event, a, np.zeros((1, a.size)), np.ones(1), settings)
        normal = np.linalg.svd(a[None])[2][1:]  # Its rows span the space normal to a.
        spread = density.factors @ density.factors.swapaxes(1, 2)
        marginal = ImportanceDensity(
            density.shares, density.means @ normal.T, np.linalg.cholesky(normal @ spread @ normal.T)
        )
        v = marginal.drawn(uniform_points(settings.lines, a.size, settings.seed))
        return cls(predicted, event, a, v @ normal, marginal.weights(v) / len(v), settings)

    def outcomes(self, alpha: Array, line: Indices, t: Array) -> Array:
        """The outcomes (C, R) in C classes at the places t (R,) of lines (R,)."""
        u = self.across[line] + t[:, None] * self.direction
        y, _ = self.predicted.outcomes(alpha[None], points_at(self.predicted, u))
        return np.asarray(y.reshape(-1, len(t)))

    def ends(self, alpha: Array) -> list[_EndCrossings]:
        """Where outcomes cross the ends of the event on all lines, under the law alpha (K,)."""
        lines, steps = np.arange(len(self.across)), self.settings.steps
        t = np.linspace(-CONTEXT.reach, CONTEXT.reach, steps)
        y = self.outcomes(alpha, np.repeat(lines, steps), np.tile(t, lines.size))
        y = y.reshape(-1, lines.size, steps)
        found = []
        for low, high in self.event.parts:
            for end, sign in ((low, 1.0), (high, -1.0))[: 1 if np.isposinf(high) else 2]:
                above = y > end  # A run that fails is not above minus infinity.
                number, line, cell = np.nonzero(above[..., 1:] != above[..., :-1])
                rising = above[number, line, cell + 1]
                here = _EndCrossings(end, sign, above[..., 0], line, number, rising, t[cell])
                found.append(self._bisected(here, alpha, t[cell], t[cell + 1]))
        return found

    def near(self, found: _EndCrossings, alpha: Array) -> _EndCrossings:
        """The crossings under a law alpha (K,) close to that for which they were found."""
        half = CONTEXT.reach / (self.settings.steps - 1)
        return self._bisected(found, alpha, found.t - half, found.t + half)

    def probability(self, alpha: Array, ends: list[_EndCrossings]) -> float:
        """The probability of the event under the law alpha (K,), from its ends."""
        centre = points_at(self.predicted, np.zeros((1, self.direction.size)))
        classes = self.predicted.outcomes(alpha[None], centre)[1].weights[0]
        parts = sum(end.sign * end.probability for end in ends)
        return float(classes @ (parts @ self.weights))

    def _bisected(
        self, found: _EndCrossings, alpha: Array, low: Array, high: Array
    ) -> _EndCrossings:
        rows = np.arange(low.size)
        for _ in range(self.settings.halvings if low.size else 0):
            middle = 0.5 * (low + high)
            y = self.outcomes(alpha, found.line, middle)[found.number, rows]
            beyond = (y > found.end) == found.rising
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        return replace(found, t=0.5 * (low + high))


def _direction(
    predicted: PredictedValue,
    alpha: Array,
    event: Event,
    sample: Sample,
    settings: LineSamplingSettings,
) -> Array:
    """The unit vector (d,) in which the outcome changes most at points of the event.

    It is the first eigenvector of the mean of g g'/|g|^2 over these points, with the gradients g of
    the outcome (an active subspace; Constantine, 2015).
    """
    points = sample.joined
    d = variates(predicted)
    u = np.column_stack([points.xi, points.score])[:, :d]
    y = predicted.outcomes(alpha[None], points)[0].reshape(-1, len(u))
    inside = np.flatnonzero(np.any(event.holds(y), axis=0))
    heavy = inside[np.argsort(np.sum(u[inside] ** 2, axis=1))[: settings.points]]
    at = u[heavy] if heavy.size else u[: settings.points]

    def moved(step: Array) -> Array:
        return predicted.outcomes(alpha[None], points_at(predicted, at + step))[0].reshape(-1)

    slopes = np.stack([moved(step) - moved(-step) for step in settings.slope * np.eye(d)], axis=1)
    size = np.linalg.norm(slopes, axis=1)
    slopes = slopes[np.isfinite(size) & (size > 0.0)]
    if not len(slopes):  # An outcome in steps: towards the nearest point of the event.
        return np.asarray(at[0] / np.linalg.norm(at[0]))
    units = slopes / np.linalg.norm(slopes, axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(units.T @ units)[1][:, -1])
