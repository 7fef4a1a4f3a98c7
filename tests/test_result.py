"""What a user holds: the identification by name, its law, and what can be asked of it again."""

import io
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rich.console import Console
from scipy import stats

import aleator
from aleator import Check, Constant, Free, Identification, Inputs, Noise, Normal, Uniform
from aleator.errors import AleatorError, InputsError
from aleator.results.documents import to_json
from aleator.results.law import JointLaw
from aleator.results.values import OutcomeAnswer
from aleator.views.identification import render

LOAD = np.arange(1.0, 13.0)
MEASURED = LOAD * np.array([1.1, 0.9, 1.2, 0.95, 1.0, 1.05, 0.8, 1.15, 0.92, 1.3, 1.02, 0.98])
TABLE = pd.DataFrame({"load": LOAD, "length": MEASURED})
INPUTS = Inputs({"softness": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))})


def spring(load: float, softness: float) -> float:
    return load * softness


@pytest.fixture(scope="module")
def found() -> Identification:
    """y = load x with x ~ N(mean, sd^2): maximum likelihood is the mean and sd of y/load."""
    return aleator.identify(
        spring, TABLE, INPUTS, outcome="length", vectorized=False, verification=Check(200)
    )


def test_a_file_with_the_keys_of_an_earlier_version_is_the_same_result(
    found: Identification, tmp_path: Path
) -> None:
    document = found.to_dict()
    likelihood = {**document["log_likelihood"], "reached": {"experiments": 11, "verified": 1.0}}
    experiments = [{**one, "verified": True} for one in document["experiments"]]
    older = {**document, "log_likelihood": likelihood, "experiments": experiments}
    path = tmp_path / "identification.json"
    path.write_text(to_json(older))
    assert aleator.load(path) == found


RATIO = MEASURED / LOAD
MEAN, SD = float(RATIO.mean()), float(RATIO.std())


def log_likelihood(mean: float, sd: float) -> float:
    return float(stats.norm.logpdf(MEASURED, LOAD * mean, LOAD * sd).sum())


def test_values_errors_and_covariance_are_those_of_a_normal_sample(found: Identification) -> None:
    names = ["softness.mean", "softness.sd"]
    assert found.values.index.tolist() == names
    assert found.values.to_numpy() == pytest.approx([MEAN, SD], rel=1e-3)
    exact = [SD / math.sqrt(12), SD / math.sqrt(24)]
    assert found.errors.to_numpy() == pytest.approx(exact, rel=5e-3)
    assert found.covariance.index.tolist() == found.covariance.columns.tolist() == names
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(found.errors.to_numpy())
    assert abs(found.covariance.loc["softness.mean", "softness.sd"]) < 1e-2 * exact[0] * exact[1]


def test_intervals_are_where_the_likelihood_has_dropped(found: Identification) -> None:
    # the profile of the mean is N/2 log(1 + (m - mean)^2/sd^2) below the maximum
    drop = stats.chi2.ppf(0.95, 1) / 2.0
    half = SD * math.sqrt(math.expm1(2.0 * drop / 12.0))
    assert found.intervals.columns.tolist() == ["lower", "upper"]
    ends = found.intervals.loc["softness.mean"].to_numpy()
    assert ends == pytest.approx([MEAN - half, MEAN + half], rel=2e-3)


def test_the_law_is_the_identified_normal_law(found: Identification) -> None:
    mean, sd = found.values
    x = np.linspace(0.7, 1.3, 7)
    assert found.law.pdf({"softness": x}) == pytest.approx(stats.norm.pdf(x, mean, sd))
    assert found.law.cdf({"softness": x}) == pytest.approx(stats.norm.cdf(x, mean, sd))
    marginal = found.law.marginals["softness"]
    assert (marginal.mean, marginal.sd) == pytest.approx((mean, sd))
    assert marginal.quantile(marginal.cdf(x)) == pytest.approx(x)
    draws = found.law.sample(4000, seed=3)
    assert draws.equals(found.law.sample(4000, seed=3))
    assert stats.kstest(draws["softness"], stats.norm(mean, sd).cdf).pvalue > 0.01


def test_predictions_need_nothing_again(found: Identification) -> None:
    new = pd.DataFrame({"load": [10.0, 20.0]})
    table = found.predict(new, quantiles=(0.1, 0.9), uncertainty=False)
    mean, sd = found.values
    assert table["mean"].to_numpy() == pytest.approx([10 * mean, 20 * mean])
    assert table["standard_deviation"].to_numpy() == pytest.approx([10 * sd, 20 * sd], rel=1e-3)
    assert table["q0.9"].to_numpy() == pytest.approx(
        stats.norm.ppf(0.9, [10 * mean, 20 * mean], [10 * sd, 20 * sd]), rel=1e-3
    )


def test_the_log_likelihood_can_be_asked_anywhere_near(found: Identification) -> None:
    at = {"softness.mean": 1.05, "softness.sd": 0.15}
    assert found.log_likelihood_at(at) == pytest.approx(log_likelihood(1.05, 0.15), abs=2e-3)
    assert found.log_likelihood_at([1.05, 0.15]) == found.log_likelihood_at(at)
    assert found.log_likelihood_at(found.values) == found.log_likelihood.estimated
    moved = found.log_likelihood_at({"softness.mean": 1.05})
    assert moved == found.log_likelihood_at([1.05, found.values["softness.sd"]])


@pytest.mark.parametrize(
    ("alpha", "named"),
    [
        ({"softness.mena": 1.0}, "softness.mena"),
        ({"softness.sd": -1.0}, "softness.sd"),
        ({"softness.sd": math.nan}, "softness.sd"),
        ([1.0], "(1,)"),
    ],
)
def test_an_alpha_that_is_none_is_told(found: Identification, alpha: Any, named: str) -> None:
    with pytest.raises(InputsError) as caught:
        found.log_likelihood_at(alpha)
    assert named in caught.value.problem


def test_a_file_alone_says_what_it_lacks(found: Identification, tmp_path: Path) -> None:
    path = tmp_path / "found.json"
    found.save(path)
    bare = aleator.load(path)
    questions = (
        lambda: bare.law,
        lambda: bare.predict(TABLE),
        lambda: bare.log_likelihood_at(bare.values),
    )
    for question in questions:
        with pytest.raises(AleatorError) as caught:
            question()
        assert caught.value.remedy


def test_what_is_given_again_works_again(found: Identification, tmp_path: Path) -> None:
    path = tmp_path / "found.json"
    found.save(path)
    again = aleator.load(path, simulator=spring, inputs=INPUTS)
    new = pd.DataFrame({"load": [10.0]})
    assert again.predict(new)["mean"].tolist() == pytest.approx(found.predict(new)["mean"].tolist())
    assert again.law.pdf({"softness": 1.0}) == found.law.pdf({"softness": 1.0})
    with pytest.raises(InputsError, match="without noise"):
        aleator.load(path, inputs=INPUTS, noise=Noise(0.1))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("alpha", {"x": {"estimate": None}}),
        ("alpha", {"x": {"estimate": 10**400}}),
        ("experiments", [{"id": "1"}]),
        ("correlation", []),
        ("runs", "many"),
        ("runs", 10**400),
        ("correlation", {"names": ["x.mean"], "matrix": [[1.0, 0.5]]}),
        ("search", {"optima": [1]}),
        ("seconds", {"total": "1"}),
        ("quadrature", {"nodes": 3}),
        ("warnings", [1]),
    ],
)
def test_an_entry_that_was_changed_is_named(
    found: Identification, tmp_path: Path, key: str, value: Any
) -> None:
    path = tmp_path / "changed.json"
    path.write_text(json.dumps({**json.loads(to_json(found.to_dict())), key: value}))
    with pytest.raises(AleatorError) as caught:
        aleator.load(path)
    assert str(path) in caught.value.problem
    assert f"'{key}'" in caught.value.problem


def test_whatever_a_file_holds_is_told_or_can_be_printed(
    found: Identification, tmp_path: Path
) -> None:
    """Each entry of the file is left out, or becomes something else."""
    answer = OutcomeAnswer("length", {"load": 3.0}, True, "length > 3", probability=0.5)
    whole = json.loads(to_json(replace(found, answers=(answer,)).to_dict()))
    refused = printed = 0
    for *above, last in _entries(whole):
        for value in (None, 10**400, {"a": 1}):
            document = json.loads(json.dumps(whole))
            at = document
            for name in above:
                at = at[name]
            at[last] = value
            path = tmp_path / "changed.json"
            path.write_text(json.dumps(document))
            try:
                again = aleator.load(path)
            except AleatorError:
                refused += 1
                continue
            assert repr(again)
            assert Console(file=io.StringIO()).print(render(again.to_dict(), (), True)) is None
            printed += 1
    assert refused > printed > 0


def _entries(part: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The places of a document, of each list only the first two."""
    inside = part.items() if isinstance(part, dict) else enumerate(part[:2])
    places: list[tuple[Any, ...]] = []
    for name, value in inside if isinstance(part, (dict, list)) else ():
        places.append((*above, name))
        if isinstance(value, (dict, list)):
            places += _entries(value, (*above, name))
    return places


# ------------------------------------------------------------------------------- the joint law


def pair(rho: float) -> JointLaw:
    inputs = Inputs(
        {"a": Normal(1.0, 2.0), "b": Constant(3.0), "c": Normal(0.0, 0.5)}, {("a", "c"): rho}
    )
    return JointLaw(inputs, np.array([1.0, 2.0, 3.0, 0.0, 0.5, rho]))


def test_a_correlated_pair_is_the_bivariate_normal_law() -> None:
    covariance = [[4.0, 0.6], [0.6, 0.25]]
    exact = stats.multivariate_normal([1.0, 0.0], covariance)
    points = exact.rvs(20, random_state=1)
    at = {"a": points[:, 0], "c": points[:, 1]}
    assert pair(0.6).pdf(at) == pytest.approx(exact.pdf(points))
    assert pair(0.6).cdf(at) == pytest.approx(exact.cdf(points), abs=1e-8)
    draws = pair(0.6).sample(20_000, seed=1)
    assert np.cov(draws[["a", "c"]].T).ravel() == pytest.approx(np.ravel(covariance), rel=0.05)
    assert draws["b"].unique().tolist() == [3.0]


def test_points_of_the_law_are_columns_or_an_array_in_the_order_of_the_parameters() -> None:
    inputs = Inputs({"a": Normal(1.0, 2.0), "b": Normal(0.0, 3.0)})
    law = JointLaw(inputs, np.array([1.0, 2.0, 0.0, 3.0]))
    at = np.array([[0.5, 1.0], [2.0, 3.0], [1.0, -1.0]])
    np.testing.assert_array_equal(law.pdf(at), law.pdf({"a": at[:, 0], "b": at[:, 1]}))
    assert law.cdf(at[0]).shape == ()
    with pytest.raises(InputsError, match="a, b"):
        law.pdf(at[:, :1])


def test_uniform_laws_tied_by_a_copula_stay_uniform_and_integrate_to_one() -> None:
    inputs = Inputs(
        {"u": Uniform.between(0.0, 1.0), "v": Uniform.between(0.0, 1.0)}, {("u", "v"): 0.5}
    )
    law = JointLaw(inputs, np.array([h.start for h in inputs.hyperparameters]))
    grid = (np.arange(400) + 0.5) / 400
    u, v = np.meshgrid(grid, grid)
    density = law.pdf({"u": u, "v": v})
    assert density.shape == (400, 400)
    assert density.mean() == pytest.approx(1.0, abs=2e-3)
    assert law.cdf({"u": grid, "v": 2.0}) == pytest.approx(grid)
    assert law.cdf({"u": -0.5, "v": 0.5}) == 0.0
    assert law.pdf({"u": -0.5, "v": 0.5}) == 0.0


def test_three_correlated_parameters_have_the_orthant_probability() -> None:
    laws = {name: Normal(0.0, 1.0) for name in "abc"}
    inputs = Inputs(laws, {("a", "b"): 0.5, ("a", "c"): 0.5})
    law = JointLaw(inputs, np.array([h.start for h in inputs.hyperparameters]))
    # 1/8 + (asin r12 + asin r13 + asin r23)/(4 pi), r23 = r12 r13
    exact = 0.125 + (2.0 * math.asin(0.5) + math.asin(0.25)) / (4.0 * math.pi)
    at = {"a": 0.0, "b": 0.0, "c": 0.0}
    assert law.cdf(at) == pytest.approx(exact, abs=1e-5)
    assert law.cdf(at) == law.cdf(at)


def test_a_constant_takes_one_value() -> None:
    law = pair(0.0)
    at = {"a": 1.0, "c": 0.0}
    assert law.pdf({**at, "b": 3.0}) == law.pdf(at) > 0.0
    assert law.pdf({**at, "b": 2.9}) == 0.0
    assert [law.cdf({**at, "b": b}) for b in (2.9, 3.0, 3.1)] == pytest.approx([0.0, 0.25, 0.25])
    assert law.marginals["b"].cdf([2.9, 3.0]).tolist() == [0.0, 1.0]
    assert (law.marginals["b"].mean, law.marginals["b"].sd) == (3.0, 0.0)
