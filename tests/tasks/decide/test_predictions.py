"""Predictions with the uncertainty of alpha, against closed forms of linear models."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import stats

from aleator import Check, Free, GradientMultistart, Identification, Inputs, Noise, Normal

N = 12
LOAD = np.linspace(1.0, 3.0, N)
SCORES = stats.norm.ppf((np.arange(N) + 0.5) / N)[np.random.default_rng(3).permutation(N)]
TABLE = pd.DataFrame({"load": LOAD, "y": LOAD * (1.0 + 0.1 * SCORES)})
NEW = pd.DataFrame({"load": [2.0, 10.0]})
QUANTILES = (0.025, 0.5, 0.975)


@pytest.fixture(scope="module")
def found() -> Identification:
    """y = load x without noise: x itself is seen, a normal sample of twelve."""
    return unjudged(
        lambda load, x: load * x, TABLE, Inputs({"x": Normal(Free(0.5, 1.5), Free(0.01, 0.5))}),
        outcome="y", vectorized=True, search=GradientMultistart(1), verification=Check(0),
    )  # fmt: skip


def test_a_new_value_of_a_normal_sample_has_students_t(found: Identification) -> None:
    """(y/load - mean)/(s sqrt(1 + 1/N)) has t with N - 1 degrees of freedom (Geisser, 1993)."""
    x = TABLE["y"] / TABLE["load"]
    exact = x.mean() + stats.t.ppf(QUANTILES, N - 1) * x.std() * np.sqrt(1.0 + 1.0 / N)
    told = found.predict(NEW, uncertainty=found.draws(1024, by_likelihood=True))
    for row, load in enumerate(NEW["load"]):
        quantiles = told.loc[row, [f"q{p:g}" for p in QUANTILES]].to_numpy(float)
        assert quantiles / load == pytest.approx(exact, abs=0.04 * x.std())
    approximate = found.predict(NEW)
    narrow = found.predict(NEW, uncertainty=False)
    for name in ("q0.025", "q0.975"):
        away = [abs(t.loc[0, name] / 2.0 - x.mean()) for t in (told, approximate, narrow)]
        assert away[0] > away[1] > away[2]


def test_the_median_has_the_interval_of_the_mean(found: Identification) -> None:
    told = found.predict(NEW)
    interval = found.intervals.loc["x.mean"].to_numpy()
    ends = told[["q0.5.lower", "q0.5.upper"]].to_numpy()
    assert ends == pytest.approx(np.outer(NEW["load"], interval), rel=5e-3)


def test_conditions_beyond_the_tested_ones_are_told(found: Identification) -> None:
    assert found.predict(NEW)["beyond"].tolist() == pytest.approx([0.0, 3.5])


def test_with_noise_both_kinds_of_uncertainty_add_up() -> None:
    rng = np.random.default_rng(0)
    rows = pd.DataFrame({"id": np.repeat(np.arange(15), 4), "t": np.tile([0.0, 1, 2, 3], 15)})
    x = np.repeat(rng.normal(1.0, 0.3, 15), 4)
    rows["y"] = x + rows["t"] + rng.normal(0.0, 0.2, 60)
    found = unjudged(
        lambda t, x: x + t, rows, Inputs({"x": Normal(Free(0.0, 2.0), Free(0.01, 2.0))}),
        outcome="y", vectorized=True, noise=Noise(Free(0.01, 1.0)), search=GradientMultistart(1),
        verification=Check(0),
    )  # fmt: skip
    told = found.predict(pd.DataFrame({"t": [1.0]}))
    fixed = found.predict(pd.DataFrame({"t": [1.0]}), uncertainty=False)
    e = found.draws()
    variance = (
        e.weights @ (e.alpha[:, 1] ** 2 + e.alpha[:, 2] ** 2)
        + e.weights @ (e.alpha[:, 0] - e.weights @ e.alpha[:, 0]) ** 2
    )
    assert told["standard_deviation"][0] == pytest.approx(np.sqrt(variance), rel=2e-3)
    assert fixed["standard_deviation"][0] == pytest.approx(
        np.hypot(found.values["x.sd"], found.values["noise.sd"]), rel=2e-3
    )
    known = found.predict(pd.DataFrame({"t": [5.0]}), of="3", noise=False)
    mean = found.individuals.loc["3", "x.mean"]
    assert known["mean"][0] == pytest.approx(5.0 + mean, abs=0.02)
    assert known["beyond"][0] == pytest.approx(2.0 / 3.0)
    alone = found.predict(pd.DataFrame({"t": [5.0]}), of="3", noise=False, uncertainty=False)
    ratio = known["standard_deviation"][0] / alone["standard_deviation"][0]
    assert 1.0 < ratio < 1.1
    assert abs(known["skewness"][0]) < 0.1
