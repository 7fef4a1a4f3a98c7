"""Bootstrap: replicates, their intervals, and the file that keeps them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import (
    AleatorError,
    Check,
    Experiments,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
    bootstrap,
)
from aleator.core.progress import Silent
from aleator.inference.model_choice import leave_one_out
from aleator.tasks.bootstrap import (
    ARRIVED,
    FILE,
    ReplicateFile,
    acceleration,
    basic,
    bias_corrected,
    influence,
    percentile,
)

MANY = 200_000
NOTHING = np.zeros((10, 1))


def test_percentiles_are_quantiles_and_basic_ones_are_mirrored() -> None:
    alpha = np.random.default_rng(0).gamma(3.0, size=(MANY, 1))
    low, high = stats.gamma(3.0).ppf([0.025, 0.975])
    assert percentile(alpha)[0] == pytest.approx([low, high], rel=0.02)
    assert basic(np.array([3.0]), alpha)[0] == pytest.approx([6.0 - high, 6.0 - low], abs=0.1)


def test_a_scale_has_the_interval_of_its_transformation() -> None:
    """Efron 1987, section 3: theta chi2_19 / 19, whose score has the skewness sqrt(8 / 19)."""
    df = 19
    alpha = np.random.default_rng(2).chisquare(df, (4 * MANY, 1)) / df
    skewness = np.sqrt(8.0 / df)
    other = optimize.brentq(lambda t: acceleration(pair(t))[0] - skewness / 6.0, -1.0, 0.0)
    found = bias_corrected(np.array([1.0]), alpha, pair(other), level=0.9)[0]
    exact = df / stats.chi2(df).ppf([0.95, 0.05])
    assert found == pytest.approx(exact, rel=0.02)
    assert percentile(alpha, 0.9)[0, 1] < 0.9 * exact[1]


def pair(other: float) -> np.ndarray:
    """The influence of two experiments."""
    return np.array([[1.0], [other]])


def test_the_acceleration_is_a_sixth_of_the_skewness() -> None:
    each = np.random.default_rng(4).gamma(1.0, size=(400, 1))
    deviation = each - each.mean()
    skewness = stats.skew(each[:, 0])
    assert acceleration(deviation)[0] == pytest.approx(skewness / 6.0 / np.sqrt(400))
    assert acceleration(NOTHING)[0] == 0.0


def test_without_replicates_or_on_one_side_nothing_is_known() -> None:
    assert np.all(np.isnan(bias_corrected(np.zeros(2), np.zeros((0, 2)), np.zeros((3, 2)))))
    assert np.all(np.isnan(percentile(np.zeros((0, 2)))))
    assert np.all(np.isnan(bias_corrected(np.zeros(1), np.ones((9, 1)), NOTHING)))


HEAD = {"kind": "parametric", "seed": 0, "alpha": [1.0, 0.1], "log_likelihood": -3.5}


@pytest.mark.parametrize(
    "damage",
    [
        {"alpha": ["one", 0.1]}, {"alpha": [1.0, [0.1]]}, {"alpha": [1.0, 0.1, 2.0]},
        {"alpha": None}, {"alpha": {"x": 1.0}}, {"log_likelihood": "low"},
        {"log_likelihood": 10**400}, {"log_likelihood": []}, {"seed": 1}, {"kind": None},
    ],
)  # fmt: skip
def test_a_damaged_head_is_told(tmp_path: Path, damage: dict[str, object]) -> None:
    path = tmp_path / "replicates.jsonl"
    path.write_text(json.dumps({**HEAD, **damage}) + "\n")
    with pytest.raises(AleatorError, match="those of another study"):
        ReplicateFile(path, HEAD).begun()
    path.write_text(json.dumps({key: HEAD[key] for key in ("kind", "seed")}) + "\n")
    with pytest.raises(AleatorError, match="those of another study"):
        ReplicateFile(path, HEAD).begun()


COUNT = 50
DATA = Path(__file__).parents[1] / "data"


def proportional(load: np.ndarray, x: np.ndarray) -> np.ndarray:
    return load * x


def found_with(noise: float | None, count: int = COUNT, seed: int = 0) -> Identification:
    rng = np.random.default_rng(seed)
    load = rng.uniform(1.0, 3.0, count)
    y = load * rng.normal(1.0, 0.2, count) + (noise or 0.0) * rng.standard_normal(count)
    law = Inputs({"x": Normal(Free(0.0, 2.0), Free(0.001, 1.0))})
    return unjudged(
        proportional, pd.DataFrame({"load": load, "y": y}), law, outcome="y", vectorized=True,
        noise=None if noise is None else Noise(noise), verification=Check(0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def found() -> Identification:
    return found_with(0.1)


@pytest.mark.parametrize("kind", ["parametric", "nonparametric"])
def test_it_scatters_as_the_information_or_the_sandwich_says(
    found: Identification, kind: str
) -> None:
    table = bootstrap(found, replicates=100, kind=kind).table()
    inference = found.fit.inference
    asymptotic = {"parametric": inference.standard_error, "nonparametric": inference.sandwich_error}
    errors = asymptotic[kind][inference.identified]
    assert table["standard_error"].to_numpy() == pytest.approx(errors, rel=0.25)
    assert abs(table.loc["x.mean", "bias"]) < 3.5 * table.loc["x.mean", "bias_error"]


@pytest.mark.slow
def test_a_standard_deviation_is_too_small_by_what_is_known() -> None:
    """E[sd] - sd = -3 sd / (4 N) for an sd without noise; here the mean is estimated too."""
    table = bootstrap(found_with(None), replicates=200).table()
    expected = -0.75 * table.loc["x.sd", "estimate"] / COUNT
    assert table.loc["x.sd", "bias"] == pytest.approx(
        expected, abs=3.5 * table.loc["x.sd", "bias_error"]
    )


def test_without_noise_and_by_experiments_it_is_the_plain_bootstrap() -> None:
    """x_l = y_l / load_l is known: a replicate is the mean and the sd of those drawn."""
    found = found_with(None, 30)
    table = found.fit.table
    x = table.outcomes / table.conditions["load"].to_numpy()
    made = bootstrap(found, replicates=4, kind="nonparametric", seed=5).alpha
    for r, alpha in enumerate(made):
        rng = np.random.default_rng(np.random.SeedSequence(5, spawn_key=(r,)))
        drawn = np.repeat(x, rng.multinomial(30, np.full(30, 1.0 / 30)))
        assert alpha == pytest.approx([drawn.mean(), drawn.std()], abs=2e-3)


@pytest.mark.slow
def test_the_answer_does_not_depend_on_workers_and_begins_alike(found: Identification) -> None:
    here = bootstrap(found, replicates=4, seed=2)
    there = bootstrap(found, replicates=3, seed=2, workers=2)
    assert not there.here
    assert there.alpha == pytest.approx(here.alpha[:3], rel=1e-9)
    assert not np.allclose(bootstrap(found, replicates=3, seed=3).alpha, there.alpha)


def test_it_goes_on_where_it_was_stopped(found: Identification, tmp_path: Path) -> None:
    class Impatient(Silent):
        """Presses Ctrl-C after the second replicate."""

        def update(self, text, done=None, total=None):  # noqa: ARG002
            if done == 2:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bootstrap(found, replicates=5, folder=tmp_path, progress=Impatient())
    file = tmp_path / FILE
    lines = file.read_bytes().splitlines()
    assert len(lines) == 3
    marked = {**json.loads(lines[1]), "log_likelihood": 123.0}
    torn = lines[2][:-7]
    file.write_bytes(lines[0] + b"\n" + json.dumps(marked).encode() + b"\n" + torn)
    whole = bootstrap(found, replicates=5, folder=tmp_path)
    assert whole.runs[0].log_likelihood == 123.0
    assert whole.alpha == pytest.approx(bootstrap(found, replicates=5).alpha)
    assert len(file.read_bytes().splitlines()) == 6


def test_what_another_study_left_is_not_taken(found: Identification, tmp_path: Path) -> None:
    bootstrap(found, replicates=2, folder=tmp_path)
    for options in ({"seed": 1}, {"kind": "nonparametric"}):
        with pytest.raises(AleatorError, match="of another study, seed or kind"):
            bootstrap(found, replicates=2, folder=tmp_path, **options)
    with pytest.raises(AleatorError, match="of another study"):
        bootstrap(found_with(0.1, seed=1), replicates=2, folder=tmp_path)


@pytest.mark.slow
def test_a_scale_may_go_to_zero_and_come_back() -> None:
    """Dyestuff: with so few batches some data sets show none of them, and BCa stays in limits."""
    table = Experiments.from_csv(DATA / "dyestuff.csv", outcome="yield", id="unit")
    law = Inputs({"m": Normal(Free(1000.0, 2000.0), Free(0.0, 500.0))})
    found = unjudged(
        lambda m: m, table, law, noise=Noise(Free(1.0, 500.0)), vectorized=True,
        verification=Check(0),
    )  # fmt: skip
    made = bootstrap(found, replicates=60)
    row = made.table().loc["m.sd"]
    assert 0.0 < row["at_limit"] < 0.3
    assert 0.0 <= row["bca_lower"] < row["estimate"] < row["bca_upper"] <= 500.0
    assert row["basic_lower"] >= 0.0
    assert all(run.status == ARRIVED for run in made.runs)


def test_influences_are_the_changes_of_leaving_one_out(found: Identification) -> None:
    left_out = leave_one_out(found.fit)
    own = found.fit.inference.identified
    change = found.fit.alpha[own] - left_out.alpha[:, own]
    assert influence(found.fit) == pytest.approx(change, abs=0.1 * np.abs(change).max())


def test_misuse_is_told(found: Identification, tmp_path: Path) -> None:
    for options, told in [
        ({"replicates": 1}, "1 replicates"),
        ({"kind": "wild"}, "kind 'wild'"),
        ({"replicates": 2, "folder": tmp_path / "file" / "below"}, "cannot be made"),
    ]:
        (tmp_path / "file").write_text("")
        with pytest.raises(AleatorError, match=told):
            bootstrap(found, **options)
    with pytest.raises(AleatorError, match="intervals 'exact'"):
        bootstrap(found, replicates=2).intervals("exact")
