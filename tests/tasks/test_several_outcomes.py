"""Several exact outcomes an experiment: identifications against the closed form, and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats
from studies import run

import aleator
from aleator import (
    Collocation,
    Constant,
    Experiments,
    Free,
    Identification,
    Inputs,
    LogNormal,
    MaximumEntropy,
    Normal,
    ResponseSurface,
    identify,
)
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.inference.fit import stepped
from aleator.likelihood.level_sets import curves
from aleator.views.page import page

POSITIVE = LogNormal(Free(0.2, 5.0), Free(0.01, 3.0))
PAIR = Inputs({"a": POSITIVE, "b": POSITIVE}, {("a", "b"): Free(-0.9, 0.9)})
TURN = np.array([[1.0, 1.0], [1.0, -1.0]])


def drawn(count: int = 20) -> tuple[pd.DataFrame, Array]:
    """Outcomes c a b and a/b of correlated lognormal parameters, and the logarithms of these."""
    rng = np.random.default_rng(3)
    logs = rng.multivariate_normal([0.0, 0.3], [[0.09, 0.03], [0.03, 0.04]], count)
    a, b = np.exp(logs).T
    c = np.round(np.linspace(1.0, 2.0, count), 2)
    return pd.DataFrame({"c": c, "p": c * a * b, "q": a / b}), logs


def both(c: Array, a: Array, b: Array) -> dict[str, Array]:
    return {"p": c * a * b, "q": a / b}


def one_at_a_time(c: float, a: float, b: float) -> dict[str, float]:
    return {"p": float(c) * a * b, "q": a / b}


def table(frame: pd.DataFrame) -> Experiments:
    return Experiments.from_frame(frame, outcome=["p", "q"])


@pytest.fixture(scope="module")
def found() -> Identification:
    return identify(both, table(drawn()[0]), PAIR, vectorized=True, best_law=False)


def closed(frame: pd.DataFrame, logs: Array) -> tuple[Array, float]:
    """The maximum of a bivariate lognormal sample, and its log-likelihood for the outcomes."""
    mean, covariance = logs.mean(axis=0), np.cov(logs.T, bias=True)
    variance = np.diag(covariance)
    means = np.exp(mean + 0.5 * variance)
    sds = means * np.sqrt(np.expm1(variance))
    rho = covariance[0, 1] / np.sqrt(variance.prod())
    value = stats.multivariate_normal.logpdf(logs, mean, covariance).sum() - logs.sum()
    jacobian = np.log(2.0 * frame["c"] * np.exp(logs[:, 0] - logs[:, 1])).sum()
    return np.array([means[0], sds[0], means[1], sds[1], rho]), float(value - jacobian)


def test_the_maximum_is_that_of_a_lognormal_sample(found: Identification) -> None:
    alpha, value = closed(*drawn())
    np.testing.assert_allclose(found.values, alpha, atol=1e-3)
    assert found.log_likelihood.estimated == pytest.approx(value, abs=1e-5)
    assert found.log_likelihood.error == pytest.approx(0.0, abs=1e-5)
    assert found.sound
    assert found.consistent


def test_its_report_offers_no_ceiling(found: Identification) -> None:
    assert "aleator ceiling" not in page(found.to_dict())


def test_the_only_preimage_of_each_experiment_is_told(found: Identification) -> None:
    logs = drawn()[1]
    told = found.individuals[["a.mean", "b.mean"]].to_numpy()
    np.testing.assert_allclose(told, np.exp(logs), rtol=1e-6)
    assert [entry.response for entry in found.observations[:2]] == ["p", "q"]


def test_a_replicate_is_fitted_by_the_level_sets_of_one_law(
    found: Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    laid, traced = [], curves.traced

    def counted(*own: object) -> curves.SetPoints:
        laid.append(own)
        return traced(*own)  # type: ignore[arg-type]

    other = found.fit.for_replicates().drawn(np.random.default_rng(2))
    monkeypatch.setattr(curves, "traced", counted)
    fitted = stepped(stepped(other))
    assert fitted.scored().total > other.scored().total
    assert len(laid) == 1
    alone = other.likelihood.seeing(other.table.observations).at(fitted.alpha)
    assert alone.scored().total == pytest.approx(fitted.scored().total, abs=1e-8)


def test_predictions_are_those_of_the_law(found: Identification) -> None:
    told = found.predict(pd.DataFrame({"c": [1.5]}), quantiles=(0.5,), uncertainty=False)
    logs = drawn()[1]
    middle = TURN @ logs.mean(axis=0) + [np.log(1.5), 0.0]
    np.testing.assert_allclose(told["q0.5"], np.exp(middle), rtol=2e-3)


def test_an_answer_is_read_again(found: Identification, tmp_path: Path) -> None:
    found.save(tmp_path / "found.json")
    again = aleator.load(tmp_path / "found.json", simulator=both, inputs=PAIR, vectorized=True)
    new = pd.DataFrame({"c": [1.5]})
    one, other = (each.predict(new, uncertainty=False) for each in (found, again))
    np.testing.assert_allclose(one["mean"], other["mean"], rtol=1e-6)
    with pytest.raises(InputsError, match="without noise the parameters of an experiment"):
        found.predict(new, of="1")


@pytest.mark.long
def test_a_next_experiment_is_chosen(found: Identification) -> None:
    chosen = aleator.next_experiments(found, pd.DataFrame({"c": [1.0, 1.5]}), count=1)
    assert len(chosen.chosen) == 1
    assert np.all(np.isfinite(chosen.alone))


def test_outcomes_at_two_loads_and_a_constant() -> None:
    """Two rows an experiment, y = k + a + b t, with a constant k that is identified."""
    rng = np.random.default_rng(4)
    a, b = rng.normal(0.0, 0.3, 15), rng.normal(1.0, 0.2, 15)
    times = np.array([0.5, 2.0])
    y = 0.4 + a[:, None] + b[:, None] * times
    frame = pd.DataFrame(
        {"id": np.repeat(np.arange(15), 2), "t": np.tile(times, 15), "y": y.ravel()}
    )
    inputs = Inputs(
        {
            "a": Normal(0.0, Free(0.05, 2.0)),
            "b": Normal(Free(-1.0, 3.0), Free(0.05, 2.0)),
            "k": Constant(Free(-1.0, 1.0)),
        }
    )
    found = unjudged(
        lambda t, a, b, k: k + a + b * t, Experiments.from_frame(frame, outcome="y", id="id"),
        inputs, vectorized=True,
    )  # fmt: skip

    def value(alpha: Array) -> float:
        sd_a, mean, sd_b, k = alpha
        own = sd_a**2 + np.outer(times, times) * sd_b**2
        return float(stats.multivariate_normal.logpdf(y, k + mean * times, own).sum())

    best = optimize.minimize(lambda alpha: -value(alpha), [0.3, 1.0, 0.2, 0.4], tol=1e-10)
    names = ["a.sd", "b.mean", "b.sd", "k.value"]
    np.testing.assert_allclose(found.values[names], best.x, atol=2e-3)
    assert found.log_likelihood.estimated == pytest.approx(-best.fun, abs=1e-5)
    # The simulator is linear and the laws are normal, so that its linearization is itself.
    assert found.baselines["circe"]["log_likelihood"] == pytest.approx(-best.fun, abs=1e-5)
    assert found.sound


@pytest.mark.slow
def test_a_slow_simulator_of_two_outcomes_is_emulated() -> None:
    frame, logs = drawn(8)
    found = unjudged(one_at_a_time, table(frame), PAIR)
    alpha, value = closed(frame, logs)
    assert found.runs < 200
    assert found.sound
    np.testing.assert_allclose(found.values, alpha, atol=0.2 * found.errors.max())
    assert found.log_likelihood.estimated == pytest.approx(value, abs=0.1)


def test_a_study_is_identified_and_predicted(tmp_path: Path) -> None:
    frame = drawn(8)[0]
    frame.to_csv(tmp_path / "t.csv", index=False)
    (tmp_path / "new.csv").write_text("c\n1.2\n")
    (tmp_path / "model.py").write_text("def both(c, a, b):\n    return {'p': c*a*b, 'q': a/b}\n")
    law = 'law = "lognormal"\nmean = {lower = 0.2, upper = 5.0}\nsd = {lower = 0.01, upper = 3.0}\n'
    (tmp_path / "study.toml").write_text(
        '[experiments]\nfile = "t.csv"\noutcomes = ["p", "q"]\n'
        '[simulator]\nfunction = "model.py:both"\nvectorized = true\n'
        f"[parameters.a]\n{law}[parameters.b]\n{law}[search]\nstarts = 2\n"
    )
    told = run("identify", tmp_path / "study.toml", "--output", tmp_path / "out")
    assert told.exit_code == 0, told.output
    assert "Computed soundly" in told.output
    document = json.loads((tmp_path / "out" / "identification.json").read_text())
    assert document["density"] == "level sets"
    assert len(document["observations"]) == 16
    assert (tmp_path / "out" / "report.html").exists()
    told = run("predict", tmp_path / "out" / "identification.json", "--at", tmp_path / "new.csv")
    assert told.exit_code == 0, told.output
    assert "Predicted distribution of q" in told.output


# ---------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("inputs", "outcomes", "message"),
    [
        (
            Inputs({"a": POSITIVE, "b": Constant(1.0)}),
            ["p", "q"],
            "2 observations an experiment and 1",
        ),
        (Inputs(dict.fromkeys("abde", POSITIVE)), ["p", "q"], "at most 3 parameters may"),
    ],
)
def test_outcomes_without_a_density_are_refused(
    inputs: Inputs, outcomes: list[str], message: str
) -> None:
    seen = Experiments.from_frame(drawn()[0], outcome=outcomes)
    with pytest.raises(InputsError, match=message):
        unjudged(lambda c, **x: both(c, x["a"], x["b"]), seen, inputs, vectorized=True)


def test_a_blank_cell_is_refused() -> None:
    frame = drawn()[0]
    frame.loc[3, "q"] = np.nan
    with pytest.raises(InputsError, match="different numbers of observations need"):
        unjudged(both, table(frame), PAIR, vectorized=True)


@pytest.mark.parametrize(
    "more",
    [
        {"density": MaximumEntropy(4)},
        {"propagation": Collocation()},
        {"propagation": ResponseSurface(surfaces="own")},
        {"propagation": ResponseSurface(tolerance=0.01)},
    ],
)
def test_what_only_one_outcome_has_is_refused(more: dict[str, object]) -> None:
    with pytest.raises(InputsError, match="is for one exact outcome an experiment"):
        unjudged(both, table(drawn()[0]), PAIR, vectorized=True, **more)


def test_outcomes_that_no_parameters_give_together_are_not_sound() -> None:
    """(a b, a^2 + b^2): the second is at least twice the first."""
    frame = drawn(6)[0]
    frame["q"] = np.where(frame.index == 4, 1.5 * frame["p"], 2.5 * frame["p"])
    inputs = Inputs({"a": POSITIVE, "b": POSITIVE})
    found = unjudged(
        lambda a, b: {"p": a * b, "q": a**2 + b**2}, table(frame[["p", "q"]]), inputs,
        vectorized=True,
    )  # fmt: skip
    assert not found.sound
    (extreme,) = (one for one in found.warnings if one.about == "extreme")
    assert extreme.concerns == ("5",)
    assert "give all measured outcomes of an experiment together" in extreme.message
