"""The random fatigue limit on specimens, with run-outs and without, against exact integrals."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import assert_maximum, errors_of, estimates, maximum, of_study
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


@pytest.mark.parametrize("folder", [STUDY, STUDY.with_name("run_outs")], ids=lambda f: f.name)
def test_the_script_makes_the_shipped_specimens_of_the_told_truth(folder: Path) -> None:
    script = folder / "make_specimens.py"
    made = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert made.stdout == (folder / "experiments.csv").read_text(encoding="utf-8")
    readme = (folder / "README.md").read_text(encoding="utf-8")
    for name, value in TRUTH.items():
        assert f"| `{name}` | {value} |" in readme


def test_every_run_has_an_outcome() -> None:
    study = load_study(STUDY / "study.toml")
    ends = study.inputs.box
    corners = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(ends))
    for l in range(0, 75, 15):
        outcomes = study.runner()(np.full(len(corners), l), corners)
        assert np.all(np.isfinite(outcomes))


RUN_OUTS = Path(__file__).parents[2] / "examples" / "run_outs"
ENDED = pd.read_csv(RUN_OUTS / "experiments.csv")
"""What the specimens were made with, as the README tells."""
GAUSS_400 = np.polynomial.legendre.leggauss(400)


def exact_of_run_outs(alpha: Array) -> float:
    """log L(alpha): below the limit of a specimen its life is finite, above it is a run-out."""
    mean, sd, b0, b1, noise = alpha
    ratio, y = ENDED["ratio"].to_numpy()[:, None], np.log(ENDED["kilocycles"].to_numpy())[:, None]
    ended = (ENDED["ended"] == "run-out").to_numpy()
    top = np.clip(np.log(ratio), mean - 8.9 * sd, mean + 9.0 * sd)
    half = 0.5 * (top - (mean - 9.0 * sd))
    v = top - half + half * GAUSS_400[0]
    eta = b0 + b1 * np.log(np.maximum(ratio - np.exp(v), 1e-300))
    seen = np.where(ended[:, None], stats.norm.sf(y, eta, noise), stats.norm.pdf(y, eta, noise))
    each = np.sum(half * GAUSS_400[1] * seen * stats.norm.pdf(v, mean, sd), axis=1)
    each += ended * stats.norm.sf(np.log(ratio[:, 0]), mean, sd)
    return float(np.log(each).sum())


@pytest.fixture(scope="module")
def found_run_outs() -> Identification:
    return of_study(RUN_OUTS / "study.toml", Check(0))


@pytest.mark.slow
def test_run_outs_have_the_exact_maximum_of_the_likelihood(found_run_outs: Identification) -> None:
    alpha = estimates(found_run_outs)
    assert found_run_outs.sound
    assert found_run_outs.log_likelihood.estimated == pytest.approx(
        exact_of_run_outs(alpha), abs=0.01
    )
    assert_maximum(exact_of_run_outs, alpha, errors_of(found_run_outs))


@pytest.mark.slow
def test_the_truth_of_run_outs_lies_within_two_standard_errors(
    found_run_outs: Identification,
) -> None:
    distance = np.abs(estimates(found_run_outs) - list(TRUTH.values())) / errors_of(found_run_outs)
    assert list(found_run_outs.alpha) == list(TRUTH)
    assert np.all(distance < 2.0)
