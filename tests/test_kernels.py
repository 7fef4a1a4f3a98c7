"""One answer, whichever kernel of the BLAS the processor takes, and with any number of threads."""

import json
import os
import subprocess
import sys

import kernels
import numpy as np
import pytest

STUDIES = """
import json
import numpy as np, pandas as pd
from aleator import Free, GradientMultistart, Inputs, Noise, Normal, identify

rng = np.random.default_rng(41)
load = np.linspace(0.5, 2.0, 8)
y = load * np.exp(0.3 * rng.normal(size=8)) + 0.05 * rng.normal(size=8)
table, law = pd.DataFrame({"load": load, "y": y}), Normal(Free(-1.0, 1.0), Free(0.02, 1.0))
found = [
    identify(lambda load, x: load * np.exp(x), table, Inputs({"x": law}), outcome="y",
             vectorized=True, noise=noise, search=GradientMultistart(starts=2), consistency=False,
             best_law=False)
    for noise in (None, Noise(0.05))
]
print(json.dumps([
    [[e.estimate, *e.interval, e.standard_error] for e in f.alpha.values() if not e.fixed]
    + [[f.log_likelihood.estimated, f.log_likelihood.verified or 0.0, 0.0, 1.0]] for f in found
]))
"""
CASES = [*kernels.KERNELS.items()]


def answers(choice: dict[str, str]) -> np.ndarray:
    """Estimate, interval and standard error of each hyperparameter of the studies."""
    made = subprocess.run(
        [sys.executable, "-c", STUDIES], env={**os.environ, **choice}, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    return np.array([row for study in json.loads(made.stdout) for row in study])


@pytest.fixture(scope="module")
def own() -> np.ndarray:
    return answers({})


@pytest.mark.parametrize(("asked", "known"), CASES)
def test_an_answer_is_the_same_under_every_kernel(asked: str, known: str, own: np.ndarray) -> None:
    choice = {"OPENBLAS_CORETYPE": asked}
    if kernels.taken({}) == known:
        pytest.skip(f"{asked} is the kernel that all others are held against")
    if kernels.taken(choice) != known:
        pytest.skip(f"the processor or the BLAS lacks {asked}")
    assert_same(answers(choice), own)


def test_an_answer_is_the_same_with_two_threads(own: np.ndarray) -> None:
    assert_same(answers({"OPENBLAS_NUM_THREADS": "2"}), own)


def assert_same(here: np.ndarray, there: np.ndarray) -> None:
    """To a thousandth of a standard error."""
    error = there[:, -1:]
    assert here / error == pytest.approx(there / error, abs=1e-3)
