"""Which further experiments tell most, of all kinds of studies."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import stats
from springs import CANDIDATES, NOISE, asked, closed_form, data, found_with, observed, springs

from aleator import (
    AleatorError,
    By,
    Censoring,
    Check,
    Constant,
    Experiments,
    Free,
    Inputs,
    Mixture,
    Noise,
    Normal,
    Predicted,
    load,
    next_experiments,
)
from aleator.core.progress import Silent
from aleator.inference.outcome_event import OutcomeEvent
from aleator.inference.virtual_scores import ScoreSettings, expected_scores
from aleator.laws.hyperparameter import limits_of
from aleator.observations.experiments import Conditions
from aleator.simulators import as_runner
from aleator.tasks.probability_gradient import event_gradient
from aleator.tasks.session import Session


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


def test_right_scores_are_checked_once_and_stay_and_measured_experiments_are_not_checked() -> None:
    """A linear model has one narrow hill, which its nodes integrate exactly."""

    class Counted(Silent):
        outcomes = 0

        def update(self, *_: object) -> None:
            self.outcomes += 1

    found, scores, counted = found_with(), [], [Counted(), Counted()]
    fit, settings = found.fit, ScoreSettings()
    for measured, progress in zip([True, False], counted, strict=True):
        rng = np.random.default_rng(0)
        scores.append(expected_scores(fit, rng, progress, measured=measured).scores)
    free = fit.inference.identified.size
    checked = settings.largest * free + settings.spread
    assert [one.outcomes for one in counted] == [settings.nodes, settings.nodes + checked]
    assert np.array_equal(*scores)


def test_scores_beyond_a_kink_that_no_measured_value_has_are_those_of_the_closed_form() -> None:
    """A gap x - t is normal with mean m and variance v, and closes beyond the tested times t.

    With u = v + sd^2, the density of y = max(0, x - t) + sd e has two parts, closed and open:
        f(y) = Phi(-m/sqrt(v)) phi(y/sd)/sd + N(y; m, u) Phi((m sd^2 + y v)/(sd sqrt(v u))).
    """
    rng, times = np.random.default_rng(3), np.tile([0.5, 1.0, 1.5], 12)
    y = np.repeat(3.0 + 0.3 * rng.standard_normal(12), 3) - times + 0.02 * rng.standard_normal(36)
    found = unjudged(
        lambda t, x: np.maximum(0.0, x - t),
        pd.DataFrame({"id": np.repeat(np.arange(12), 3), "t": times, "y": y}),
        Inputs({"x": Normal(Free(1.0, 5.0), Free(0.05, 1.0))}),
        outcome="y",
        noise=Noise(Free(0.002, 0.2)),
        vectorized=True,
        verification=Check(0),
    )
    # The second candidate has two rows, so that data sets are drawn.
    conditions = Conditions.from_frame(pd.DataFrame({"id": ["a", "b", "b"], "t": [3.0, 0.5, 1.0]}))
    session, alpha = found.session, np.array([3.0, 0.35, 0.02])
    fit = session.fit_on(conditions, alpha, session.runner_on(conditions), Silent())
    settings = ScoreSettings(draws=60)
    scores = expected_scores(fit, np.random.default_rng(0), Silent(), settings).scores[:, 0]
    again = np.random.default_rng(0)
    y = np.array([fit.drawn(again).table.observations.lower[0] for _ in range(settings.draws)])

    def log_density(point: np.ndarray) -> np.ndarray:
        mean, scatter, sd = point
        m, v, u = mean - 3.0, scatter**2, scatter**2 + sd**2
        closed = stats.norm.sf(m / np.sqrt(v)) * stats.norm.pdf(y, scale=sd)
        above = stats.norm.cdf((m * sd**2 + y * v) / (sd * np.sqrt(v * u)))
        return np.log(closed + stats.norm.pdf(y, m, np.sqrt(u)) * above)

    step = 1e-5 * np.eye(3)
    slopes = [(log_density(alpha + h) - log_density(alpha - h)) / 2e-5 for h in step]
    expected = np.stack(slopes, axis=1)
    size = np.sqrt(np.mean(expected**2, axis=0))
    assert np.all(np.abs(scores - expected) < settings.differs * size)
    own = np.mean(scores**2, axis=0)
    assert own == pytest.approx(np.mean(expected**2, axis=0), rel=0.01)


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


@pytest.mark.parametrize(
    ("event", "ends"),
    [("y > 4", (4.0, np.inf)), ("y < 4", (-np.inf, 4.0)), ("2.5 < y < 4", (2.5, 4.0))],
)
def test_so_is_a_predicted_probability(event: str, ends: tuple[float, float]) -> None:
    found, limits = found_with(), np.array(ends)
    plan = next_experiments(
        found, asked(), count=1, about=Predicted(asked(np.array([3.0])), event=event)
    )
    mean, sd = found.values[["x.mean", "x.sd"]]
    scale = np.hypot(3.0 * sd, NOISE)
    u = (limits - 3.0 * mean) / scale
    density = stats.norm.pdf(u) / scale
    each = np.array(
        [-3.0 * density, -np.where(np.isfinite(u), u, 0.0) * density * 9.0 * sd / scale]
    )
    gradient = each[:, 1] - each[:, 0]
    now = gradient @ found.covariance.to_numpy() @ gradient
    assert plan.now == pytest.approx(np.sqrt(now), rel=3e-3)


def test_so_is_the_share_of_a_law_and_no_run_is_counted_for_it() -> None:
    found, there = found_with(), asked(np.array([3.0]))
    plan = next_experiments(found, asked(), count=1, about=Predicted(there, event="x > 1.3"))
    mean, sd = found.values[["x.mean", "x.sd"]]
    u = (1.3 - mean) / sd
    gradient = stats.norm.pdf(u) / sd * np.array([1.0, u])
    expected = np.sqrt(gradient @ found.covariance.to_numpy() @ gradient)
    assert plan.now == pytest.approx(expected, rel=3e-3)
    assert plan.probability == pytest.approx((stats.norm.sf(u),), rel=3e-3)
    assert plan.runs == next_experiments(found, asked(), count=1).runs


@pytest.mark.parametrize(("chance", "noise"), [(1e-2, True), (1e-4, False), (1e-7, True)])
def test_so_is_the_probability_of_a_rare_event(chance: float, noise: bool) -> None:
    """P = Phi(-beta) with beta = (c - m)/s: dP = phi(beta) (dm + beta ds)/s."""
    found = found_with()
    mean, sd = found.values[["x.mean", "x.sd"]]
    scale, beta = np.hypot(3.0 * sd, NOISE * noise), stats.norm.isf(chance)
    event = f"y > {float(3.0 * mean + beta * scale)!r}"
    wanted = Predicted(asked(np.array([3.0])), event=event, noise=noise)
    plan = next_experiments(found, asked(), count=2, repeat=2, about=wanted)
    gradient = np.array([3.0, beta * 9.0 * sd / scale]) / scale  # of beta, but for the sign
    error = np.sqrt(gradient @ found.covariance.to_numpy() @ gradient)
    assert plan.probability == (pytest.approx(chance, rel=5e-3),)
    assert plan.now == pytest.approx(stats.norm.pdf(beta) * error, rel=5e-3)
    expected = stats.norm.sf([beta + 1.959964 * error, beta - 1.959964 * error])
    assert plan.probability_range["now"] == pytest.approx(expected, rel=2e-2)
    # So many experiments like those of the set halve the error.
    each = [closed_form(found, CANDIDATES)[int(name) - 1] for name in plan.chosen]
    whole = observed(found) + plan.halving / 2 * sum(each)
    halved = np.sqrt(gradient @ np.linalg.inv(whole) @ gradient)
    assert halved == pytest.approx(0.5 * error, rel=1e-3)


def test_both_tails_of_a_bent_outcome_and_the_share_of_a_class_count() -> None:
    """P(x^2 > c) = 2 v Phi(-sqrt(c)/sd), where x is normal with probability v, else zero."""
    law = Mixture((Normal(0.0, Free(0.2, 3.0)), Constant(0.0)), shares=(Free(0.2, 0.95),))
    inputs, at = Inputs({"x": law}), Conditions.from_frame(pd.DataFrame({"id": ["new"]}))
    runner = as_runner(lambda x: x**2, at, inputs.names, vectorized=True)
    session = Session(inputs, Noise(0.1), at.responses, None, lambda _: runner, None, True)
    sd, share = 1.1, 0.6
    alpha = np.array([0.0, sd, 0.0, share, 0.1])
    assert [h.name for h in session.hyperparameters][1:4:2] == ["x.1.sd", "x.1.share"]
    event = OutcomeEvent.of("outcome > 12", [each.name for each in at.responses])
    context = session.context(at, alpha, noise=False)
    found = event_gradient(
        context, alpha[None], event, np.array([0.0, 1e-3, 0.0, 1e-3, 0.0]),
        limits_of(session.hyperparameters),
    )  # fmt: skip
    u = np.sqrt(12.0) / sd
    assert found.probability.item() == pytest.approx(2.0 * share * stats.norm.sf(u), rel=1e-6)
    expected = [share * stats.norm.pdf(u) * u / sd, stats.norm.sf(u)]
    assert found.gradient[0, 0, [1, 3]] == pytest.approx(2.0 * np.array(expected), rel=1e-4)


def test_misuse_is_told() -> None:
    found = found_with()
    with pytest.raises(AleatorError, match="did you mean"):
        next_experiments(found, asked(), about="x.sdd")
    with pytest.raises(AleatorError, match=r"noise.sd.*fixed"):
        next_experiments(found, asked(), about="noise.sd")
    with pytest.raises(AleatorError, match="6 experiments of 5 candidates"):
        next_experiments(found, asked(), count=6)
    with pytest.raises(AleatorError, match="a quantile and an event"):
        Predicted(asked(), quantile=0.5, event="y > 1")
    with pytest.raises(AleatorError, match="neither"):
        Predicted(asked())
    with pytest.raises(AleatorError, match="no outcome 'length'"):
        next_experiments(found, asked(), about=Predicted(asked(), event="length > 1"))
    with pytest.raises(AleatorError, match="standard deviations lead to the event"):
        next_experiments(found, asked(), about=Predicted(asked(), event="y > 1e4"))
    law = {"x": Normal(1.0, 0.2)}
    fixed = unjudged(
        springs, data(0.4), law, outcome="y", noise=Noise(NOISE), vectorized=True,
        verification=Check(0),
    )  # fmt: skip
    for about in (None, "all", Predicted(asked(), quantile=0.9)):
        with pytest.raises(AleatorError, match="no hyperparameter is free"):
            next_experiments(fixed, asked(), about=about)


def test_a_result_that_was_read_from_a_file_says_so(tmp_path: object) -> None:
    path = f"{tmp_path}/found.json"
    found_with().save(path)
    with pytest.raises(AleatorError, match="read from a file"):
        next_experiments(load(path), asked())


def test_candidates_of_several_rows_share_their_parameters() -> None:
    """Two measurements under one load are worth less than two experiments of one each."""
    found = found_with()
    frame = pd.DataFrame({"id": ["one", "one", "a"], "load": [5.0, 5.0, 5.0]})
    plan = next_experiments(found, frame, count=1)
    sd = float(found.values["x.sd"])
    # their mean is measured with noise / sqrt(2), and the difference tells nothing
    variance = 25.0 * sd**2 + 0.5 * NOISE**2
    whole = observed(found) + np.diag([25.0 / variance, 0.5 * (2.0 * 25.0 * sd / variance) ** 2])
    expected = np.sqrt(np.linalg.inv(whole)[1, 1])
    assert 0.0 < plan.uncertain[0] < 0.03 * plan.alone[0]
    assert abs(plan.alone[0] - expected) < 4.0 * plan.uncertain[0]
    single = np.sqrt(np.linalg.inv(observed(found) + closed_form(found, np.array([5.0]))[0])[1, 1])
    assert abs(plan.alone[1] - single) < 4.0 * plan.uncertain[1]
    assert not plan.rows_alone
    assert plan.aim_by_default
    assert f"{plan.now:.3g}" in repr(plan)
    assert len(repr(plan)) < 1500


def test_candidates_are_grouped_by_the_column_of_ids_that_the_study_has() -> None:
    table = pd.DataFrame({"rod": ["a", "a", "b", "b", "c", "c"], "load": [1.0, 2.0] * 3})
    table["y"] = [1.1, 2.1, 0.8, 1.7, 1.3, 2.4]
    law = {"x": Normal(Free(0.1, 3.0), Free(0.01, 1.0))}
    found = unjudged(
        lambda load, x: load * x, table, law, outcome="y", id="rod", noise=Noise(0.1),
        vectorized=True,
    )  # fmt: skip
    new = pd.DataFrame({"rod": ["n", "n", "m"], "load": [1.0, 2.0, 1.0]})
    with pytest.raises(AleatorError, match="3 experiments of 2 candidates"):
        next_experiments(found, new, count=3)
    alone = next_experiments(found, new.drop(columns="rod"), count=1, about="x.mean")
    assert alone.ids == ("1", "2", "3")
    assert alone.rows_alone
    assert not alone.aim_by_default
    with pytest.raises(AleatorError, match="load"):
        found.probability("y > 1", at={"rod": ["n"]})


def test_an_sd_that_ended_at_its_limit_is_planned_for_off_its_limit() -> None:
    found = found_with(0.0)
    assert found.alpha["x.sd"].at_bound == "lower"
    plan = next_experiments(found, asked(), count=1)
    interval = found.alpha["x.sd"].interval
    limit = found.alpha["x.sd"].estimate
    assert plan.planned_for == {"x.sd": pytest.approx(limit + (interval[1] - limit) / 1.959964)}
    assert plan.chosen == ("5",)
    assert np.isfinite(plan.now)
    # A prediction takes the same law, and its error includes that of this sd.
    wanted = Predicted(asked(np.array([3.0])), quantile=0.99)
    far = next_experiments(found, asked(), count=1, about=wanted)
    assert far.planned_for == plan.planned_for
    sd, z = far.planned_for["x.sd"], stats.norm.ppf(0.99)
    gradient = np.array([3.0, z * 9.0 * sd / np.hypot(3.0 * sd, NOISE)])
    loads = data(0.0)["load"].to_numpy()
    variance = (loads * sd) ** 2 + NOISE**2
    told = [np.sum(loads**2 / variance), np.sum(0.5 * (2.0 * loads**2 * sd / variance) ** 2)]
    assert far.now == pytest.approx(np.sqrt(np.sum(gradient**2 / told)), rel=1e-3)


def test_one_exact_outcome_an_experiment_goes_the_other_way() -> None:
    """Without noise the load does not matter: y/load is x itself."""
    found = found_with(noisy=False)
    plan = next_experiments(found, asked(), count=1, about="x.sd")
    sd = float(found.values["x.sd"])
    one = observed(found) + np.diag([1.0, 2.0]) / sd**2
    assert plan.alone == pytest.approx(np.sqrt(np.linalg.inv(one)[1, 1]), rel=1e-3)


def test_candidates_are_tested_to_the_limit_of_the_others() -> None:
    """Beyond the limit of a test a value only tells that it is beyond."""
    table = data(0.4)
    table["seen"] = np.where(table["y"] > 2.5, "beyond", "")
    table["y"] = table["y"].clip(upper=2.5)
    found = unjudged(
        springs,
        Experiments.from_frame(
            table, outcome="y", censored={"y": Censoring("seen", right="beyond")}
        ),
        Inputs({"x": Normal(Free(-3.0, 3.0), Free(0.01, 1.5))}),
        noise=Noise(NOISE),
        vectorized=True,
        verification=Check(0),
    )
    conditions = Conditions.from_frame(
        asked(np.array([1.0, 20.0])), responses=found.fit.table.observations.responses
    )
    session = found.session
    fit = session.fit_on(conditions, found.fit.alpha, session.runner_on(conditions), Silent())
    drawn = fit.drawn(np.random.default_rng(0)).table.observations
    assert drawn.lower[1] == 2.5
    assert drawn.censored.tolist() == [False, True]
    # the limit of a censored normal value: s = phi/(1 - Phi)/scale above it
    scores = expected_scores(fit, np.random.default_rng(0), Silent())
    mean, sd = found.values[["x.mean", "x.sd"]]
    scale = np.hypot(sd, NOISE)
    u = (2.5 - mean) / scale
    beyond, density = stats.norm.sf(u), stats.norm.pdf(u)
    expected = (stats.norm.cdf(u) - u * density + density**2 / beyond) / scale**2
    assert scores.information[0, 0, 0] == pytest.approx(expected, rel=1e-4)


def test_a_law_that_follows_a_covariate_is_learnt_at_its_far_ends() -> None:
    rng = np.random.default_rng(5)
    heat = np.tile([-1.0, 0.0, 1.0], 12)
    y = 1.0 + 0.3 * heat + 0.3 * rng.standard_normal(36) + 0.1 * rng.standard_normal(36)
    found = unjudged(
        lambda x: x,
        pd.DataFrame({"heat": heat, "y": y}),
        Inputs({"x": Normal(By("1 + heat", -9.0, 9.0), Free(0.01, 2.0))}),
        outcome="y",
        noise=Noise(0.1),
        vectorized=True,
        verification=Check(0),
    )
    (slope,) = (name for name in found.values.index if "heat" in name)
    new = pd.DataFrame({"heat": [0.0, 0.5, 3.0], "load": 1.0})
    offered = Conditions.from_frame(new, conditions=["load"])  # the simulator takes no heat
    plan = next_experiments(found, offered, count=1, about=slope)
    assert plan.table()["heat"].tolist() == [3.0, 0.5, 0.0]
    variance = float(found.values["x.sd"]) ** 2 + 0.01
    design = np.stack([np.ones(36), heat], axis=1)
    for error, at in zip(plan.alone, new["heat"], strict=True):
        whole = np.vstack([design, [1.0, at]])
        expected = np.sqrt(variance * np.linalg.inv(whole.T @ whole)[1, 1])
        assert error == pytest.approx(expected, rel=1e-3)
    assert plan.chosen == ("3",)
    assert [*plan.beyond] == ["3"]
    assert "heat is 1 tested ranges above" in plan.table()["beyond"].iloc[0]
