"""What searches see of alpha: scales that may be zero, and intercepts far from all experiments."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from aleator import By, Free, GradientMultistart, Normal
from aleator.core.types import Array
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.search.interface import LogLikelihood
from aleator.search.objective import Coordinates

TABLE = pd.DataFrame({"kelvin": 300.0 + np.array([-10.0, -6.0, -1.0, 2.0, 5.0, 8.0])})
REGRESSED = Inputs({"k": Normal(By("1 + kelvin", 2.0, 12.0), Free(0.0, 4.0))}).resolved(TABLE)


def slopes(coordinates: Coordinates, u: Array) -> Array:
    """d alpha/du (K, F) by differences."""
    h = 1e-6 * np.eye(u.size)
    ends = [[coordinates.to_alpha(u + sign * step) for step in h] for sign in (1.0, -1.0)]
    return ((np.array(ends[0]) - np.array(ends[1])) / 2e-6).T


@pytest.mark.parametrize("u", [(0.5, 0.5, 0.5), (0.2, 0.6, 0.05), (0.9, 0.3, 0.99)])
def test_coordinates_go_there_and_back_and_scores_with_them(u: tuple[float, ...]) -> None:
    coordinates, at = Coordinates(REGRESSED.hyperparameters), np.array(u)
    alpha = coordinates.to_alpha(at)
    np.testing.assert_allclose(coordinates.to_unit(alpha), at, atol=1e-10)
    score = np.array([0.3, -200.0, 5.0])
    expected = score @ slopes(coordinates, at)
    np.testing.assert_allclose(coordinates.gradient(alpha, score), expected, rtol=1e-6)


def test_the_first_coordinate_is_the_value_at_the_mean_of_the_covariate() -> None:
    coordinates = Coordinates(REGRESSED.hyperparameters)
    middle = TABLE["kelvin"].mean()
    for slope in (0.1, 0.5, 0.9):
        intercept, by_kelvin, _ = coordinates.to_alpha(np.array([0.25, slope, 0.5]))
        assert intercept + by_kelvin * middle == pytest.approx(2.0 + 0.25 * 10.0)


def test_a_known_coefficient_stands_beside_as_well() -> None:
    law = Normal(By("1 + kelvin", 2.0, 12.0, terms={"kelvin": 0.1}), 1.0)
    coordinates = Coordinates(Inputs({"k": law}).resolved(TABLE).hyperparameters)
    alpha = coordinates.to_alpha(np.array([0.5]))
    assert alpha[0] + 0.1 * TABLE["kelvin"].mean() == pytest.approx(7.0)


def normal(y: Array, mean: Array, variance: Array, dmean: Array, dvariance: Array) -> LogLikelihood:
    """Normal log-likelihoods (N,) with scores by the derivatives (N, K) of mean and variance."""
    gap = y - mean
    value = -0.5 * np.log(2.0 * np.pi * variance) - 0.5 * gap**2 / variance
    by_variance = 0.5 * (gap**2 / variance - 1.0) / variance
    scores = (gap / variance)[:, None] * dmean + by_variance[:, None] * dvariance
    return LogLikelihood(value, scores, np.zeros(y.size, dtype=int))


@pytest.mark.parametrize("between", [0.0, 0.02, 0.3])
@pytest.mark.parametrize("start", [None, 3.9, 1e-4])
def test_a_scale_of_zero_and_one_next_to_zero_are_found(
    between: float, start: float | None
) -> None:
    # means of groups with a known error: mean and sd have closed forms
    error, y = 0.5, np.array([-1.0, 0.0, 1.0, 0.0])
    y = y / y.std() * np.hypot(error, between) if between else 0.7 * error * y / y.std()
    law = Normal(Free(-3.0, 5.0), Free(0.0, 4.0, start=start))

    def likelihood(alpha: Array) -> LogLikelihood:
        one, none = np.ones(y.size), np.zeros(y.size)
        by = np.stack([one, none], axis=1), np.stack([none, 2.0 * alpha[1] * one], axis=1)
        return normal(y, alpha[0] * one, (error**2 + alpha[1] ** 2) * one, *by)

    found = GradientMultistart(1).maximize(likelihood, Inputs({"b": law}).hyperparameters, seed=0)
    best = likelihood(np.array([0.0, between])).total
    assert found.log_likelihood == pytest.approx(best, abs=1e-4)
    # the log-likelihood hardly tells such an sd from zero
    assert found.alpha[1] == pytest.approx(between, abs=0.03)


def test_a_line_far_from_zero_is_found_from_any_start() -> None:
    t = TABLE["kelvin"].to_numpy()
    y = 4.0 + 0.2 * (t - 290.0) + 0.3 * np.array([1.0, -1.0, 0.5, -0.5, 1.0, -1.0])
    columns = np.stack([np.ones(t.size), t], axis=1)
    beta, squares, *_ = np.linalg.lstsq(columns, y)
    sd = np.sqrt(squares[0] / t.size)

    def likelihood(alpha: Array) -> LogLikelihood:
        by_mean = np.column_stack([columns, np.zeros(t.size)])
        by_variance = np.outer(np.ones(t.size), [0.0, 0.0, 2.0 * alpha[2]])
        return normal(y, columns @ alpha[:2], np.full(t.size, alpha[2] ** 2), by_mean, by_variance)

    search = GradientMultistart(6)
    found = search.maximize(likelihood, REGRESSED.hyperparameters, seed=1)
    best = likelihood(np.array([*beta, sd])).total
    assert found.log_likelihood == pytest.approx(best, abs=1e-6)
    np.testing.assert_allclose(found.alpha, [*beta, sd], rtol=1e-3)
    # each start gets there, as it would with a centered covariate
    assert all(end.log_likelihood > best - 1e-3 for end in found.ascents)


def test_limits_of_today_are_seen_as_they_were() -> None:
    h = [Hyperparameter("x.sd", 1e-5, 1.0, 0.1, free=True, log=True)]
    assert Coordinates(h).to_unit(np.array([0.1]))[0] == pytest.approx(0.8)
