"""Whether experiments share a surface, and what an identification on it finds."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from numpy.typing import NDArray

from aleator import Check, Free, Inputs, MaximumEntropy, Normal, ResponseSurface
from aleator.errors import InputsError
from aleator.observations.experiments import Experiments
from aleator.simulators import FunctionSimulator, Runner
from aleator.study.sections import PROPAGATIONS
from aleator.surrogates import AdaptiveSurfaces, surfaces_of
from aleator.surrogates.choice import Surfaces
from aleator.surrogates.emulator import OwnSurfaces

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


def first(runner: Runner, choice: Surfaces | None) -> AdaptiveSurfaces:
    return surfaces_of(runner, REGION, ResponseSurface(surfaces=choice))


@pytest.mark.parametrize("conditions", [{}, {"load": np.full(40, 2.0)}])
def test_without_conditions_that_vary_there_is_nothing_to_share(
    conditions: dict[str, NDArray[np.float64]],
) -> None:
    def alone(a, b, load=1.0):
        return a * load + b

    runner = runner_of(alone, **conditions)
    assert isinstance(first(runner, "own").emulator, OwnSurfaces)
    with pytest.raises(InputsError, match="cannot share a surface"):
        first(runner, "shared")


def test_each_has_its_own_unless_asked() -> None:
    runner = runner_of(smooth, speed=RNG.uniform(1.0, 2.0, 40), load=RNG.uniform(0.0, 5.0, 40))
    assert isinstance(surfaces_of(runner, REGION, ResponseSurface()).emulator, OwnSurfaces)


@pytest.mark.parametrize("value", [None, "none", "own", "shared"])
def test_the_key_of_the_study(value: Surfaces | None) -> None:
    section = PROPAGATIONS.read({} if value is None else {"surfaces": value})
    assert section.build(Path()).surfaces == value


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
        verification=Check(0),
    )  # fmt: skip
    assert result.alpha["x.mean"].estimate == pytest.approx(x.mean(), abs=0.02 * x.std())
    assert result.alpha["x.sd"].estimate == pytest.approx(x.std(), rel=0.02)
    assert result.surface is not None
    assert result.surface["runs"] <= 40 * 16
