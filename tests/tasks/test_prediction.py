"""Predictions for conditions that were never tested, against closed forms."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from problems import BINDING, GROWTH, NOISY, PRODUCT, REGRESSION, Problem, title
from scipy import optimize, stats

from aleator import (
    By,
    Check,
    Constant,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    MaximumEntropy,
    Noise,
    Normal,
    StudentError,
)
from aleator.errors import InputsError
from aleator.results import documents
from aleator.results.values import PlausibleLaws
from aleator.tasks.predict import predict

QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
COLUMNS = [f"q{p:g}" for p in QUANTILES]


def predicted(problem: Problem, **more) -> pd.DataFrame:
    alpha = {h.name: v for h, v in zip(problem.hyperparameters, problem.alpha, strict=True)}
    return predict(
        problem.simulator,
        pd.DataFrame({"z": problem.z}),
        problem.inputs,
        alpha,
        vectorized=True,
        noise=problem.noise,
        quantiles=QUANTILES,
        **({} if problem.noise else {"density": MaximumEntropy(4)}) | more,
    )


def test_a_linear_prediction_is_its_normal_law() -> None:
    table = predicted(REGRESSION)
    m, s, b, t = REGRESSION.alpha
    mean, sd = m + b * REGRESSION.z, np.hypot(s, t * REGRESSION.z)
    np.testing.assert_allclose(table["mean"], mean, atol=1e-9)
    np.testing.assert_allclose(table["standard_deviation"], sd, rtol=1e-9)
    np.testing.assert_allclose(table["skewness"], 0.0, atol=1e-8)
    np.testing.assert_allclose(table["kurtosis"], 3.0, atol=1e-6)
    for p, column in zip(QUANTILES, COLUMNS, strict=True):
        np.testing.assert_allclose(table[column], stats.norm.ppf(p, mean, sd), atol=1e-5)
    assert set(table["status"]) == {"solved"}
    assert table["z"].tolist() == REGRESSION.z.tolist()


@pytest.mark.parametrize("problem", [GROWTH, BINDING, PRODUCT], ids=title)
def test_predicted_moments_are_the_exact_ones(problem) -> None:
    table = predicted(problem)
    mean, sd, standardized = problem.exact_moments(4)
    # the surface's tolerance is 2 % of the scatter on a region several times as wide as the law
    np.testing.assert_allclose(table["mean"], mean, atol=0.01 * sd.min())
    np.testing.assert_allclose(table["standard_deviation"], sd, rtol=0.01)
    np.testing.assert_allclose(table["skewness"], standardized[:, 3], atol=0.03)
    np.testing.assert_allclose(table["kurtosis"], standardized[:, 4], rtol=0.03)


def test_predicted_quantiles_of_a_bounded_law_are_the_exact_ones() -> None:
    """z times the quantiles of the truncated normal law: the density is exact here."""
    table = predicted(BINDING)
    mean, sd = BINDING.alpha
    law = stats.truncnorm((0.0 - mean) / sd, (1.0 - mean) / sd, mean, sd)
    for p, column in zip(QUANTILES, COLUMNS, strict=True):
        np.testing.assert_allclose(table[column], BINDING.z * law.ppf(p), rtol=1e-3)


def test_noise_without_further_choices_goes_by_the_law_of_the_parameters() -> None:
    """The same moments, and quantiles of z x + e with x truncated normal, by a fine sum."""
    table = predicted(NOISY)
    mean, sd, clean = NOISY.exact_moments(4)
    total = np.hypot(sd, NOISY.noise_sd)
    share = sd / total
    kurtosis = 3.0 + (clean[:, 4] - 3.0) * share**4
    np.testing.assert_allclose(table["mean"], mean, atol=1e-3 * sd.min())
    np.testing.assert_allclose(table["standard_deviation"], total, rtol=1e-3)
    np.testing.assert_allclose(table["skewness"], clean[:, 3] * share**3, atol=0.01)
    np.testing.assert_allclose(table["kurtosis"], kurtosis, atol=0.02)
    p = np.array([float(column[1:]) for column in COLUMNS])
    found = table[COLUMNS].to_numpy()
    grid = np.linspace(-2.0, 4.0, 60_001)
    for z, own in zip(NOISY.z, found, strict=True):
        below = np.cumsum(np.exp(NOISY.log_density(NOISY.alpha, z, grid))) * (grid[1] - grid[0])
        assert np.abs(np.interp(p, below, grid) - own).max() < 2e-3 * total.min()


def test_series_of_new_experiments_are_predicted_from_a_law_that_is_given() -> None:
    """y = a + b t of two responses, errors of Student's t in one: sums of variances."""
    new = pd.DataFrame({"id": ["p", "p", "q"], "t": [0.0, 1.0, 2.0]})
    law = Inputs({"a": Normal(1.0, 0.3), "b": Normal(0.5, 0.4)})
    noise = {"y": Noise(0.2), "u": Noise(0.1, kind=StudentError(5))}
    alpha = {"a.mean": 1.0, "a.sd": 0.3, "b.mean": 0.5, "b.sd": 0.4}
    alpha |= {"noise.y.sd": 0.2, "noise.u.sd": 0.1}
    table = predict(lambda t, a, b: {"y": a + b * t, "u": a - b * t}, new, law, alpha, noise=noise)
    assert table["id"].tolist() == ["p"] * 4 + ["q"] * 2
    assert table["t"].tolist() == [0.0, 0.0, 1.0, 1.0, 2.0, 2.0]
    assert table["outcome"].tolist() == ["y", "u"] * 3
    t = np.repeat(new["t"].to_numpy(), 2)
    sign = np.where(table["outcome"] == "y", 1.0, -1.0)
    error = np.where(table["outcome"] == "y", 0.04, 0.01 * 5.0 / 3.0)
    np.testing.assert_allclose(table["mean"], 1.0 + sign * 0.5 * t, atol=2e-3)
    variance = 0.09 + 0.16 * t**2 + error
    np.testing.assert_allclose(table["standard_deviation"], np.sqrt(variance), rtol=5e-3)


def test_a_law_that_follows_covariates_is_predicted_by_its_identification() -> None:
    law = Inputs({"a": Normal(By("1 + t", 0.0, 9.0), 0.3)})
    with pytest.raises(InputsError, match="follows t") as caught:
        predict(lambda t, a: a + t, pd.DataFrame({"t": [0.0]}), law, {}, noise=Noise(0.1))
    assert "found.predict" in caught.value.remedy


@pytest.mark.parametrize(
    ("change", "named"), [({"x.sd": None}, "x.sd"), ({"x.men": 1.0}, "did you mean 'x.mean'")]
)
def test_alpha_must_fit_the_model(change, named) -> None:
    alpha = {"x.mean": 0.3, "x.sd": 0.2, **change}
    alpha = {name: value for name, value in alpha.items() if value is not None}
    with pytest.raises(InputsError, match=named) as caught:
        predict(GROWTH.simulator, pd.DataFrame({"z": [1.0]}), GROWTH.inputs, alpha, vectorized=True)
    assert caught.value.remedy


@pytest.mark.parametrize("wrong", [np.inf, np.nan, 1e300, -0.1, 20.0])
def test_a_law_beyond_its_limits_is_refused(wrong: float) -> None:
    """Surfaces and nodes stand for what lies within them: 20 would be told as some 8."""
    law = Inputs({"x": Normal(1.0, Free(0.01, 0.5))})
    new = pd.DataFrame({"load": [10.0]})
    for alpha in (
        {"x.mean": 1.0, "x.sd": wrong, "noise.sd": 0.1},
        {"x.mean": 1.0, "x.sd": 0.1, "noise.sd": wrong},
        {"x.mean": wrong, "x.sd": 0.1, "noise.sd": 0.1},
    ):
        with pytest.raises(InputsError, match=r"outside its limits|the law says 1"):
            predict(lambda load, x: load * x, new, law, alpha, noise=Noise(Free(0.01, 0.5)))


# -------------------------------------------------------------------- with the uncertainty of alpha

N = 12
LOAD = np.linspace(1.0, 3.0, N)
SCORES = stats.norm.ppf((np.arange(N) + 0.5) / N)[np.random.default_rng(3).permutation(N)]
TABLE = pd.DataFrame({"load": LOAD, "y": LOAD * (1.0 + 0.1 * SCORES)})
NEW = pd.DataFrame({"load": [2.0, 10.0]})
ENDS = (0.025, 0.5, 0.975)


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
    exact = x.mean() + stats.t.ppf(ENDS, N - 1) * x.std() * np.sqrt(1.0 + 1.0 / N)
    told = found.predict(NEW, uncertainty=found.draws(1024, by_likelihood=True))
    for row, load in enumerate(NEW["load"]):
        quantiles = told.loc[row, [f"q{p:g}" for p in ENDS]].to_numpy(float)
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
    for table in (found.predict(NEW), found.probability("y > 3", NEW, uncertainty=False)):
        assert table["beyond"].tolist() == pytest.approx([0.0, 3.5])
        (told,) = table.attrs["beyond"].values()
        assert "load is 3.5" in told


def test_conditions_are_given_by_name_by_a_table_or_not_at_all(found: Identification) -> None:
    table = found.predict(NEW)
    assert [*table.columns[:3]] == ["load", "outcome", "mean"]
    assert table["outcome"].tolist() == ["y", "y"]
    pd.testing.assert_frame_equal(found.predict({"load": [2.0, 10.0]}), table)
    pd.testing.assert_frame_equal(found.predict({"load": 2.0}), table[:1])
    pd.testing.assert_frame_equal(found.predict(NEW.assign(y=np.nan, note="a")), table)
    whole = found.predict(uncertainty=False)
    assert whole["load"].tolist() == TABLE["load"].tolist()
    assert whole["mean"].to_numpy() == pytest.approx(LOAD * found.values["x.mean"])


def test_tables_have_the_units_of_the_user(found: Identification) -> None:
    shown = replace(found, units={"load": "N", "y": "mm", "x": "mm/N"})
    known = {"load": "N", "y": "mm"}
    for table in (
        shown.predict(NEW, uncertainty=False),
        shown.probability("y > 2 mm", at=NEW, uncertainty=False),
        shown.tolerance(at=NEW),
    ):
        assert table.attrs["units"] == known
        assert [*table.columns[:2]] == ["load", "outcome"]
    with pytest.raises(InputsError, match="the unit of y is mm"):
        shown.probability("y > 2 cm", at=NEW)


def test_the_probability_of_an_event_and_its_contrary_add_up(found: Identification) -> None:
    """Under the estimate it is that of the normal law of the sample."""
    mean, sd = found.values["x.mean"], found.values["x.sd"]
    at = {"load": 2.0}
    for low, high in ((-np.inf, 1.9), (1.9, 2.1), (2.1, np.inf)):
        sentence = f"{low} < y < {high}".replace("-inf < ", "").replace(" < inf", "")
        told = found.probability(sentence, at, uncertainty=False)["probability"][0]
        exact = np.diff(stats.norm.cdf(np.array([low, high]) / 2.0, mean, sd))[0]
        assert told == pytest.approx(exact, abs=3e-3)


def test_a_condition_may_have_the_name_of_a_column_of_the_table() -> None:
    table = predict(lambda mean, x: mean * x, {"mean": 2.0}, {"x": Normal(1.0, 0.1)},
                    {"x.mean": 1.0, "x.sd": 0.1})  # fmt: skip
    assert table["mean (condition)"].tolist() == [2.0]
    assert table["mean"].to_numpy() == pytest.approx([2.0])


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


def test_a_ridge_of_which_only_the_product_is_seen_leaves_predictions_exact() -> None:
    """y = a b of a normal a and a constant b: a normal sample, whatever a and b are (synthetic).

    P(y > t) has an interval by the noncentral t law, as has the upper tolerance limit. Normal draws
    of the hyperparameters leave the ridge: 0.000 to 0.067 for 0.007 to 0.106, and 2.64 for 2.80.
    """
    size, t = 30, 2.7
    y = 2.0 + 0.5 * np.random.default_rng(0).standard_normal(size)
    found = unjudged(
        lambda z, a, b: z * a * b, pd.DataFrame({"z": np.ones(size), "y": y}),
        Inputs({"a": Normal(Free(0.2, 8.0), Free(0.02, 4.0)), "b": Constant(Free(0.25, 4.0))}),
        outcome="y", vectorized=True, noise=Noise(0.05), verification=Check(0),
    )  # fmt: skip
    mean, sd, root = y.mean(), y.std(ddof=1), np.sqrt(size)

    def excess(p: float, level: float) -> float:
        k = (t - mean) / sd * root
        return stats.nct.cdf(k, size - 1, stats.norm.isf(p) * root) - level

    exact = [optimize.brentq(excess, 1e-5, 0.6, (level,)) for level in (0.025, 0.975)]
    told = found.probability(f"y > {t}", {"z": [1.0]})
    assert told[["lower", "upper"]].to_numpy()[0] == pytest.approx(exact, abs=0.02)
    assert told["lower"][0] > 0.002
    limit = mean + sd / root * stats.nct.ppf(0.9, size - 1, stats.norm.ppf(0.95) * root)
    design = found.tolerance(0.95, 0.9, {"z": [1.0]}, side="upper")
    assert design["upper"][0] == pytest.approx(limit, abs=0.08)
    assert found.plausible.status == "by_likelihood"
    assert told.attrs["plausible"]["agreement"] < 0.4
    again = Identification.from_document(json.loads(documents.to_json(found.to_dict())))
    assert again.plausible == found.plausible
    # `load` takes the laws in any order.
    laws = Inputs(dict(reversed(found.session.inputs.laws.items())))
    other = replace(found, session=replace(found.session, inputs=laws))
    assert other.draws().names[0] == "b.value"
    assert other.draws().table().loc["a.mean"].equals(found.draws().table().loc["a.mean"])
    poor = replace(found, plausible=PlausibleLaws("poor", 0.05))
    for table in (poor.probability(f"y > {t}", {"z": [1.0]}), poor.predict({"z": [1.0]}),
                  poor.tolerance(0.95, 0.9, {"z": [1.0]})):  # fmt: skip
        assert table["status"].tolist() == ["poor_draws"]
    kept = poor.predict({"z": [1.0]}, uncertainty=False)
    assert kept["status"].tolist() == ["solved"]
