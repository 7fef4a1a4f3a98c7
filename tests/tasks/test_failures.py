"""Studies in which some runs have no outcome: the answer stands on the others, and says so."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from identifications import unjudged

from aleator import cli
from aleator.core.types import Array
from aleator.errors import SimulatorError
from aleator.fit.question import fails_here_and_there
from aleator.inference.check import Check
from aleator.laws import Free, Normal, TruncatedNormal
from aleator.laws.inputs import Inputs
from aleator.observations.errors import Noise
from aleator.observations.experiments import Conditions
from aleator.simulators import as_runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.identification import Identification
from aleator.tasks.identify import identify

Z = np.linspace(1.0, 2.0, 40)
X = 1.5 + 0.2 * np.random.default_rng(3).standard_normal(40)


def model(z: Array, x: Array) -> Array:
    return z * np.sqrt(x)


TABLE = pd.DataFrame({"z": Z, "y": model(Z, X)})
MEAN, SD = X.mean(), X.std()  # the exact maximum: every x is told by its outcome
WIDE = Inputs({"x": Normal(mean=Free(0.5, 2.0), sd=Free(0.05, 1.0))})
BOXED = Inputs({"x": TruncatedNormal((0.3, 2.7), mean=Free(0.5, 2.5), sd=Free(0.05, 0.5))})


def test_runs_that_fail_here_and_there_leave_the_answer() -> None:
    def brittle(z: Array, x: Array) -> Array:
        hashed = np.modf(1e4 * np.abs(np.sin(1e4 * x + z)))[0]
        return np.where(hashed < 0.06, np.nan, model(z, x))

    check = Check(64)
    whole = unjudged(model, TABLE, BOXED, outcome="y", vectorized=True, verification=check)
    result = unjudged(brittle, TABLE, BOXED, outcome="y", vectorized=True, verification=check)
    error = {name: value.standard_error or 0.0 for name, value in whole.alpha.items()}
    for name, value in result.alpha.items():
        assert abs(value.estimate - whole.alpha[name].estimate) < 0.02 * error[name]
    assert result.sound
    assert result.failures is not None
    share = result.failures.runs / result.failures.needed
    assert share == pytest.approx(0.06, abs=0.02)
    assert "nan" in result.failures.message
    low, high = result.failures.region["x"]
    assert low < MEAN < high
    assert result.failures.experiments in [
        warning.concerns for warning in result.warnings if warning.about == "simulator"
    ]
    assert json.dumps(result.to_dict()["failures"])
    assert whole.failures is None


def test_a_fast_simulator_with_holes_is_not_integrated_over_itself() -> None:
    """Every set of nodes meets other holes: the search took minutes, and surfaces go over them."""

    def brittle(z: Array, x: Array) -> Array:
        hashed = np.modf(1e4 * np.abs(np.sin(1e4 * x + z)))[0]
        return np.where(hashed < 0.02, np.nan, model(z, x))

    def ends(z: Array, x: Array) -> Array:
        return np.where(x > 2.4, np.nan, model(z, x))

    def answer(simulator: Callable[..., Array]) -> Identification:
        return identify(
            simulator, TABLE, BOXED, outcome="y", vectorized=True, noise=Noise(0.02),
            verification=Check(0), consistency=False, best_law=False,
        )  # fmt: skip

    whole, holes, cut = answer(model), answer(brittle), answer(ends)
    assert holes.propagation == "response_surface"
    for name, value in whole.alpha.items():
        for other in (holes, cut):
            near = 0.01 * (value.standard_error or 1.0)
            assert other.alpha[name].estimate == pytest.approx(value.estimate, abs=near)
    run = as_runner(ends, Conditions(("A",), pd.DataFrame({"z": [1.0]})), ["x"], vectorized=True)
    assert not fails_here_and_there(run, np.array([1.5]), np.array([[0.3, 2.7]]))


def test_the_first_look_of_a_law_without_a_box_leaves_out_what_fails() -> None:
    free = Inputs({"x": Normal(mean=Free(1.2, 1.8), sd=Free(0.05, 0.25))})

    def brittle(z: Array, x: Array) -> Array:
        lost = (np.abs(x - 1.5) < 1e-3) & (np.abs(z - Z[3]) < 1e-9)
        return np.where(lost, np.nan, model(z, x))

    check = Check(64)
    whole = unjudged(model, TABLE, free, outcome="y", vectorized=True, verification=check)
    result = unjudged(brittle, TABLE, free, outcome="y", vectorized=True, verification=check)
    for name, value in result.alpha.items():
        error = whole.alpha[name].standard_error
        assert error is not None
        assert abs(value.estimate - whole.alpha[name].estimate) < 0.05 * error
    assert result.failures is not None
    assert "4" in result.failures.experiments


def test_a_failed_corner_is_told_and_costs_accuracy_only_there() -> None:
    def hot(z: Array, x: Array) -> Array:
        return np.where((x > 2.2) & (z > 1.7), np.nan, model(z, x))

    result = unjudged(hot, TABLE, BOXED, outcome="y", vectorized=True)
    assert result.alpha["x.mean"].estimate == pytest.approx(MEAN, abs=0.1 * SD / 40**0.5)
    assert result.failures is not None
    low, high = result.failures.region["x"]
    assert 2.2 < low < high <= 2.7
    assert set(result.failures.experiments) <= {str(k + 1) for k in range(40) if Z[k] > 1.7}


def test_a_law_that_reaches_far_beyond_the_simulator_is_given_the_box_that_mends_it() -> None:
    everywhere = ResponseSurface(tolerance=0.005)
    beyond = Inputs({"x": Normal(mean=Free(-2.0, 2.0), sd=Free(0.05, 1.0))})
    with pytest.raises(SimulatorError) as caught:
        unjudged(model, TABLE, beyond, outcome="y", vectorized=True, propagation=everywhere)
    lines = [line.strip() for line in caught.value.remedy.splitlines()]
    assert 'law = "truncated_normal"' in lines
    (box,) = (line for line in lines if line.startswith("box = "))
    low, high = (float(end) for end in box.removeprefix("box = [").rstrip("]").split(","))
    assert 0.0 <= low < 0.5
    assert high > 2.0
    assert "aleator box" in caught.value.remedy


def test_surfaces_that_are_to_be_exact_where_runs_fail_are_refused() -> None:
    """Through the root a polynomial explodes where there is none: its own scatter says nothing."""
    everywhere = ResponseSurface(tolerance=0.005)
    result = unjudged(model, TABLE, WIDE, outcome="y", vectorized=True, propagation=everywhere)
    assert not result.sound
    assert any("aleator box" in warning.remedy for warning in result.warnings)


def test_surfaces_that_follow_the_law_leave_what_fails_behind() -> None:
    def rooted(z: Array, x: Array) -> Array:
        return np.where(x > 0.0, model(z, np.abs(x)), np.nan)

    result = unjudged(rooted, TABLE, WIDE, outcome="y", vectorized=True, verification=Check(0))
    assert result.alpha["x.mean"].estimate == pytest.approx(MEAN, abs=1e-3)
    assert result.alpha["x.sd"].estimate == pytest.approx(SD, abs=1e-3)
    assert result.failures is not None
    assert result.failures.region["x"][1] <= 0.0


def test_the_study_says_how_many_failures_are_too_many(tmp_path: Path) -> None:
    (tmp_path / "model.py").write_text(
        "def model(z, x):\n    if 0.8 < x < 1.1: raise ValueError('stuck')\n    return z * x**0.5\n"
    )
    TABLE.to_csv(tmp_path / "table.csv", index=False)
    study = tmp_path / "study.toml"
    text = (
        '[experiments]\nfile = "table.csv"\noutcome = "y"\n[simulator]\n'
        'function = "model.py:model"\n{}\n[parameters.x]\nlaw = "truncated_normal"\n'
        "box = [0.3, 2.7]\n[verification]\nsamples = 50\n"
    )
    out = ["--output", str(tmp_path / "out"), "--no-figures"]
    study.write_text(text.format("max_failed = 0.01"))
    refused = CliRunner().invoke(cli.main, ["identify", str(study), *out])
    assert refused.exit_code == 2
    assert "stuck" in refused.stderr
    study.write_text(text.format("max_failed = 0.5\nretries = 1"))
    done = CliRunner().invoke(cli.main, ["identify", str(study), *out])
    assert done.exit_code == 0, done.stderr
    document = json.loads((tmp_path / "out" / "identification.json").read_text())
    low, high = document["failures"]["region"]["x"]
    assert 0.8 < low < high < 1.1
    assert "stuck" in document["failures"]["message"]
    assert "simulator" in [warning["about"] for warning in document["warnings"]]
