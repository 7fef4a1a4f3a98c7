"""What a user holds after an identification from several observations an experiment."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from individual_cases import PAIR, straight_line, table
from reports import printed
from scipy import stats

import aleator
from aleator import Experiments, Free, GradientMultistart, Identification, Noise
from aleator.errors import AleatorError, InputsError
from aleator.results.documents import to_json
from aleator.views import identification as terminal
from aleator.views.figures import experiments_figure, save_figures

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
    told = found.predict(NEW, of=experiment, noise=noise, uncertainty=False)
    is_normal(told, DESIGN @ mean, np.sqrt(variance))


def test_a_column_says_which_experiment_each_new_row_is(found: Identification) -> None:
    told = found.predict(NEW.assign(who=["e3", "e1"]), of="who")
    for row, name in enumerate(["e3", "e1"]):
        alone = found.predict(NEW, of=name)
        assert told.loc[row, "mean"] == pytest.approx(alone.loc[row, "mean"])
    with pytest.raises(InputsError, match="no experiment 'e77'"):
        found.predict(NEW, of="e77")


def test_a_file_predicts_as_the_session_did(found: Identification, tmp_path) -> None:
    found.save(tmp_path / "found.json")

    def loaded(experiments: Experiments | None) -> Identification:
        return aleator.load(
            tmp_path / "found.json", simulator=line, vectorized=True, inputs=PAIR,
            noise=Noise(Free(0.01, 5.0)), experiments=experiments,
        )  # fmt: skip

    for of in (None, "e2"):
        pd.testing.assert_frame_equal(loaded(TABLE).predict(NEW, of=of), found.predict(NEW, of=of))
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
    assert len(found.residuals) == len(FRAME)
    assert set(found.residuals["time"]) == set(FRAME["time"])


def test_residuals_are_over_the_noise(found: Identification) -> None:
    for seen in found.observations:
        assert seen.scale == pytest.approx(found.values["noise.sd"])
        assert seen.residual == pytest.approx((seen.lower - seen.predicted) / seen.scale)
        row = FRAME.iloc[seen.row - 1]
        assert (row["id"], row["y"]) == (seen.id, seen.lower)
        assert seen.conditions == {"time": row["time"]}


def test_curves_are_the_identified_densities(found: Identification) -> None:
    curve = found.law_curves["a"]
    exact = stats.norm.pdf(curve["x"], found.values["a.mean"], found.values["a.sd"])
    assert curve["density"] == pytest.approx(exact)


def test_all_of_it_comes_back_from_a_file(found: Identification, tmp_path) -> None:
    found.save(tmp_path / "found.json")
    again = aleator.load(tmp_path / "found.json")
    assert again == found
    assert to_json(again.to_dict()) == to_json(found.to_dict())


def test_reports_fit_80_columns(found: Identification) -> None:
    document = json.loads(to_json(found.to_dict()))
    text = printed(terminal.render(document))
    for shown in (text, repr(found)):
        assert max(map(len, shown.splitlines())) <= 80
        assert "Computed soundly" in shown
        assert f"{len(FRAME)} observations" in " ".join(shown.split())
    assert "a.sd" in found._repr_html_()
    assert "simulator itself was integrated over" in " ".join(text.split())


def test_figures_show_every_kind_of_study(found: Identification, tmp_path) -> None:
    document = json.loads(to_json(found.to_dict()))
    still = {
        **document,
        "observations": [{**o, "conditions": {}} for o in document["observations"]],
    }
    bounds = [{**o, "upper": None} for o in document["observations"][:3]]
    censored = {**document, "observations": [*bounds, *document["observations"][3:]]}
    logarithmic = {**document, "responses": {"y": "log"}}
    files = save_figures(document, tmp_path)
    assert [file.stem for file in files] == ["experiments", "parameters", "calibration"]
    assert all(file.stat().st_size > 10_000 for file in files)
    shown = [experiments_figure(case) for case in (document, still, censored, logarithmic)]
    assert [len(figure.axes) for figure in shown] == [12, 1, 12, 12]
    assert all(axes.lines and axes.collections for figure in shown for axes in figure.axes)
    assert "at least" in [text.get_text() for text in shown[2].legends[0].get_texts()]
