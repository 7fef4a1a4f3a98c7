"""The step that individual parameters show, held against closed forms of linear models."""

import numpy as np
import pandas as pd
import pytest
from individual_cases import ALPHA, PAIR, likelihood_of, straight_line, table

from aleator import Constant, Free, Inputs, Mixture, Noise, Normal
from aleator.laws import By

ONE = Inputs(
    {"a": Normal(Free(-10.0, 10.0), Free(0.01, 5.0)), "b": Constant(Free(-5.0, 5.0))},
)


def balanced(experiments=6, observations=4, seed=1) -> pd.DataFrame:
    """y_lk = a_l + e_lk, as many values of each."""
    rng = np.random.default_rng(seed)
    own = 2.0 + 0.8 * rng.standard_normal(experiments)
    y = np.repeat(own, observations) + 0.5 * rng.standard_normal(experiments * observations)
    ids = np.repeat([f"e{l}" for l in range(experiments)], observations)
    return pd.DataFrame({"id": ids, "time": 0.0, "y": y})


def individual_laws(frame, mean, sd, noise):
    """Means (N,) and variance of a_l given the observations of l."""
    groups = frame.groupby("id", sort=False)["y"]
    precision = sd**-2 + groups.size().to_numpy() * noise**-2
    return (mean / sd**2 + groups.sum().to_numpy() / noise**2) / precision, 1.0 / precision


def test_a_step_is_that_of_expectation_and_maximization_over_the_share_that_is_told():
    frame, alpha = balanced(), np.array([1.0, 0.7, 0.0, 0.6])
    likelihood = likelihood_of(straight_line, frame, ONE)
    value, found = likelihood.continued.expectation_step(alpha)
    mean, variance = individual_laws(frame, 1.0, 0.7, 0.6)
    told = 1.0 - variance / 0.49
    assert value == pytest.approx(likelihood.adapted(alpha).evaluate(alpha).total, abs=1e-9)
    assert found[0] == pytest.approx(1.0 + np.sum(mean - 1.0) / told.sum(), abs=1e-9)
    square = np.sum((mean - 1.0) ** 2 + variance - 0.49) / np.sum(told**2)
    assert found[1] ** 2 == pytest.approx(0.49 + square, abs=1e-9)
    assert found[2] == 0.0
    residual = frame["y"].to_numpy() - np.repeat(mean, 4)
    assert found[3] ** 2 == pytest.approx(np.mean(residual**2 + np.repeat(variance, 4)), abs=1e-9)


def test_one_step_finds_the_mean_of_a_balanced_table():
    """Whatever the sds are, its maximum is the mean of all observations."""
    frame = balanced()
    for alpha in ([-1.0, 0.7, 0.0, 0.6], [4.0, 1.5, 0.0, 2.0], [2.2, 0.3, 0.0, 0.5]):
        found = likelihood_of(straight_line, frame, ONE).continued.expectation_step(
            np.array(alpha)
        )[1]
        assert found[0] == pytest.approx(frame["y"].mean(), abs=1e-8)


def test_steps_end_at_the_maximum_of_a_balanced_table():
    """Of a balanced table the maximum is known from sums of squares within and between."""
    frame = balanced(experiments=8, observations=5)
    means = frame.groupby("id", sort=False)["y"].mean().to_numpy()
    within = np.mean((frame["y"].to_numpy() - np.repeat(means, 5)) ** 2) * 5 / 4
    between = np.mean((means - means.mean()) ** 2) - within / 5
    following = likelihood_of(straight_line, frame, ONE).continued
    alpha = np.array([-3.0, 0.2, 0.0, 2.0])
    for _ in range(12):
        _, alpha = following.expectation_step(alpha)
    assert alpha == pytest.approx([means.mean(), between**0.5, 0.0, within**0.5], abs=1e-5)


def test_errors_grow_twofold_at_most_so_that_laws_explain_more():
    alpha = np.array([9.0, 0.02, 0.0, 0.05])
    following = likelihood_of(straight_line, balanced(), ONE).continued
    assert following.expectation_step(alpha)[1][3] == pytest.approx(0.1)


def test_a_formula_follows_the_individual_means():
    frame = balanced(experiments=7).iloc[3:]
    covariate = pd.DataFrame({"z": np.arange(7.0)}, index=frame["id"].unique())
    laws = {"a": Normal(By("1 + z", -10.0, 10.0), Free(0.01, 5.0)), "b": ONE.laws["b"]}
    inputs = Inputs(laws).resolved(covariate)
    z, alpha = covariate["z"].to_numpy(), np.array([2.0, 0.1, 0.7, 0.0, 0.6])
    found = likelihood_of(straight_line, frame, inputs).continued.expectation_step(alpha)[1]
    # generalized least squares, with the sds that the law and the errors have
    groups = frame.groupby("id", sort=False)["y"]
    weight = 1.0 / (0.7**2 + 0.6**2 / groups.size().to_numpy())
    design = np.stack([np.ones(7), z], axis=1)
    wanted = np.linalg.solve((design.T * weight) @ design, design.T @ (weight * groups.mean()))
    assert found[:2] == pytest.approx(wanted, abs=1e-8)
    assert found[2] != 0.7


def test_what_is_no_mean_and_no_sd_stays():
    frame = table(straight_line)
    noise = Noise(Free(0.01, 5.0), relative=Free(0.001, 1.0))
    likelihood = likelihood_of(straight_line, frame, PAIR, noise=noise)
    alpha = np.append(ALPHA, 0.1)
    found = likelihood.continued.expectation_step(alpha)[1]
    assert found[[4, 6]] == pytest.approx(alpha[[4, 6]])
    assert np.all(found[[0, 1, 2, 3, 5]] != alpha[[0, 1, 2, 3, 5]])


def test_of_a_mixture_only_the_rest_moves():
    parts = (Normal(Free(-10.0, 10.0), Free(0.01, 5.0)), Normal(Free(-10.0, 10.0), 0.3))
    inputs = Inputs({"a": Mixture(parts), "b": ONE.laws["b"]})
    likelihood = likelihood_of(straight_line, balanced(), inputs)
    alpha = np.array([1.0, 0.7, 3.0, 0.3, 0.4, 0.0, 0.6])
    value, found = likelihood.continued.expectation_step(alpha)
    assert value == pytest.approx(likelihood.adapted(alpha).evaluate(alpha).total, abs=1e-9)
    np.testing.assert_array_equal(found[:6], alpha[:6])
    assert found[6] != 0.6


def test_where_nothing_is_possible_no_step_is_made():
    likelihood = likelihood_of(lambda time, x: x[0] * np.nan * time, balanced(), ONE)
    alpha = np.array([1.0, 0.7, 0.0, 0.6])
    value, found = likelihood.continued.expectation_step(alpha)
    assert value == -np.inf
    np.testing.assert_array_equal(found, alpha)
