"""Runs that linear outcomes take, and features that few first runs do not see."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

from aleator import Budget, Experiments, Free, GradientMultistart, Inputs, Noise, Normal
from aleator.core.types import Array, Indices
from aleator.laws import TruncatedNormal
from aleator.surrogates import AdaptiveSurfaces, ResponseSurface

N = 20
LAW = {"a": TruncatedNormal(box=(-3.0, 4.0)), "b": TruncatedNormal(box=(-2.0, 3.0))}
BOX = np.array([[-3.0, 4.0], [-2.0, 3.0]])


def table(noise: float) -> pd.DataFrame:
    rng = np.random.default_rng(1)
    c = np.linspace(0.0, 2.0, N)
    a, b = 0.5 + 0.3 * rng.standard_normal(N), 0.4 * rng.standard_normal(N)
    return pd.DataFrame({"c": c, "y": a + b * c + noise * rng.standard_normal(N)})


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_a_linear_outcome_takes_two_runs_more_than_it_has_coefficients(noise: float) -> None:
    """And two to check it; with noise the simulator is known all the same."""
    found = unjudged(
        lambda c, a, b: a + b * c, Experiments.from_frame(table(noise), outcome="y"),
        Inputs(LAW), vectorized=True, noise=Noise(noise) if noise else None,
        search=GradientMultistart(starts=2), budget=Budget(runs=10**6),
    )  # fmt: skip
    assert found.sound
    assert found.runs_by_stage["response surface"] == 5 * N
    assert found.runs_by_stage["verification"] == 2 * N


def test_an_outcome_whose_logarithm_is_linear_takes_no_more() -> None:
    """Over its box it spans eleven decades."""
    rows = table(0.0)
    found = unjudged(
        lambda c, a, b: np.exp(a + b * c), rows.assign(y=np.exp(rows.y)), Inputs(LAW),
        outcome="y", vectorized=True, search=GradientMultistart(starts=2),
        propagation=ResponseSurface(surfaces="own"),
    )  # fmt: skip
    linear = unjudged(
        lambda c, a, b: a + b * c, rows, Inputs(LAW), outcome="y", vectorized=True,
        search=GradientMultistart(starts=2), propagation=ResponseSurface(surfaces="own"),
    )  # fmt: skip
    assert found.sound
    assert found.runs == linear.runs
    for name, one in found.alpha.items():
        known = linear.alpha[name]
        near = 0.1 * (known.standard_error or 0.0)
        assert one.estimate == pytest.approx(known.estimate, abs=near)


def surfaces(run, experiments: int) -> AdaptiveSurfaces:
    return AdaptiveSurfaces(run, BOX, experiments, ResponseSurface())


def test_one_bent_outcome_gives_all_experiments_their_first_runs() -> None:
    def run(index: Indices, x: Array) -> Array:
        return x[:, 0] + np.where(index == 3, np.tanh(2.0 * x[:, 1]), x[:, 1])

    assert surfaces(run, 6).emulator.runs.tolist() == [12] * 6


def test_a_jump_between_few_runs_of_one_experiment_is_met_by_those_of_another() -> None:
    highest = surfaces(lambda _, x: x.sum(axis=1), 12).emulator.samples.x[:, 1].max()
    jump = 0.5 * (highest + BOX[1, 1])

    def run(index: Indices, x: Array) -> Array:
        return x[:, 0] + (x[:, 1] > jump - 0.4 * index)

    alone, together = (surfaces(run, count) for count in (1, 12))
    assert alone.emulator.runs.tolist() == [12]
    assert together.emulator.runs.tolist() == [12] * 12


@pytest.mark.parametrize("bent", [np.sin, np.tanh, lambda z: z**3])
def test_an_odd_function_about_the_middle_is_not_taken_for_a_line(bent) -> None:
    def run(_: Indices, x: Array) -> Array:
        middle = BOX.mean(axis=1)
        return x[:, 0] + bent(x[:, 1] - middle[1])

    assert surfaces(run, 6).emulator.runs.tolist() == [12] * 6


def test_a_failed_run_gives_all_experiments_their_first_runs() -> None:
    def run(index: Indices, x: Array) -> Array:
        return np.where((index == 1) & (x[:, 0] > 3.0), np.nan, x.sum(axis=1))

    assert surfaces(run, 3).emulator.runs.tolist() == [12] * 3


def test_an_outcome_without_box_is_linear_all_the_same() -> None:
    found = unjudged(
        lambda c, a: a * c, Experiments.from_frame(table(0.2).query("c > 0"), outcome="y"),
        Inputs({"a": Normal(Free(-2.0, 3.0), Free(0.01, 2.0))}), vectorized=True,
        noise=Noise(0.2), search=GradientMultistart(starts=2), budget=Budget(runs=10**6),
    )  # fmt: skip
    assert found.runs_by_stage["response surface"] == 4 * (N - 1)
