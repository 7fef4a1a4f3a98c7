"""The wet clutch as a program against the function: one model, integrated two ways."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from aleator.study import load_study
from examples.wet_clutch.model import shifting_time

EXAMPLE = Path(__file__).parents[2] / "examples" / "wet_clutch"
PROGRAM = EXAMPLE / "command" / "clutch.py"


@pytest.fixture(scope="module")
def program() -> ModuleType:
    specification = importlib.util.spec_from_file_location("clutch_program", PROGRAM)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def corners_and_points(count: int) -> dict[str, np.ndarray]:
    """Runs of random experiments all over the box, its corners first."""
    random = np.random.default_rng(3)
    table = pd.read_csv(EXAMPLE / "experiments.csv")
    rows = random.integers(0, len(table), count)
    columns = {name: table[name].to_numpy()[rows] for name in table.columns[1:6]}
    low, high = (0.5, 0.3), (1.4, 1.2)
    c2, zp = random.uniform(low, high, (count, 2)).T
    c2[:4], zp[:4] = [0.5, 0.5, 1.4, 1.4], [0.3, 1.2, 0.3, 1.2]
    return {**columns, "c2_scale": c2, "zp_scale": zp}


def test_the_program_has_the_shifting_times_of_the_function(program: ModuleType) -> None:
    columns = corners_and_points(60)
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    found = [program.Engagement(**row).shifting_time() for row in rows]
    # Either side is known to some 4e-7 s.
    assert np.max(np.abs(found - shifting_time(**columns))) < 1e-6


def test_the_program_prints_what_it_computes(program: ModuleType) -> None:
    given = {
        "pulse_duration": 0.11, "hold_current": 0.26, "pulse_current": 0.07,
        "motor_speed": 1200.0, "brake_torque": 80.0, "c2_scale": 0.91, "zp_scale": 0.55,
    }  # fmt: skip
    words = [f"{name}={value!r}" for name, value in given.items()]
    command = [sys.executable, "-S", PROGRAM, *words]
    printed = subprocess.run(command, capture_output=True, text=True, check=True)
    assert float(printed.stdout) == program.Engagement(**given).shifting_time()
    assert float(printed.stdout) == pytest.approx(0.62697, abs=5e-6)


def test_a_clutch_that_never_closes_is_a_failed_run(program: ModuleType) -> None:
    given = {
        "pulse_duration": 0.07, "hold_current": 0.248, "pulse_current": 0.07,
        "motor_speed": 1200.0, "brake_torque": 1e4,
    }  # fmt: skip
    assert program.Engagement(**given).shifting_time() is None
    words = [f"{name}={value!r}" for name, value in given.items()]
    ended = subprocess.run([sys.executable, PROGRAM, *words], capture_output=True, text=True)
    assert ended.returncode == 1
    assert "synchronize" in ended.stderr
    assert np.isnan(shifting_time(**given, c2_scale=1.0, zp_scale=1.0))


def test_both_studies_of_the_program_can_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    # The tests' own interpreter first: another on the PATH may be a script that starts slowly.
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    original = load_study(EXAMPLE / "study.toml")
    study = load_study(EXAMPLE / "command" / "study.toml")
    for name in ("propagation", "density", "search", "seed"):
        assert getattr(study, name) == getattr(original, name), name
    assert study.inputs.hyperparameters == original.inputs.hyperparameters
    few = load_study(EXAMPLE / "three_ways" / "command.toml")
    x = [[0.9, 0.74]] * 2
    expected = original.runner()([3, 105], x)
    assert study.runner()([3, 105], x) == pytest.approx(expected, abs=1e-6)
    assert few.runner()([0, 6], x) == pytest.approx(expected, abs=1e-6)
