"""The random fatigue limit with run-outs, against an integral written down without Aleator."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import assert_maximum, errors_of, estimates, of_study
from scipy import stats

from aleator import Check, Identification
from aleator.core.types import Array

STUDY = Path(__file__).parents[2] / "examples" / "run_outs"
TABLE = pd.read_csv(STUDY / "experiments.csv")
TRUTH = {"v.mean": -0.6, "v.sd": 0.03, "b0.value": -1.0, "b1.value": -3.0, "noise.sd": 0.25}
"""What the specimens were made with, as the README tells."""
GAUSS = np.polynomial.legendre.leggauss(400)


def exact(alpha: Array) -> float:
    """log L(alpha): below the limit of a specimen its life is finite, above it is a run-out."""
    mean, sd, b0, b1, noise = alpha
    ratio, y = TABLE["ratio"].to_numpy()[:, None], np.log(TABLE["kilocycles"].to_numpy())[:, None]
    ended = (TABLE["ended"] == "run-out").to_numpy()
    top = np.clip(np.log(ratio), mean - 8.9 * sd, mean + 9.0 * sd)
    half = 0.5 * (top - (mean - 9.0 * sd))
    v = top - half + half * GAUSS[0]
    eta = b0 + b1 * np.log(np.maximum(ratio - np.exp(v), 1e-300))
    seen = np.where(ended[:, None], stats.norm.sf(y, eta, noise), stats.norm.pdf(y, eta, noise))
    each = np.sum(half * GAUSS[1] * seen * stats.norm.pdf(v, mean, sd), axis=1)
    each += ended * stats.norm.sf(np.log(ratio[:, 0]), mean, sd)
    return float(np.log(each).sum())


@pytest.fixture(scope="module")
def found() -> Identification:
    return of_study(STUDY / "study.toml", Check(0))


@pytest.mark.slow
def test_the_answer_is_the_exact_maximum_of_the_likelihood(found: Identification) -> None:
    alpha = estimates(found)
    assert found.sound
    assert found.log_likelihood.estimated == pytest.approx(exact(alpha), abs=0.01)
    assert_maximum(exact, alpha, errors_of(found))


@pytest.mark.slow
def test_the_truth_lies_within_two_standard_errors(found: Identification) -> None:
    distance = np.abs(estimates(found) - list(TRUTH.values())) / errors_of(found)
    assert list(found.alpha) == list(TRUTH)
    assert np.all(distance < 2.0)


def test_the_script_makes_the_shipped_specimens_of_the_told_truth() -> None:
    script = STUDY / "make_specimens.py"
    made = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert made.stdout == (STUDY / "experiments.csv").read_text(encoding="utf-8")
    readme = (STUDY / "README.md").read_text(encoding="utf-8")
    for name, value in TRUTH.items():
        assert f"| `{name}` | {value} |" in readme
