"""The random fatigue limit on simulated specimens, against the exact likelihood and the truth."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import estimates, maximum, of_study
from scipy import stats

from aleator import Check, Identification
from aleator.core.types import Array
from aleator.study import load_study

STUDY = Path(__file__).parents[2] / "examples" / "fatigue_limit"
TABLE = pd.read_csv(STUDY / "experiments.csv")
TRUTH = {"v.mean": -0.6, "v.sd": 0.03, "b0.value": -1.0, "b1.value": -3.0, "noise.sd": 0.25}
"""What the specimens were made with, as the README tells."""
BOX = (-1.0, -0.48)
GAUSS = np.polynomial.legendre.leggauss(200)


def exact(alpha: Array) -> float:
    """log L(alpha) by Gauss-Legendre over the box, written down without Aleator."""
    mean, sd, b0, b1, noise = alpha
    if min(sd, noise) < 0.002:
        return -1e10
    ratio, y = TABLE["ratio"].to_numpy()[:, None], np.log(TABLE["kilocycles"].to_numpy())[:, None]
    ends = np.clip([mean - 9.0 * sd, mean + 9.0 * sd], *BOX)
    half = 0.5 * (ends[1] - ends[0])
    v = ends.mean() + half * GAUSS[0]
    law = stats.norm.pdf(v, mean, sd) / np.diff(stats.norm.cdf(BOX, mean, sd))
    eta = b0 + b1 * np.log(ratio - np.exp(v))
    return float(np.log(stats.norm.pdf(y, eta, noise) @ (half * GAUSS[1] * law)).sum())


@pytest.fixture(scope="module")
def answer() -> tuple[Array, float, Array]:
    """Where the exact likelihood is largest, its value there, and the standard errors."""
    return maximum(exact, [list(TRUTH.values())])


@pytest.fixture(scope="module")
def found() -> Identification:
    return of_study(STUDY / "study.toml", Check())


@pytest.mark.slow
def test_the_answer_is_the_exact_maximum_of_the_likelihood(
    found: Identification, answer: tuple[Array, float, Array]
) -> None:
    best, value, error = answer
    assert list(found.alpha) == list(TRUTH)
    assert np.all(np.abs(estimates(found) - best) < 0.05 * error)
    told = [e.standard_error for e in found.alpha.values()]
    assert told == pytest.approx(error, rel=0.02)
    assert found.log_likelihood.estimated == pytest.approx(value, abs=0.01)
    assert found.sound


@pytest.mark.slow
def test_the_truth_lies_within_two_standard_errors(found: Identification) -> None:
    for name, value in TRUTH.items():
        estimate, error = found.alpha[name].estimate, found.alpha[name].standard_error
        assert error is not None
        assert abs(estimate - value) < 2.0 * error, name


@pytest.mark.slow
def test_few_nodes_integrate_the_simulator_itself(found: Identification) -> None:
    assert found.propagation == "direct"
    assert found.log_likelihood.estimated == pytest.approx(exact(estimates(found)), abs=0.005)
    assert found.quadrature is not None
    assert found.quadrature["nodes"] < 10
    assert abs(found.quadrature["gap"]) < 0.005


def test_the_script_makes_the_shipped_specimens_of_the_told_truth() -> None:
    script = STUDY / "make_specimens.py"
    made = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert made.stdout == (STUDY / "experiments.csv").read_text(encoding="utf-8")
    readme = (STUDY / "README.md").read_text(encoding="utf-8")
    for name, value in TRUTH.items():
        assert f"| `{name}` | {value} |" in readme


def test_every_run_has_an_outcome() -> None:
    study = load_study(STUDY / "study.toml")
    ends = study.inputs.box
    corners = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(ends))
    for l in range(0, 75, 15):
        outcomes = study.runner()(np.full(len(corners), l), corners)
        assert np.all(np.isfinite(outcomes))
