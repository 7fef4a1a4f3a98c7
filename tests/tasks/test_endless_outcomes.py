"""Outcomes that are infinite: a specimen that never breaks."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import stats

import aleator
from aleator import (
    Censoring,
    Check,
    Experiments,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
)

NOISE = 0.05
SD = 1.0
X = stats.norm.ppf((np.arange(12) + 0.5) / 12, 0.2, SD)
FRAME = pd.DataFrame({"life": np.where(X < 0.5, X, 2.0), "end": np.where(X < 0.5, "", "never")})
TABLE = Experiments.from_frame(
    FRAME, outcome="life", conditions=[], censored=Censoring("end", right="never")
)
INPUTS = Inputs({"x": Normal(Free(-2.0, 2.0), SD)})


def life(x):
    return np.where(x < 0.5, x, np.inf)


@pytest.fixture(scope="module")
def found() -> Identification:
    return unjudged(
        life, TABLE, INPUTS, vectorized=True, noise=Noise(NOISE), verification=Check(64)
    )


def test_a_prediction_is_infinite_where_the_law_is(found: Identification) -> None:
    """Of the lives that end those below y are Phi((y - mean)/sd) of all, but for the noise."""
    mean = found.values["x.mean"]
    ends = stats.norm.cdf(0.5, mean, SD)
    told = found.predict(pd.DataFrame({"row": [1]}), noise=False, uncertainty=False).iloc[0]
    assert told["status"] == "solved"
    assert told["mean"] == np.inf
    assert np.isnan(told["standard_deviation"])
    for p in (0.025, 0.25, 0.5):
        assert told[f"q{p}"] == pytest.approx(stats.norm.ppf(p, mean, SD), abs=2e-3)
    assert 0.5 < ends < 0.75
    assert told["q0.75"] == told["q0.975"] == np.inf


def test_an_infinite_prediction_comes_back_from_a_file(found: Identification, tmp_path) -> None:
    found.save(tmp_path / "found.json")
    again = aleator.load(tmp_path / "found.json")
    predicted = np.array([o.predicted for o in found.observations])
    np.testing.assert_array_equal(np.isposinf(predicted), X >= 0.5)
    np.testing.assert_array_equal([o.predicted for o in again.observations], predicted)


def test_with_the_uncertainty_of_alpha_it_is_infinite_where_a_quarter_ends_later(found) -> None:
    told = found.predict(pd.DataFrame({"row": [1]}), noise=False).iloc[0]
    assert told["mean"] == np.inf
    assert told["q0.975"] == told["q0.975.lower"] == told["q0.975.upper"] == np.inf
    assert np.all(np.isfinite(told[["q0.25", "q0.25.lower", "q0.25.upper"]].to_numpy(float)))
    assert told["q0.25.lower"] < told["q0.25"] < told["q0.25.upper"]
