"""Ways that an objective knows itself, and starts that end where another climb passed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from landscapes import CENTERS, Recorded, box, hills

from aleator.core.types import Array
from aleator.laws import Hyperparameter
from aleator.search import GradientMultistart
from aleator.search.interface import LogLikelihood
from aleator.search.multistart import Reached

SAMPLE = np.array([[-0.4, 0.1], [0.9, -1.2], [0.3, 0.8], [-0.6, 0.2], [0.1, -0.3]])
"""Observations of experiments, whose mean is the maximum."""


def sample(alpha: Array) -> LogLikelihood:
    """Five experiments about a normal law of sd one: a paraboloid."""
    away = SAMPLE - alpha
    return LogLikelihood(-0.5 * np.sum(away**2, axis=1), away, np.zeros(len(away), dtype=int))


def two_hills(alpha: Array) -> LogLikelihood:
    """The first two hills as a sum over forty experiments, whose scores scatter."""
    found = hills(alpha)
    scatter = 0.3 * np.sin(np.arange(40.0)[:, None] * [1.0, 2.3])
    scatter -= scatter.mean(axis=0)
    each = np.full(40, found.total / 40.0)
    return LogLikelihood(each, found.score / 40.0 + scatter, np.zeros(40, dtype=int))


class Guided(Recorded):
    """An objective whose own way leads half of the rest to a goal, in limits or not."""

    def __init__(self, function, goal: Array) -> None:
        super().__init__(function)
        self.goal, self.steps = goal, 0

    def expectation_step(self, alpha: Array) -> tuple[float, Array]:
        self.steps += 1
        return self.function(alpha).total, 0.5 * (alpha + self.goal)


def test_a_way_that_leads_to_the_maximum_is_gone():
    wanted = SAMPLE.mean(axis=0)
    guided = Guided(lambda alpha: scaled(alpha, 1e4), wanted)
    found = GradientMultistart(1).maximize(guided, box(), seed=0)
    assert found.alpha == pytest.approx(wanted, abs=1e-4)
    assert guided.steps == found.evaluations - guided.scored + 1
    # nearly all of the way was gone before the first score was asked for
    assert np.max(np.abs(guided.asked[0] - wanted)) < 0.02


def scaled(alpha: Array, factor: float) -> LogLikelihood:
    found = sample(alpha)
    assert found.scores is not None
    return LogLikelihood(factor * found.each, factor * found.scores, found.status)


@pytest.mark.parametrize("goal", [np.array([-4.0, 4.0]), np.array([50.0, 50.0])])
def test_a_way_that_leads_elsewhere_does_no_harm(goal):
    guided = Guided(sample, goal)
    found = GradientMultistart(3).maximize(guided, box(), seed=0)
    assert found.alpha == pytest.approx(SAMPLE.mean(axis=0), abs=1e-4)
    assert found.converged
    assert np.all(np.abs(guided.asked) <= 5.0)


@pytest.mark.parametrize("limit", [2, 5, 12])
def test_own_steps_count_among_the_evaluations_of_a_start(limit):
    found = GradientMultistart(4, evaluations=limit).maximize(
        Guided(sample, SAMPLE.mean(axis=0) + 0.3), box(), seed=0
    )
    assert all(ascent.evaluations <= limit for ascent in found.ascents)


def test_starts_that_join_another_are_counted_at_its_optimum_and_cost_less():
    """Along a ridge that is curved in most experiments the way is long."""

    def curved(alpha: Array) -> LogLikelihood:
        a, b = alpha[0], alpha[1] - 0.3 * alpha[0] ** 2
        found = scaled(np.array([a, b]), 50.0)
        assert found.scores is not None
        by_a = found.scores[:, 0] - 0.6 * a * found.scores[:, 1]
        return LogLikelihood(found.each, np.stack([by_a, found.scores[:, 1]], axis=1), found.status)

    found = GradientMultistart(8).maximize(curved, box(), seed=0)
    assert [optimum.starts for optimum in found.optima] == [8]
    assert all(ascent.converged for ascent in found.ascents)
    ends = {tuple(ascent.alpha) for ascent in found.ascents}
    assert len(ends) == 1
    alone = sum(
        GradientMultistart(1).maximize(curved, started(ascent.start), seed=0).evaluations
        for ascent in found.ascents
    )
    assert found.evaluations < alone - 7


def started(start: Array) -> list[Hyperparameter]:
    return [replace(h, start=float(at)) for h, at in zip(box(), start, strict=True)]


def test_no_optimum_is_lost_by_joining():
    found = GradientMultistart(10).maximize(two_hills, box(), seed=0)
    ends = np.array([optimum.alpha for optimum in found.optima])
    for center in CENTERS[:2]:
        assert np.min(np.linalg.norm(ends - center, axis=1)) < 1e-2
    assert sum(optimum.starts for optimum in found.optima) == 10


def reached(alpha: Array, at: LogLikelihood) -> Reached:
    return Reached(alpha, at, np.arange(2))


def test_a_climb_joins_what_is_near_if_its_slope_leads_there():
    top = SAMPLE.mean(axis=0)
    there, near = reached(top, sample(top)), top + np.array([0.15, -0.1])
    at = sample(near)
    assert there.joins(near, at)
    assert not there.joins(top + 2.0, sample(top + 2.0))
    assert at.scores is not None
    assert not there.joins(near, LogLikelihood(at.each, -at.scores, at.status))
    assert not there.joins(near, LogLikelihood(at.each + 0.1, at.scores, at.status))


@pytest.mark.parametrize(
    "scores",
    [
        [[1.0, 0.0], [-1.0, 0.0], [0.5, 0.0]],
        [[1.0, 2.0], [-1.0, -2.0], [0.5, 1.0]],
        [[1.0, 0.3], [-1.0, -0.3]],
    ],
)
def test_scores_that_tell_no_distance_join_nothing(scores):
    flat = LogLikelihood(np.zeros(len(scores)), np.array(scores), np.zeros(len(scores), dtype=int))
    assert not reached(np.zeros(2), flat).joins(np.zeros(2), flat)
