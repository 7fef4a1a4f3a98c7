"""The wet clutch as an FMU against the function: the same model, integrated another way."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fmus.build import python_fmu
from identifications import unjudged

from aleator import (
    Check,
    Experiments,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    ResponseSurface,
    TruncatedNormal,
)
from aleator.simulators import FunctionSimulator, Simulator
from aleator.simulators.fmu import Course, Crossing, FMUSimulator
from aleator.study import load_study
from examples.wet_clutch.model import shifting_time

EXAMPLE = Path(__file__).parents[2] / "examples" / "wet_clutch"


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clutch")
    return python_fmu(EXAMPLE / "fmu" / "wet_clutch.py", folder, EXAMPLE / "command" / "clutch.py")


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return pd.read_csv(EXAMPLE / "experiments.csv", dtype={"id": str})


@pytest.fixture(scope="module")
def simulator(fmu: Path) -> Iterator[FMUSimulator]:
    simulator = FMUSimulator(fmu, Crossing("slip", 0.0, "down"), course=Course(step=0.005))
    yield simulator
    simulator.close()


def test_the_fmu_has_the_shifting_times_of_the_function(
    simulator: FMUSimulator, table: pd.DataFrame
) -> None:
    random = np.random.default_rng(0)
    rows = random.integers(0, len(table), 20)
    conditions = {name: table[name].to_numpy()[rows] for name in table.columns[1:6]}
    parameters = {
        "c2_scale": random.uniform(0.5, 1.4, 20),
        "zp_scale": random.uniform(0.3, 1.2, 20),
    }
    expected = shifting_time(**conditions, **parameters)
    assert simulator.asks([*table.columns], [*parameters]) == tuple(conditions)
    found = simulator(conditions, parameters)
    assert np.max(np.abs(found - expected)) < 1e-5
    assert np.median(np.abs(found - expected)) < 1e-7
    assert simulator.notes == ()


def test_the_fmu_leads_to_the_same_law(simulator: FMUSimulator, table: pd.DataFrame) -> None:
    chosen = table.iloc[[1, 20, 40, 61, 82, 103]]
    experiments = Experiments.from_frame(chosen, outcome="shifting_time", id="id")
    # One mean and one scatter free, over coarse surfaces: few runs are enough.
    inputs = Inputs(
        {
            "c2_scale": TruncatedNormal(box=(0.5, 1.4), sd=Free(0.01, 0.4)),
            "zp_scale": TruncatedNormal(box=(0.6, 0.85), mean=0.74, sd=0.01),
        }
    )

    def found(model: Simulator) -> Identification:
        return unjudged(
            model,
            experiments,
            inputs,
            propagation=ResponseSurface(tolerance=0.1, surfaces="own"),
            search=GradientMultistart(starts=2),
            verification=Check(0),
            seed=0,
        )

    by_fmu, by_function = found(simulator), found(FunctionSimulator(shifting_time, vectorized=True))
    assert by_fmu.runs_by_stage == by_function.runs_by_stage
    scatter = by_function.alpha["c2_scale.sd"]
    assert scatter.standard_error is not None  # it is not on a limit, where all would agree
    for name, value in by_function.alpha.items():
        assert by_fmu.alpha[name].estimate == pytest.approx(value.estimate, abs=1e-4), name
    # Six outcomes that differ by up to 1e-5 s.
    assert by_fmu.log_likelihood.estimated == pytest.approx(
        by_function.log_likelihood.estimated, abs=0.012
    )


def test_the_study_of_the_fmu_can_be_read(fmu: Path, tmp_path: Path) -> None:
    (tmp_path / "fmu").mkdir()
    (tmp_path / "fmu" / "WetClutch.fmu").write_bytes(fmu.read_bytes())
    for name in ("experiments.csv", "fmu/study_fmu.toml"):
        (tmp_path / name).write_bytes((EXAMPLE / name).read_bytes())
    study, original = (
        load_study(tmp_path / "fmu" / "study_fmu.toml"),
        load_study(EXAMPLE / "study.toml"),
    )
    assert isinstance(study.simulator, FMUSimulator)
    for name in ("propagation", "density", "search", "seed"):
        assert getattr(study, name) == getattr(original, name)
    assert study.inputs.hyperparameters == original.inputs.hyperparameters
    x = [[0.9, 0.74]] * 2
    assert study.runner()([0, 107], x) == pytest.approx(original.runner()([0, 107], x), abs=1e-5)
    study.simulator.close()
