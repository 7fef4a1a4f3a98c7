"""Whether experiments share a surface, and what an identification on it finds."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from numpy.typing import NDArray

from aleator import Free, Inputs, MaximumEntropy, MonteCarlo, Normal, ResponseSurface
from aleator.errors import InputsError
from aleator.observations.experiments import Experiments
from aleator.simulators import FunctionSimulator, Runner
from aleator.study.propagation import PROPAGATIONS
from aleator.surrogates import AdaptiveSurfaces, surfaces_of
from aleator.surrogates.choice import Sharing
from aleator.surrogates.own import OwnSurfaces
from aleator.surrogates.shared import SharedSurface

RNG = np.random.default_rng(8)
EFFECTS = RNG.normal(size=(40, 2))
REGION = np.array([[0.5, 1.5], [-1.0, 1.0]])
WHERE = REGION[:, 0] + RNG.random((64, 2)) * np.diff(REGION, axis=1).T


def smooth(speed, load, a, b):
    return np.exp(0.5 * a * speed) + load * b + 0.3 * speed * a * b


def unexplained(specimen, a, b):
    effect = EFFECTS[specimen.astype(int)]
    return np.sin(1.5 * effect[:, 0] * a + 1.5 * effect[:, 1] * b)


def runner_of(function, **conditions) -> Runner:
    table = pd.DataFrame({**conditions, "y": np.ones(40)})
    return Runner(
        FunctionSimulator(function, vectorized=True),
        Experiments.from_frame(table, outcome="y"),
        ["a", "b"],
    )


def first(runner: Runner, choice: Sharing) -> AdaptiveSurfaces:
    return surfaces_of(runner, REGION, ResponseSurface(surfaces=choice))


def test_experiments_that_their_conditions_explain_share_a_surface() -> None:
    runner = runner_of(smooth, speed=RNG.uniform(1.0, 2.0, 40), load=RNG.uniform(0.0, 5.0, 40))
    surfaces = first(runner, "automatic")
    assert isinstance(surfaces.emulator, SharedSurface)
    assert surfaces.emulator.runs.tolist() == [8] * 40
    surfaces.separate()
    assert isinstance(surfaces.emulator, SharedSurface)


@pytest.mark.long
def test_experiments_whose_shared_surface_is_full_go_on_with_their_own() -> None:
    runner = runner_of(smooth, speed=RNG.uniform(1.0, 2.0, 40), load=RNG.uniform(0.0, 5.0, 40))
    surfaces = first(runner, "automatic")
    shared = surfaces.emulator
    assert isinstance(shared, SharedSurface)
    while not shared.full:
        surfaces.sharpen(np.ones(40, dtype=np.bool_), WHERE)
    surfaces.separate()
    assert isinstance(surfaces.emulator, OwnSurfaces)
    assert np.all(surfaces.emulator.runs > shared.runs)
    assert surfaces.total_runs == runner.runs


def test_experiments_that_no_condition_explains_have_their_own_and_no_run_is_lost() -> None:
    runner = runner_of(unexplained, specimen=np.arange(40.0))
    surfaces = first(runner, "automatic")
    assert isinstance(surfaces.emulator, OwnSurfaces)
    assert surfaces.total_runs == runner.runs
    assert np.all(surfaces.emulator.runs > 8)
    surfaces.judge(WHERE)
    surfaces.refine(WHERE, 0.05)
    truth = np.sin(1.5 * EFFECTS @ WHERE.T)
    error = surfaces.surface().evaluate(WHERE) - truth
    assert np.quantile(np.sqrt((error**2).mean(axis=1)), 0.9) < 0.05
    assert np.all(surfaces.emulator.runs < 60)


@pytest.mark.parametrize("conditions", [{}, {"load": np.full(40, 2.0)}])
def test_without_conditions_that_vary_there_is_nothing_to_share(
    conditions: dict[str, NDArray[np.float64]],
) -> None:
    def alone(a, b, load=1.0):
        return a * load + b

    runner = runner_of(alone, **conditions)
    assert isinstance(first(runner, "automatic").emulator, OwnSurfaces)
    with pytest.raises(InputsError, match="cannot share a surface"):
        first(runner, "shared")


def test_each_has_its_own_unless_asked() -> None:
    runner = runner_of(smooth, speed=RNG.uniform(1.0, 2.0, 40), load=RNG.uniform(0.0, 5.0, 40))
    assert isinstance(surfaces_of(runner, REGION, ResponseSurface()).emulator, OwnSurfaces)


@pytest.mark.parametrize(
    ("value", "expected"),
    [(None, "own"), (False, "own"), (True, "shared"), ("automatic", "automatic")],
)
def test_the_key_of_the_study(value: object, expected: Sharing) -> None:
    section = PROPAGATIONS.read({} if value is None else {"shared": value})
    assert section.build(Path()).surfaces == expected


def test_a_shared_surface_has_no_tolerance_of_its_own() -> None:
    with pytest.raises(InputsError, match="leave out the tolerance"):
        ResponseSurface(tolerance=0.01, surfaces="shared")


def test_a_shared_surface_leads_to_the_exact_maximum() -> None:
    load = RNG.uniform(1.0, 3.0, 40)
    x = RNG.normal(1.0, 0.1, 40)
    table = pd.DataFrame({"load": load, "y": load * x + np.sin(load)})
    inputs = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})
    result = unjudged(
        lambda load, x: load * x + np.sin(load), table, inputs, outcome="y",
        propagation=ResponseSurface(surfaces="shared"), density=MaximumEntropy(order=4),
        verification=MonteCarlo(0),
    )  # fmt: skip
    assert result.alpha["x.mean"].estimate == pytest.approx(x.mean(), abs=0.02 * x.std())
    assert result.alpha["x.sd"].estimate == pytest.approx(x.std(), rel=0.02)
    assert result.surface is not None
    assert result.surface["runs"] <= 40 * 16
