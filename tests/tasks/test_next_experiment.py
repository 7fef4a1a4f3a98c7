"""The next experiment, where its expected information is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from springs import CANDIDATES, NOISE, asked, closed_form, data, found_with, observed

from aleator import (
    AleatorError,
    Predicted,
    load,
    next_experiments,
)
from aleator.inference.design import expected_scores
from aleator.observations.experiments import Conditions
from aleator.progress import Silent


def test_expected_information_is_that_of_the_closed_form() -> None:
    found = found_with()
    conditions = Conditions.from_frame(asked())
    session = found.session
    fit = session.fit_on(conditions, found.fit.alpha, session.runner_on(conditions), Silent())
    scores = expected_scores(fit, np.random.default_rng(0), Silent())
    expected = closed_form(found, CANDIDATES)
    assert scores.information[:, :2, :2] == pytest.approx(expected, rel=1e-6, abs=1e-6)
    # the mean of a score is zero
    assert np.einsum("rc,rck->ck", scores.weights, scores.scores)[:, :2] == pytest.approx(
        0.0, abs=1e-6
    )


def test_it_is_the_mean_of_the_observed_information_of_drawn_data() -> None:
    found = found_with()
    conditions = Conditions.from_frame(asked(np.repeat([1.0, 5.0], 400)))
    session = found.session
    fit = session.fit_on(conditions, found.fit.alpha, session.runner_on(conditions), Silent())
    drawn, alpha, step = fit.drawn(np.random.default_rng(2)), fit.alpha, 1e-3
    ends = []
    for sign in (1.0, -1.0):
        moved = alpha.copy()
        moved[1] += sign * step
        scored = drawn.at(moved).scored().scores
        assert scored is not None
        ends.append(scored[:, 1])
    each = -(ends[0] - ends[1]) / (2.0 * step)
    expected = closed_form(found, np.array([1.0, 5.0]))[:, 1, 1]
    for part, value in zip(np.split(each, 2), expected, strict=True):
        assert abs(part.mean() - value) < 4.0 * part.std() / 20.0


def test_the_error_after_each_candidate_and_after_the_set_is_that_of_the_closed_form() -> None:
    found = found_with()
    plan = next_experiments(found, asked(), count=2)
    assert plan.about == "x.sd"
    assert plan.now == pytest.approx(found.errors["x.sd"], rel=1e-6)
    whole = observed(found) + closed_form(found, CANDIDATES)
    assert plan.alone == pytest.approx(np.sqrt(np.linalg.inv(whole)[:, 1, 1]), rel=1e-5)
    assert plan.chosen == ("5", "4")
    both = observed(found) + closed_form(found, CANDIDATES[3:]).sum(axis=0)
    assert plan.after[-1] == pytest.approx(np.sqrt(np.linalg.inv(both)[1, 1]), rel=1e-5)
    again = closed_form(found, data(0.4)["load"].to_numpy()).sum(axis=0)
    assert plan.repetitions is not None
    repeated = observed(found) + plan.repetitions * again
    assert np.sqrt(np.linalg.inv(repeated)[1, 1]) == pytest.approx(plan.after[-1], rel=1e-4)


def test_a_predicted_quantile_is_known_as_the_delta_method_says() -> None:
    found = found_with()
    wanted = Predicted(asked(np.array([3.0])), quantile=0.99)
    plan = next_experiments(found, asked(), count=1, about=wanted)
    sd, z = float(found.values["x.sd"]), stats.norm.ppf(0.99)
    gradient = np.array([3.0, z * 9.0 * sd / np.hypot(3.0 * sd, NOISE)])
    now = gradient @ found.covariance.to_numpy() @ gradient
    assert plan.now == pytest.approx(np.sqrt(now), rel=1e-3)
    assert not plan.relative


@pytest.mark.parametrize("limit", [{"above": 4.0}, {"below": 4.0}])
def test_so_is_a_predicted_probability(limit: dict[str, float]) -> None:
    found = found_with()
    plan = next_experiments(
        found, asked(), count=1, about=Predicted(asked(np.array([3.0])), **limit)
    )
    mean, sd = found.values[["x.mean", "x.sd"]]
    scale = np.hypot(3.0 * sd, NOISE)
    u = (4.0 - 3.0 * mean) / scale
    gradient = stats.norm.pdf(u) / scale * np.array([3.0, u * 9.0 * sd / scale])
    now = gradient @ found.covariance.to_numpy() @ gradient
    assert plan.now == pytest.approx(np.sqrt(now), rel=1e-3)


def test_errors_of_several_predictions_and_of_all_are_relative_to_now() -> None:
    found = found_with()
    for about in ("all", Predicted(asked(np.array([1.0, 3.0])), quantile=0.9)):
        plan = next_experiments(found, asked(), count=2, about=about)
        assert plan.relative
        assert plan.now == pytest.approx(1.0)
        assert plan.after[1] < plan.after[0] < 1.0


def test_in_the_mean_over_possible_laws_an_experiment_tells_less() -> None:
    """The variance is a convex function of the information."""
    found = found_with()
    new = asked(CANDIDATES[2:])
    one, many = (next_experiments(found, new, count=2, laws=k) for k in (1, 2))
    assert many.laws == 2
    assert many.chosen == one.chosen
    assert many.now == pytest.approx(one.now)


def test_misuse_is_told() -> None:
    found = found_with()
    with pytest.raises(AleatorError, match="did you mean"):
        next_experiments(found, asked(), about="x.sdd")
    with pytest.raises(AleatorError, match=r"noise.sd.*fixed"):
        next_experiments(found, asked(), about="noise.sd")
    with pytest.raises(AleatorError, match="6 experiments of 5 candidates"):
        next_experiments(found, asked(), count=6)
    with pytest.raises(AleatorError, match="quantile and above"):
        Predicted(asked(), quantile=0.5, above=1.0)
    with pytest.raises(AleatorError, match="neither"):
        Predicted(asked())


def test_a_result_that_was_read_from_a_file_says_so(tmp_path: object) -> None:
    path = f"{tmp_path}/found.json"
    found_with().save(path)
    with pytest.raises(AleatorError, match="read from a file"):
        next_experiments(load(path), asked())
