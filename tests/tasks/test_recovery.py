"""A known law, found again in virtual data: bias, coverage, and bounds like those measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from individual_cases import ALPHA, PAIR, straight_line, table
from problems import SAMPLE, Problem

from aleator import Experiments, Free, Gaussian, GradientMultistart, MaximumEntropy, Noise
from aleator.errors import InputsError
from aleator.inference.likelihood_at import censored_alike
from aleator.observations.experiments import Conditions
from aleator.observations.responses import Observations, Response
from aleator.simulators import FunctionSimulator, Runner
from aleator.tasks.recover import Recovery, recover


def recovered_of(problem: Problem, truth: dict[str, float], replicates: int, **more) -> Recovery:
    conditions = Conditions.from_frame(pd.DataFrame({"z": problem.z}))
    simulator = FunctionSimulator(problem.simulator, vectorized=True)
    density = more.pop("density", MaximumEntropy(4))
    return recover(
        Runner(simulator, conditions, problem.inputs.names),
        conditions,
        problem.inputs,
        truth,
        noise=problem.noise,
        density=density,
        search=GradientMultistart(1),
        replicates=replicates,
        **more,
    )


def test_the_answer_depends_on_the_seed_and_not_on_the_number_of_workers() -> None:
    problem = replace(SAMPLE, z=np.zeros(8))
    truth = {"x.mean": 1.0, "x.sd": 0.6}
    one = recovered_of(problem, truth, 3, density=Gaussian(), seed=5)
    two = recovered_of(problem, truth, 3, density=Gaussian(), seed=5)
    np.testing.assert_array_equal(one.alpha, two.alpha)
    np.testing.assert_array_equal(one.intervals, two.intervals)
    other = recovered_of(problem, truth, 3, density=Gaussian(), seed=6)
    assert not np.array_equal(one.alpha, other.alpha)
    shared = recovered_of(problem, truth, 3, density=Gaussian(), seed=5, workers=2)
    np.testing.assert_array_equal(one.alpha, shared.alpha)
    np.testing.assert_array_equal(one.intervals, shared.intervals)


@pytest.mark.parametrize(
    ("truth", "replicates", "named"),
    [
        ({"x.mean": 1.0}, 5, "x.sd"),
        ({"x.mean": 99.0, "x.sd": 0.6}, 5, "x.mean"),
        ({"x.mean": 1.0, "x.sd": 0.6}, 1, "replicates"),
    ],
)
def test_misuse_is_named(truth, replicates, named) -> None:
    with pytest.raises(InputsError, match=named) as caught:
        recovered_of(SAMPLE, truth, replicates)
    assert caught.value.remedy


# ------------------------------------------------------------------------------ series


NOISE = Noise(Free(0.01, 5.0))
TRUTH = dict(
    zip(["a.mean", "a.sd", "b.mean", "b.sd", "correlation.a.b", "noise.sd"], ALPHA, strict=True)
)


def line(time, a, b):
    return straight_line(time, (a, b))


def recovered_series(frame: pd.DataFrame, replicates: int, **more):
    return recover(
        line, Experiments.from_frame(frame, outcome="y", id="id"), PAIR, TRUTH,
        vectorized=True, noise=NOISE, search=GradientMultistart(starts=1), replicates=replicates,
        **more,
    )  # fmt: skip


def test_a_law_of_series_is_recovered() -> None:
    """The sample means of the parameters scatter as sqrt((variance + error^2)/N) at least."""
    frame = pd.DataFrame(
        [{"id": str(l), "time": t, "y": 0.0} for l in range(24) for t in (0.0, 1.0, 2.0, 3.0)]
    )
    found = recovered_series(frame, 6, seed=3)
    told = found.table()
    assert found.converged.all()
    design = np.stack([np.ones(4), [0.0, 1.0, 2.0, 3.0]], axis=1)
    spread = ALPHA[5] ** 2 * np.linalg.inv(design.T @ design)
    for name, place in (("a", 0), ("b", 1)):
        exact = np.sqrt((TRUTH[f"{name}.sd"] ** 2 + spread[place, place]) / 24)
        assert abs(told.loc[f"{name}.mean", "bias"]) < 4.0 * exact / np.sqrt(6)
        assert 0.3 * exact < told.loc[f"{name}.mean", "scatter"] < 2.2 * exact
    assert told.loc["noise.sd", "mean"] == pytest.approx(ALPHA[5], rel=0.15)
    assert told["coverage"].mean() > 0.75


def test_a_truth_outside_the_limits_is_told() -> None:
    with pytest.raises(InputsError, match=r"noise.sd"):
        recover(
            line, Experiments.from_frame(table(straight_line), outcome="y", id="id"), PAIR,
            TRUTH | {"noise.sd": 9.0}, vectorized=True, noise=NOISE, replicates=2,
        )  # fmt: skip


def observed(lower, upper) -> Observations:
    each = np.arange(len(lower))
    return Observations(each, each, 0 * each, lower, upper, (Response("y"),))


RNG = np.random.default_rng(0)
INF = np.inf


def test_one_common_bound_is_a_limit_of_the_test() -> None:
    seen = observed([1.0, 5.0, 2.0, 5.0], [1.0, INF, 2.0, INF])
    made = censored_alike(seen, np.array([6.0, 3.0, 4.0, 7.0]), RNG)
    assert made.lower.tolist() == [5.0, 3.0, 4.0, 5.0]
    assert made.upper.tolist() == [INF, 3.0, 4.0, INF]


def test_bounds_that_differ_hold_for_their_own_values() -> None:
    seen = observed([1.0, 5.0, -INF, -INF], [1.0, INF, 2.0, 3.0])
    made = censored_alike(seen, np.array([4.0, 6.0, 1.0, 3.5]), RNG)
    assert made.lower.tolist() == [4.0, 5.0, -INF, 3.5]
    assert made.upper.tolist() == [4.0, INF, 2.0, 3.5]


def test_intervals_keep_their_width_and_hold_the_value() -> None:
    seen = observed([1.0, 2.0], [1.5, 2.0])
    y = np.array([7.0, 8.0])
    made = censored_alike(seen, y, RNG)
    assert made.upper - made.lower == pytest.approx([0.5, 0.0])
    assert np.all((made.lower <= y) & (y <= made.upper))
