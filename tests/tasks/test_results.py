"""What a user holds after an identification: tables, predictions, files, and figures that agree."""

import io
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from individual_cases import PAIR, straight_line, table
from rich.console import Console
from scipy import stats
from springs import asked, found_with, springs

import aleator
from aleator import (
    Censoring,
    Check,
    Collocation,
    Experiments,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    MaximumEntropy,
    Noise,
    Normal,
    plot,
)
from aleator.core.types import Array
from aleator.errors import AleatorError
from aleator.results.answer import answer
from aleator.results.documents import to_json
from aleator.results.printed import fragment
from aleator.tasks.identification import pictured
from aleator.views.identification import render
from aleator.views.law_charts import profile_line

FRAME = table(straight_line, experiments=12)
TABLE = Experiments.from_frame(FRAME, outcome="y", id="id")


def line(time, a, b):
    return straight_line(time, (a, b))


@pytest.fixture(scope="module")
def found() -> Identification:
    return unjudged(
        line, TABLE, PAIR, vectorized=True,
        noise=Noise(Free(0.01, 5.0)), search=GradientMultistart(starts=2),
    )  # fmt: skip


def marginal(found, experiment):
    """Mean (m,) and covariance (m, m) of the values of an experiment under the answer."""
    values, own = found.values, FRAME[FRAME["id"] == experiment]
    sds = values[["a.sd", "b.sd"]].to_numpy()
    law = np.outer(sds, sds) * (np.eye(2) + values["correlation.a.b"] * (1.0 - np.eye(2)))
    design = np.stack([np.ones(len(own)), own["time"]], axis=1)
    noise = values["noise.sd"] ** 2 * np.eye(len(own))
    means = values[["a.mean", "b.mean"]].to_numpy()
    return design @ means, design @ law @ design.T + noise


def test_the_probabilities_are_those_of_the_conditional_normal_laws(found: Identification) -> None:
    """Rosenblatt's transform of a normal law is by its Cholesky factor."""
    for experiment in FRAME["id"].unique():
        y = FRAME.loc[FRAME["id"] == experiment, "y"].to_numpy()
        mean, covariance = marginal(found, experiment)
        exact = stats.norm.cdf(np.linalg.solve(np.linalg.cholesky(covariance), y - mean))
        told = [o.pit for o in found.observations if o.id == experiment]
        assert told == pytest.approx(exact, abs=0.01)


NEW = pd.DataFrame({"time": [0.5, 4.0]})
DESIGN = np.stack([np.ones(2), NEW["time"]], axis=1)
PROBABILITIES = (0.025, 0.25, 0.5, 0.75, 0.975)


def law(found):
    """Mean (2,) and covariance (2, 2) of the two parameters."""
    values = found.values
    sds = values[["a.sd", "b.sd"]].to_numpy()
    matrix = np.eye(2) + values["correlation.a.b"] * (1.0 - np.eye(2))
    return values[["a.mean", "b.mean"]].to_numpy(), np.outer(sds, sds) * matrix


def individual_law(found, experiment):
    """The same given the observations of an experiment: the best linear predictor."""
    mean, covariance = law(found)
    own = FRAME[FRAME["id"] == experiment]
    design = np.stack([np.ones(len(own)), own["time"]], axis=1)
    expected, whole = marginal(found, experiment)
    gain = covariance @ design.T @ np.linalg.inv(whole)
    return mean + gain @ (own["y"] - expected), covariance - gain @ design @ covariance


def is_normal(table, mean, sd):
    assert table["status"].tolist() == ["solved"] * len(table)
    assert (table["mean"].to_numpy() - mean) / sd == pytest.approx(0.0, abs=5e-3)
    assert table["standard_deviation"].to_numpy() == pytest.approx(sd, rel=5e-3)
    told = table[[f"q{p:g}" for p in PROBABILITIES]].to_numpy()
    scores = (told - mean[:, None]) / sd[:, None]
    assert scores == pytest.approx(np.tile(stats.norm.ppf(PROBABILITIES), (2, 1)), abs=0.03)


@pytest.mark.parametrize("noise", [True, False])
@pytest.mark.parametrize("experiment", [None, "e0", "e5"])
def test_predictions_are_those_of_the_linear_mixed_model(found, experiment, noise) -> None:
    mean, covariance = law(found) if experiment is None else individual_law(found, experiment)
    variance = np.diag(DESIGN @ covariance @ DESIGN.T) + noise * found.values["noise.sd"] ** 2
    told = found.predict(
        NEW, of=experiment, noise=noise, uncertainty=False, quantiles=PROBABILITIES
    )
    is_normal(told, DESIGN @ mean, np.sqrt(variance))


def normal_tail(found, experiment=None):
    """The probability that a exceeds 1.3, of a new experiment or of a measured one."""
    mean, covariance = law(found) if experiment is None else individual_law(found, experiment)
    return stats.norm.sf(1.3, mean[0], np.sqrt(covariance[0, 0]))


@pytest.mark.parametrize("experiment", [None, "e0", "e5"])
def test_the_probability_of_a_parameter_is_that_of_its_law(found, experiment, tmp_path) -> None:
    exact = normal_tail(found, experiment)
    found.save(tmp_path / "found.json")
    parts = {"inputs": PAIR, "noise": Noise(Free(0.01, 5.0))}
    if experiment is not None:
        parts |= {"simulator": line, "vectorized": True, "experiments": TABLE}
    for one in (found, aleator.load(tmp_path / "found.json", **parts)):
        (told,) = one.probability("a > 1.3", of=experiment).to_dict("records")
        assert told["at_estimate"] == pytest.approx(exact, rel=0.02, abs=1e-3)
        assert told["lower"] <= told["at_estimate"] <= told["upper"]
        assert told["outcome"] == "a"
    draws = found.draws().fewer(64)
    each = [
        normal_tail(replace(found, alpha={
            name: replace(estimate, estimate=value)
            for (name, estimate), value in zip(found.alpha.items(), alpha, strict=True)
        }), experiment)
        for alpha in draws.alpha
    ]  # fmt: skip
    mixed = found.probability("a > 1.3", of=experiment, uncertainty=draws)["probability"].item()
    assert mixed == pytest.approx(np.average(each, weights=draws.weights), rel=0.02, abs=1e-3)


def test_a_file_predicts_as_the_session_did(found: Identification, tmp_path) -> None:
    found.save(tmp_path / "found.json")

    def loaded(experiments: Experiments | None) -> Identification:
        return aleator.load(
            tmp_path / "found.json", simulator=line, vectorized=True, inputs=PAIR,
            noise=Noise(Free(0.01, 5.0)), experiments=experiments,
        )  # fmt: skip

    for of in (None, "e2"):
        pd.testing.assert_frame_equal(
            loaded(TABLE).predict(NEW, of=of), found.predict(NEW, of=of), atol=1e-4
        )
    without = loaded(None)
    pd.testing.assert_frame_equal(without.predict(NEW), found.predict(NEW).drop(columns="beyond"))
    assert without.law.marginals["a"].mean == pytest.approx(found.law.marginals["a"].mean)
    with pytest.raises(AleatorError, match="experiments"):
        without.predict(NEW, of="e2")
    with pytest.raises(AleatorError, match="noise"):
        aleator.load(tmp_path / "found.json", inputs=PAIR)


def test_slow_simulators_predict_on_surfaces(found: Identification) -> None:
    slow = replace(found, session=replace(found.session, on_simulator=False, fit=None))
    for of in (None, "e2"):
        fast = found.predict(NEW, of=of)
        assert slow.predict(NEW, of=of)["mean"].tolist() == pytest.approx([*fast["mean"]], abs=1e-3)


def test_the_log_likelihood_can_be_asked_elsewhere(found: Identification) -> None:
    moved = {**found.values, "a.sd": 0.4, "noise.sd": 0.3}
    exact = 0.0
    other = replace(found, alpha={k: replace(found.alpha[k], estimate=v) for k, v in moved.items()})
    for experiment in FRAME["id"].unique():
        y = FRAME.loc[FRAME["id"] == experiment, "y"]
        exact += stats.multivariate_normal.logpdf(y, *marginal(other, experiment))
    assert found.log_likelihood_at(moved) == pytest.approx(exact, abs=1e-6)
    assert found.log_likelihood_at({}) == pytest.approx(found.log_likelihood.estimated)


def test_individual_parameters_are_best_linear_predictors(found: Identification) -> None:
    table = found.individuals
    for experiment in ("e0", "e5"):
        mean, covariance = individual_law(found, experiment)
        assert table.loc[experiment, ["a.mean", "b.mean"]].to_numpy() == pytest.approx(mean)
        sds = table.loc[experiment, ["a.sd", "b.sd"]].to_numpy(float)
        assert sds == pytest.approx(np.sqrt(np.diag(covariance)))
        ends = stats.norm.interval(0.95, mean, np.sqrt(np.diag(covariance)))
        told = table.loc[experiment, ["a.lower", "b.lower", "a.upper", "b.upper"]].to_numpy(float)
        assert told == pytest.approx(np.concatenate(ends), rel=1e-4)
    assert len(found.residuals) == len(FRAME)
    assert set(found.residuals["time"]) == set(FRAME["time"])


def test_residuals_are_over_the_noise(found: Identification) -> None:
    for seen in found.observations:
        assert seen.scale == pytest.approx(found.values["noise.sd"])
        assert seen.residual == pytest.approx((seen.lower - seen.predicted) / seen.scale)
        row = FRAME.iloc[seen.row - 1]
        assert (row["id"], row["y"]) == (seen.id, seen.lower)
        assert seen.conditions == {"time": row["time"]}


def test_all_of_it_comes_back_from_a_file(found: Identification, tmp_path) -> None:
    found.save(tmp_path / "found.json")
    again = aleator.load(tmp_path / "found.json")
    assert again == found
    assert to_json(again.to_dict()) == to_json(found.to_dict())


# ----------------------------------------------------------------------- outcomes that are infinite

NOISE = 0.05
SD = 1.0
X = stats.norm.ppf((np.arange(12) + 0.5) / 12, 0.2, SD)
LIVES_FRAME = pd.DataFrame(
    {"life": np.where(X < 0.5, X, 2.0), "end": np.where(X < 0.5, "", "never")}
)
LIVES = Experiments.from_frame(
    LIVES_FRAME, outcome="life", conditions=[], censored=Censoring("end", right="never")
)
INPUTS = Inputs({"x": Normal(Free(-2.0, 2.0), SD)})


def life(x):
    return np.where(x < 0.5, x, np.inf)


@pytest.fixture(scope="module")
def endless() -> Identification:
    return unjudged(
        life, LIVES, INPUTS, vectorized=True, noise=Noise(NOISE), verification=Check(64)
    )


def test_a_prediction_is_infinite_where_the_law_is(endless: Identification) -> None:
    """Of the lives that end those below y are Phi((y - mean)/sd) of all, but for the noise."""
    mean = endless.values["x.mean"]
    ends = stats.norm.cdf(0.5, mean, SD)
    told = endless.predict(
        pd.DataFrame({"row": [1]}), noise=False, uncertainty=False, quantiles=PROBABILITIES
    ).iloc[0]
    assert told["status"] == "solved"
    assert told["mean"] == np.inf
    assert np.isnan(told["standard_deviation"])
    for p in (0.025, 0.25, 0.5):
        assert told[f"q{p}"] == pytest.approx(stats.norm.ppf(p, mean, SD), abs=2e-3)
    assert 0.5 < ends < 0.75
    assert told["q0.75"] == told["q0.975"] == np.inf


def test_an_infinite_prediction_comes_back_from_a_file(endless: Identification, tmp_path) -> None:
    endless.save(tmp_path / "found.json")
    again = aleator.load(tmp_path / "found.json")
    predicted = np.array([o.predicted for o in endless.observations])
    np.testing.assert_array_equal(np.isposinf(predicted), X >= 0.5)
    np.testing.assert_array_equal([o.predicted for o in again.observations], predicted)


# ---------------------------------------------------- figures that are printed twice are one figure

RNG = np.random.default_rng(2028)


def single(count: int) -> pd.DataFrame:
    load = np.linspace(0.5, 2.0, count)
    return pd.DataFrame({"load": load, "y": load * np.exp(0.3 * RNG.normal(size=count))})


ONE, FEW = single(12), single(4)
REPEATED = pd.DataFrame(
    [(k, t, np.exp(z) * t + e) for k, z in enumerate(0.3 * RNG.normal(size=9))
     for t, e in zip((0.5, 1.0, 2.0), 0.1 * RNG.normal(size=3), strict=True)],
    columns=["id", "load", "y"],
)  # fmt: skip


def smooth(load: Array, x: Array) -> Array:
    return load * np.exp(x)


def jump(load: Array, x: Array) -> Array:
    return load * np.exp(x) + 0.5 * (x > 0.1)


def law_of_x(prior: Normal | None = None) -> Inputs:
    return Inputs({"x": Normal(Free(-1.0, 1.0, prior=prior), Free(0.02, 1.0))})


WITH_NOISE = {"noise": Noise(0.1)}
SMALL = {"noise": Noise(0.03)}
WAYS = [
    (smooth, ONE, law_of_x(), {}, "level sets"),
    (jump, ONE, law_of_x(), {}, "level sets"),
    (smooth, ONE, law_of_x(), {"density": MaximumEntropy(4)}, "maximum entropy, 4 moments"),
    (smooth, ONE, law_of_x(), {"density": MaximumEntropy(6)}, "maximum entropy, 6 moments"),
    (smooth, ONE, law_of_x(), {"propagation": Collocation()}, "maximum entropy, 4 moments"),
    (smooth, ONE, law_of_x(), WITH_NOISE, "Gauss-Hermite, 9 nodes"),
    (smooth, REPEATED, law_of_x(), WITH_NOISE, "Gauss-Hermite, 9 nodes"),
    (jump, FEW, law_of_x(), SMALL, "panels"),
]  # fmt: skip


@pytest.mark.parametrize(("simulator", "table", "inputs", "choices", "name"), WAYS)
def test_the_rows_of_every_way_sum_to_its_total_under_its_name(
    simulator: Callable[..., Array],
    table: pd.DataFrame,
    inputs: Inputs,
    choices: dict[str, Any],
    name: str,
) -> None:
    found = identified(simulator, table, inputs, **choices)
    total = found.log_likelihood.estimated
    assert sum(e.log_density for e in found.experiments) == pytest.approx(total, rel=1e-9)
    assert found.log_likelihood_at({}) == pytest.approx(total, rel=1e-9)
    assert found.density == name or found.density.startswith(f"{name}, ")
    assert_written(found)


def assert_written(found: Identification) -> None:
    """Every writer says by what the total was made, beside the total."""
    document = found.to_dict()
    assert document["density"] == found.density
    for text in (repr(found), fragment(answer(document)), terminal(document)):
        words = " ".join(text.split())
        before = words.index(f"{found.log_likelihood.estimated:.3f}")
        assert f"by {found.density}" in words[before:]


def terminal(document: dict[str, Any]) -> str:
    console = Console(file=io.StringIO(), width=300)
    console.print(render(document))
    return console.file.getvalue()


def test_rows_and_prior_are_what_was_maximized() -> None:
    found = identified(smooth, ONE, law_of_x(prior=Normal(0.0, 0.1)))
    rows, prior = sum(e.log_density for e in found.experiments), found.log_likelihood.log_prior
    assert rows == pytest.approx(found.log_likelihood.estimated, rel=1e-9)
    assert rows + prior == pytest.approx(found.search["optima"][0]["log_likelihood"], rel=1e-9)


def identified(
    simulator: Callable[..., Array], table: pd.DataFrame, inputs: Inputs, **choices: Any
) -> Identification:
    return unjudged(
        simulator, table, inputs, outcome="y", vectorized=True, verification=Check(0),
        **choices,
    )  # fmt: skip


SHORT = pd.DataFrame({"load": np.ones(4), "y": [0.8, 1.1, 1.3, 0.9]})
"""So few that profiles bend, and a standard deviation may be anything up to its limit."""


@pytest.mark.parametrize(
    ("choices", "table"), [({}, SHORT), (WITH_NOISE, SHORT), (WITH_NOISE, REPEATED)]
)
def test_the_chart_of_a_profile_has_the_interval_of_the_table(
    choices: dict[str, Any], table: pd.DataFrame
) -> None:
    found = pictured(identified(smooth, table, law_of_x(), **choices))
    for name, curve in found.pictures["profiles"].items():
        entry = found.alpha[name]
        at, below = (np.array(curve[key], float) for key in ("at", "below"))
        line = np.interp(entry.interval, *profile_line(at, below))
        assert at[0] <= entry.interval[0] < entry.interval[1] <= at[-1]
        assert np.interp(entry.interval, at, below) == pytest.approx(entry.drops, rel=1e-4)
        assert -line == pytest.approx(entry.drops, rel=1e-3)
        assert below[at == entry.estimate] == pytest.approx(0.0) or entry.at_bound
        verticals = [
            line.get_xdata()[0] for line in plot.profile(found, name).lines
            if len({*line.get_xdata()}) == 1 and line.get_linestyle() == "--"
        ]  # fmt: skip
        assert verticals == pytest.approx(entry.interval)
        plt.close("all")


# ------------------------------------------------------------------------------ notebooks


def test_each_result_has_a_small_table_with_its_numbers() -> None:
    found = found_with()
    inputs = aleator.Inputs({"x": aleator.Normal(aleator.Free(-3.0, 3.0), 0.4)})
    table = pd.DataFrame({"load": [1.0, 2.0]})
    results = {
        "bca_lower": aleator.bootstrap(found, replicates=20),
        "elpd": aleator.compare(found, found),
        "probability": aleator.ceiling(found, replicates=0),
        "standard error": aleator.next_experiments(found, asked(), count=2),
        "mean_total": aleator.screen(springs, table, inputs, vectorized=True),
    }
    for word, result in results.items():
        text = result._repr_html_()  # type: ignore[attr-defined]
        assert "<table" in text
        assert word in text
        assert len(text) < 20_000
