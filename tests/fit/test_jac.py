"""Identifications from a simulator that gives derivatives."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from studies import SPRINGS, done, refused, springs

from aleator import Constant, Free, Identification, Inputs, Noise, Normal, identify

RNG = np.random.default_rng(12)
TIME, RATE = np.linspace(0.5, 3.0, 20), RNG.normal(0.8, 0.15, 20)
LAWS = Inputs({"rate": Normal(Free(0.3, 1.5), Free(0.02, 0.5)), "start": Constant(Free(3.0, 7.0))})


def fading(time: float, rate: float, start: float) -> tuple[float, list[float]]:
    left = start * np.exp(-rate * time)
    return left, [-time * left, left / start]


LEFT = np.array([fading(*row)[0] for row in zip(TIME, RATE, np.full(20, 5.0), strict=True)])
TABLE = pd.DataFrame({"time": TIME, "left": LEFT + 0.05 * RNG.standard_normal(20)})


def found_with(simulator: Callable[..., Any], jac: bool) -> Identification:
    return identify(
        simulator, TABLE, LAWS, outcome="left", noise=Noise(0.05), jac=jac, vectorized=False,
        consistency=False, best_law=False,
    )  # fmt: skip


def test_half_of_the_runs_give_the_same_estimates() -> None:
    plain = found_with(lambda time, rate, start: fading(time, rate, start)[0], jac=False)
    sloped = found_with(fading, jac=True)
    assert sloped.runs <= 0.6 * plain.runs
    assert sloped.sound
    for name in ("rate.mean", "rate.sd", "start.value"):
        one, error = plain.alpha[name].estimate, plain.alpha[name].standard_error
        assert error is not None
        assert abs(sloped.alpha[name].estimate - one) < 0.05 * error
    assert plain.surface is not None
    assert sloped.surface is not None
    assert plain.surface["slopes"] == 0
    assert sloped.surface["slopes"] == sloped.surface["runs"]


STUDY = SPRINGS.replace("vectorized = false", "jac = true")
MODEL = """\
def length(load, softness):
    return load * softness**2, {"softness": 2.0 * load * softness}
"""


@pytest.mark.usefixtures("unjudged_commands")
def test_a_study_with_derivatives_is_replayed_from_its_store(tmp_path: Path) -> None:
    study = springs(tmp_path, study=STUDY, model=MODEL)
    for folder in ("first", "again"):
        done("identify", study, "--quiet", "--output", tmp_path / folder)
    first, again = (
        json.loads((tmp_path / folder / "identification.json").read_text())
        for folder in ("first", "again")
    )
    assert first["alpha"] == again["alpha"]
    assert first["surface"]["rounds"] == again["surface"]["rounds"]
    assert first["surface"]["slopes"] == first["surface"]["runs"]
    assert "gave derivatives" in (tmp_path / "first" / "report.html").read_text()


def test_a_wrong_derivative_ends_a_study(tmp_path: Path) -> None:
    study = springs(tmp_path, study=STUDY, model=MODEL.replace("2.0 * load", "load"))
    assert "by 'softness'" in refused("identify", study, "--quiet")
