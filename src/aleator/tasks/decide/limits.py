"""Tolerance intervals, and design values with a reliability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.inference.alpha_draws import AlphaDraws, quantiles
from aleator.inference.rare_events import Event, content_interval, quantile_bound
from aleator.tasks.decide.ground import Ground, Points
from aleator.tasks.decide.near import Near
from aleator.tasks.decide.prediction import heads, in_rows, tails
from aleator.tasks.decide.sample import about_event, of_law


@dataclass(frozen=True)
class ToleranceSettings:
    """When a design value has points of its own; by judgement."""

    far: float = 0.02
    """Share beyond a design value below which it has points of its own."""
    middle: tuple[float, float] = (0.16, 0.84)
    """Probabilities between whose quantiles the scatter is taken: two sd of a normal law."""
    rounds: int = 4
    still: float = 0.01
    """A change of a design value over the scatter that is none."""


LIMITS = ToleranceSettings()


@dataclass(frozen=True)
class Tolerance:
    """Which limits are asked for.

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
    ground: Ground,
    draws: AlphaDraws,
    asked: Tolerance,
    which: Indices,
    progress: Progress | None = None,
    settings: ToleranceSettings = LIMITS,
) -> pd.DataFrame:
    """A row for each of the values `which`; limits are in the unit of the outcome."""
    draws = ground.taken(draws)
    lower, upper, error = np.full((3, which.size), np.nan)
    for row, place in enumerate(which.tolist()):
        if progress is not None:
            progress.stage(f"limits {row + 1} of {which.size}")
        near = Near.of(ground, place, draws, progress, ground.surfaces.max_runs)
        back = ground.seen.responses[ground.seen.response[place]].transform.inverse
        if asked.side == "both":
            low, high = _interval(near, draws, asked)
            lower[row], upper[row] = back(np.array([low, high]))
        else:
            value, error[row] = _bound(near, draws, asked, settings)
            (upper if asked.side == "upper" else lower)[row] = back(np.array(value))
            # the error is one of the logarithm, where that is what the likelihood sees
            slope = back(np.array([value + error[row], value - error[row]]))
            error[row] = 0.5 * float(slope[0] - slope[1])
    columns = {"lower": lower, "upper": upper} if asked.side == "both" else {
        asked.side: upper if asked.side == "upper" else lower, "error": error
    }  # fmt: skip
    return in_rows(ground, {**heads(ground, which), **columns, **tails(ground, which)}, which)


def _interval(near: Near, draws: AlphaDraws, asked: Tolerance) -> tuple[float, float]:
    points = of_law(near).joined
    y, found = near.outcomes(draws.alpha, points)
    return content_interval(y, found.weights, draws.weights, asked.content, asked.confidence)


def _bound(
    near: Near, draws: AlphaDraws, asked: Tolerance, settings: ToleranceSettings
) -> tuple[float, float]:
    """The confidence bound of a quantile, and the standard error of its computation.

    Far out the points are about the most probable points beyond the value of the round before.
    """
    upper = asked.side == "upper"
    probability = asked.content if upper else 1.0 - asked.content
    confidence = asked.confidence if upper else 1.0 - asked.confidence
    y, scatter, sample = 0.0, 1.0, of_law(near)
    for _ in range(settings.rounds):
        before = y
        y, scatter = _once(near, draws, sample.joined, probability, confidence)
        settled = abs(y - before) < settings.still * scatter
        if 1.0 - asked.content > settings.far or near.ground.measured is not None or settled:
            break
        event = Event(((y, np.inf),) if upper else ((-np.inf, y),))
        found = about_event(near, draws, event)
        if not found.reached:
            break
        sample = found
    parts = [_once(near, draws, p, probability, confidence)[0] for p in sample.replicates]
    return y, float(np.std(parts, ddof=1) / np.sqrt(len(parts)))


def _once(
    near: Near, draws: AlphaDraws, points: Points, probability: float, confidence: float
) -> tuple[float, float]:
    y, found = near.outcomes(draws.alpha, points)
    weights = _completed(y, found.weights, probability)
    value, _ = quantile_bound(y, weights, draws.weights, probability, confidence)
    middle = quantiles(y[0], found.weights[0], np.array(LIMITS.middle))
    return value, 0.5 * float(middle[1] - middle[0])


def _completed(y: Array, weights: Array, probability: float) -> Array:
    """Weights that sum to one by those of the side that is not asked for.

    Points about a rare event know its probability, and not that of the rest.
    """
    order = np.argsort(y, axis=1)
    first, last = order[:, 0], order[:, -1]
    found = weights.copy()
    rows = np.arange(len(y))
    end = first if probability > 0.5 else last
    found[rows, end] = 0.0
    found[rows, end] = np.maximum(1.0 - found.sum(axis=1), 0.0)
    return found
