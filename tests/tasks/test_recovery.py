"""A known law, found again: bias and coverage over virtual data sets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from problems import BINDING, SAMPLE, Problem

from aleator import Gaussian, GradientMultistart, MaximumEntropy
from aleator.errors import InputsError
from aleator.observations.experiments import Conditions
from aleator.simulators import FunctionSimulator, Runner
from aleator.tasks.recover import Recovery, recover


def recovered(problem: Problem, truth: dict[str, float], replicates: int, **more) -> Recovery:
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


@pytest.fixture(scope="module")
def normal() -> Recovery:
    problem = replace(SAMPLE, z=np.zeros(50))
    return recovered(problem, {"x.mean": 1.0, "x.sd": 0.6}, 60, density=Gaussian(), seed=1)


@pytest.mark.long
def test_a_normal_sample_is_recovered_with_the_scatter_of_the_books(normal) -> None:
    table = normal.table()
    assert table.index.tolist() == ["x.mean", "x.sd"]
    assert normal.converged.all()
    # the scatter over 60 data sets is known to 9 %: four of them
    assert table["scatter"]["x.mean"] == pytest.approx(0.6 / 50**0.5, rel=0.37)
    assert table["scatter"]["x.sd"] == pytest.approx(0.6 / 100**0.5, rel=0.37)
    assert abs(table["bias"]["x.mean"]) < 4.0 * table["bias_error"]["x.mean"]
    # maximum likelihood divides by N: E sd = sd (1 - 3/(4 N)) to first order
    expected = -0.6 * 0.75 / 50
    assert abs(table["bias"]["x.sd"] - expected) < 4.0 * table["bias_error"]["x.sd"]


@pytest.mark.long
def test_intervals_of_a_normal_sample_cover_as_they_say(normal) -> None:
    """60 intervals of 95 %: fewer than 51 hold the truth once in 500."""
    assert normal.table()["coverage"].min() >= 51 / 60
    width = np.diff(normal.intervals, axis=2)[:, 0, 0]
    assert np.all(width > 0.0)


@pytest.mark.long
def test_a_binding_box_is_recovered() -> None:
    problem = replace(BINDING, z=np.linspace(0.5, 2.0, 60))
    found = recovered(problem, {"x.mean": 0.6, "x.sd": 0.25}, 24, seed=2)
    table = found.table()
    assert np.all(np.abs(table["bias"]) < 4.0 * table["bias_error"] + 0.01)
    # 24 intervals of 95 %: fewer than 19 hold the truth once in 300
    assert table["coverage"].min() >= 19 / 24


def test_the_answer_depends_on_the_seed_and_not_on_the_number_of_workers() -> None:
    problem = replace(SAMPLE, z=np.zeros(15))
    truth = {"x.mean": 1.0, "x.sd": 0.6}
    one = recovered(problem, truth, 3, density=Gaussian(), seed=5)
    two = recovered(problem, truth, 3, density=Gaussian(), seed=5)
    np.testing.assert_array_equal(one.alpha, two.alpha)
    np.testing.assert_array_equal(one.intervals, two.intervals)
    other = recovered(problem, truth, 3, density=Gaussian(), seed=6)
    assert not np.array_equal(one.alpha, other.alpha)
    shared = recovered(problem, truth, 3, density=Gaussian(), seed=5, workers=2)
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
        recovered(SAMPLE, truth, replicates)
    assert caught.value.remedy
