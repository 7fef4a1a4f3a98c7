from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from individual_cases import ALPHA, decay, likelihood_of, straight_line, table
from scipy import integrate, stats

from aleator import Constant, Free, Inputs, Noise, Normal
from aleator.inference.information import infer
from aleator.likelihood.individual import GaussHermite, Layout, individual_parameters
from aleator.likelihood.individual.predictors import PredictorSettings


def covariance(alpha):
    tie = alpha[4] * alpha[1] * alpha[3]
    return np.array([[alpha[1] ** 2, tie], [tie, alpha[3] ** 2]])


def exact_linear(frame, alpha):
    """The multivariate normal densities of a linear mixed model, in the order of first rows."""
    total = []
    for _, own in frame.groupby("id", sort=False):
        design = np.stack([np.ones(len(own)), own["time"]], axis=1)
        spread = design @ covariance(alpha) @ design.T + alpha[5] ** 2 * np.eye(len(own))
        law = stats.multivariate_normal(design @ alpha[[0, 2]], spread)
        total.append(law.logpdf(own["y"].to_numpy()))
    return np.array(total)


def by_grid(model, own, alpha, points=401, reach=8.0):
    """log L of one experiment by the trapezoidal rule over both variates."""
    xi = np.linspace(-reach, reach, points)
    first, second = np.meshgrid(xi, xi, indexing="ij")
    tied = alpha[4] * first + np.sqrt(1.0 - alpha[4] ** 2) * second
    x = np.stack([alpha[0] + alpha[1] * first, alpha[2] + alpha[3] * tied])
    density = stats.norm.pdf(first) * stats.norm.pdf(second)
    for time, y in zip(own["time"], own["y"], strict=True):
        density = density * stats.norm.pdf(y, model(time, x), alpha[5])
    inner = integrate.trapezoid(density, xi, axis=1)
    return float(np.log(integrate.trapezoid(inner, xi)))


def test_it_is_the_multivariate_normal_density_where_the_simulator_is_linear():
    frame = table(straight_line)
    likelihood = likelihood_of(straight_line, frame, nodes=3)
    for alpha in (ALPHA, ALPHA * [1.5, 0.5, -1.0, 2.0, -1.5, 3.0]):
        found = likelihood.adapted(alpha)(alpha)
        assert found.each == pytest.approx(exact_linear(frame, alpha), abs=1e-9)


def test_its_score_is_that_of_the_exact_density():
    frame = table(straight_line)
    likelihood = likelihood_of(straight_line, frame, nodes=3).adapted(ALPHA)
    step = 1e-5
    for k in range(ALPHA.size):
        moved = np.eye(ALPHA.size)[k] * step
        slope = (exact_linear(frame, ALPHA + moved) - exact_linear(frame, ALPHA - moved)) / 2 / step
        assert likelihood(ALPHA).scores[:, k] == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("away", [0.0, 0.05])
def test_with_nodes_held_the_score_is_the_derivative_of_what_is_computed(away):
    likelihood = likelihood_of(decay, table(decay)).adapted(ALPHA)
    alpha, step = ALPHA + away, 1e-6
    score = likelihood(alpha).score
    for k in range(ALPHA.size):
        moved = np.eye(ALPHA.size)[k] * step
        ends = [likelihood.evaluate(alpha + sign * moved).total for sign in (1.0, -1.0)]
        assert score[k] == pytest.approx((ends[0] - ends[1]) / 2 / step, rel=1e-6, abs=1e-5)


def test_it_converges_to_the_integral_as_nodes_are_added():
    frame = table(decay)
    wanted = [by_grid(decay, own, ALPHA) for _, own in frame.groupby("id", sort=False)]
    adapted = likelihood_of(decay, frame).adapted(ALPHA)
    errors = [
        np.abs(adapted.by(GaussHermite(q), ALPHA).evaluate(ALPHA).each - wanted).max()
        for q in (3, 9, 31)
    ]
    assert errors[0] > 5.0 * errors[1] > 25.0 * errors[2]
    assert errors[2] < 2e-5


def test_nodes_of_the_law_miss_an_experiment_that_is_sharper_than_the_law():
    alpha = ALPHA * [1.0, 1.0, 1.0, 1.0, 1.0, 0.03]
    frame = table(decay, alpha)
    frame = frame[frame.groupby("id")["y"].transform("size") > 4].reset_index(drop=True)
    wanted = [by_grid(decay, own, alpha, 1601, 5.0) for _, own in frame.groupby("id", sort=False)]
    law = likelihood_of(decay, frame, nodes=21)
    assert np.abs(law.evaluate(alpha).each - wanted).max() > 1.0
    adapted = law.by(GaussHermite(9), alpha)
    assert adapted.evaluate(alpha).each == pytest.approx(np.array(wanted), abs=2e-3)


def test_blocks_of_experiments_give_the_same():
    likelihood = likelihood_of(decay, table(decay, experiments=11))
    whole = likelihood.adapted(ALPHA)(ALPHA)
    layout = replace(likelihood.layout, settings=PredictorSettings(block=500), _blocks={})
    small = replace(likelihood, layout=layout)
    assert len(small.blocks) > 1
    parts = small.adapted(ALPHA)(ALPHA)
    assert parts.each == pytest.approx(whole.each, rel=1e-9)
    assert parts.scores == pytest.approx(whole.scores, rel=1e-6, abs=1e-8)


def test_without_scatter_it_is_the_density_of_independent_errors():
    inputs = Inputs({"a": Constant(Free(-5.0, 5.0)), "b": Constant(Free(-5.0, 5.0))})
    frame = table(straight_line)
    alpha = np.array([1.2, -0.3, 0.8])
    found = likelihood_of(straight_line, frame, inputs).adapted(alpha)(alpha)
    residual = frame["y"] - 1.2 + 0.3 * frame["time"]
    assert found.total == pytest.approx(stats.norm.logpdf(residual, scale=0.8).sum(), rel=1e-12)
    assert found.score[0] == pytest.approx(residual.sum() / 0.8**2, rel=1e-7)


def test_individual_parameters_are_the_best_linear_predictors_of_a_linear_model():
    frame = table(straight_line)
    found = individual_parameters(likelihood_of(straight_line, frame).adapted(ALPHA), ALPHA)
    mean, spread = ALPHA[[0, 2]], covariance(ALPHA)
    variates = []
    for l, (_, own) in enumerate(frame.groupby("id", sort=False)):
        design = np.stack([np.ones(len(own)), own["time"]], axis=1)
        gain = (
            spread
            @ design.T
            @ np.linalg.inv(design @ spread @ design.T + ALPHA[5] ** 2 * np.eye(len(own)))
        )
        wanted = mean + gain @ (own["y"].to_numpy() - design @ mean)
        left = np.sqrt(np.diag(spread - gain @ design @ spread))
        assert found.mean[l] == pytest.approx(wanted, abs=1e-8)
        assert found.mode[l] == pytest.approx(wanted, abs=1e-6)
        assert found.sd[l] == pytest.approx(left, abs=1e-8)
        variates.append((wanted - mean) / ALPHA[[1, 3]])
    assert found.shrinkage == pytest.approx(1.0 - np.std(variates, axis=0), abs=1e-8)


def test_a_standard_deviation_next_to_zero_leaves_the_common_curve():
    inputs = Inputs({"a": Normal(Free(-9.0, 9.0), Free(1e-9, 5.0)), "b": Normal(-0.4, 1e-9)})
    frame = table(straight_line)
    alpha = np.array([1.5, 1e-9, -0.4, 1e-9, 0.3])
    found = likelihood_of(straight_line, frame, inputs).adapted(alpha)(alpha)
    residual = frame["y"] - 1.5 + 0.4 * frame["time"]
    assert found.total == pytest.approx(stats.norm.logpdf(residual, scale=0.3).sum(), rel=1e-9)
    assert abs(found.score[1]) < 1e-3


def test_the_layout_finds_the_runs_of_each_experiment():
    layout = Layout(3, np.array([0, 0, 1, 2, 2]), np.array([4, 2, 0, 3, 3]), np.zeros(5, np.intp))
    (block,) = layout.blocks(1)
    assert block.units[block.place].tolist() == [4, 2, 0, 3, 3]
    assert block.unit_owner[block.place].tolist() == [0, 0, 1, 2, 2]
    assert block.summed(np.arange(5.0)).tolist() == [1.0, 2.0, 7.0]


@pytest.mark.parametrize("noise", [1.0, 1e-2, 1e-4])
def test_the_information_is_exact_however_sharp_the_individual_laws_are(noise):
    """Of N means of m exact values each: the variance of the mean is (sd^2 + noise^2/m)/N."""
    rng, groups, each = np.random.default_rng(2), 20, 3
    centers = 50.0 + rng.standard_normal(groups)
    frame = pd.DataFrame(
        {"id": np.repeat(np.arange(groups), each), "time": 0.0, "y": np.repeat(centers, each)}
    )
    frame["y"] += noise * rng.standard_normal(len(frame))
    one = Inputs({"a": Normal(Free(0.0, 100.0), Free(0.0, 10.0))})
    likelihood = likelihood_of(lambda _, x: x[0], frame, one, 3, Noise(Free(1e-6, 5.0)))
    between, within = balanced(frame["y"].to_numpy().reshape(groups, each))
    alpha = np.array([frame["y"].mean(), between, within])
    about = infer(likelihood.adapted(alpha).followed, alpha, likelihood.hyperparameters)
    wanted = ((between**2 + within**2 / each) / groups) ** 0.5
    assert about.standard_error[0] == pytest.approx(wanted, rel=1e-3)
    assert about.edm < 1e-4


def balanced(y: np.ndarray) -> tuple[float, float]:
    """The most likely sds between and within groups of one size, y (N, m)."""
    groups, each = y.shape
    within = np.sum((y - y.mean(axis=1, keepdims=True)) ** 2) / (groups * (each - 1))
    return float(np.sqrt(np.var(y.mean(axis=1)) - within / each)), float(np.sqrt(within))
