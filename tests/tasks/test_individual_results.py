"""What a user holds after an identification from several observations an experiment."""

import json

import numpy as np
import pytest
from individual_cases import PAIR, straight_line, table
from reports import printed
from scipy import stats

import aleator
from aleator import Experiments, Free, GradientMultistart, Identification, Noise
from aleator.plot.identification import save_figures
from aleator.report import terminal
from aleator.tasks.results.documents import to_json

FRAME = table(straight_line, experiments=12)


def line(time, a, b):
    return straight_line(time, (a, b))


@pytest.fixture(scope="module")
def found() -> Identification:
    return aleator.identify(
        line, Experiments.from_frame(FRAME, outcome="y", id="id"), PAIR, vectorized=True,
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
        assert "Accepted" in shown
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
    for case in (document, still, censored, logarithmic):
        files = save_figures(case, tmp_path)
        assert [file.stem for file in files] == ["experiments", "parameters", "calibration"]
        assert all(file.stat().st_size > 10_000 for file in files)
