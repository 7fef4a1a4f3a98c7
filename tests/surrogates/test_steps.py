"""Steps of outcomes: found where an outcome jumps, not where it is only steep; few runs then."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import qmc

from aleator.surrogates.adaptive import AdaptiveSurfaces, steps
from aleator.surrogates.choice import ResponseSurface
from aleator.surrogates.samples import Samples

Array = NDArray[np.float64]
BOX = np.array([[0.0, 2.0], [-1.0, 1.0]])


def samples(*outcomes: Array, x: Array) -> Samples:
    y = np.stack(outcomes)
    return Samples(x, y, np.ones(y.shape, dtype=bool))


def points(count: int) -> Array:
    return BOX[:, 0] + qmc.Sobol(2, rng=1).random(count) * np.ptp(BOX, axis=1)


def test_a_jump_across_two_parameters_is_found_at_its_place() -> None:
    x = points(1024)
    made = samples(x.sum(axis=1), x[:, 0] + (x.sum(axis=1) > 1.1), x=x)
    (found,) = steps(made, BOX, np.arange(2))
    assert found.surface == 1
    assert found.size == pytest.approx(1.0, abs=0.1)
    assert min(found.here.sum(), found.there.sum()) <= 1.1 < max(
        found.here.sum(), found.there.sum())  # fmt: skip


@pytest.mark.parametrize("count", [64, 256, 1024])
def test_steep_fronts_kinks_and_exponentials_are_no_steps(count: int) -> None:
    x = points(count)
    front = np.tanh((x[:, 0] - 1.0) / 0.1)
    kink = np.abs(x[:, 0] - 1.0) + x[:, 1]
    growth, ratio = np.exp(6.0 * x[:, 0]), 1.0 / (x[:, 0] + 0.3)
    made = samples(front, kink, growth, ratio, x=x)
    assert steps(made, BOX, np.arange(4)) == ()


def test_runs_that_failed_and_members_not_asked_for_are_left_out() -> None:
    x = points(1024)
    jump = (x[:, 0] > 1.0).astype(float)
    failed = np.where(np.abs(x[:, 0] - 1.0) < 0.05, np.nan, jump)
    made = samples(jump, failed, x=x)
    assert [step.surface for step in steps(made, BOX, np.arange(2))] == [0]
    assert steps(made, BOX, np.array([1])) == ()


def test_an_outcome_that_jumps_is_given_up_and_its_neighbor_is_not() -> None:
    def run(index: NDArray[np.intp], x: Array) -> Array:
        steep = np.tanh((x[:, 0] - 1.0) / 0.08)
        return np.where(index == 0, x[:, 0] + (x[:, 0] > 1.01), steep)

    surfaces = AdaptiveSurfaces(run, BOX[:1], 2, ResponseSurface(max_runs=1000))
    draws = np.clip(np.random.default_rng(1).normal(1.0, 0.2, (512, 1)), 0.0, 2.0)
    surfaces.judge(draws)
    for _ in range(30):
        members = surfaces.unfinished(1e-9)
        if not members.any():
            break
        surfaces.sharpen(members, draws)
    runs = surfaces.emulator.runs
    assert 150 <= runs[0] < 150 * 1.3 + 1
    assert surfaces.relative[1] < 0.01 < surfaces.relative[0]
