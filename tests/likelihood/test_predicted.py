"""Distributions of outcomes by points of the law, against closed forms."""

import numpy as np
import pytest
from scipy import stats

from aleator import Free, Inputs, LogNormal, Normal
from aleator.likelihood.level_sets.predicted import PointPredictor, PredictedOutcomes
from aleator.simulators.response_functions import DirectResponse

LOADS = np.array([0.5, 1.0, 2.0])
LEVELS = np.array([0.01, 0.1, 0.5, 0.9, 0.99])


def under(inputs: Inputs, outcome, alpha: np.ndarray) -> PredictedOutcomes:  # type: ignore[no-untyped-def]
    response = DirectResponse(lambda i, x: outcome(LOADS[i], x), LOADS.size, inputs.box)
    infinite = np.full(LOADS.size, np.inf)
    condition = np.arange(LOADS.size)
    return PointPredictor(inputs, response, condition, -infinite, infinite).under(alpha)


@pytest.mark.parametrize(
    ("count", "moment", "level"), [(1, 1e-6, 1e-5), (2, 1e-6, 2e-2), (5, 5e-3, 4e-3)]
)
def test_a_normal_outcome(count: int, moment: float, level: float) -> None:
    inputs = Inputs({f"x{i}": Normal(Free(-3.0, 3.0), Free(0.1, 2.0)) for i in range(count)})
    alpha = np.tile([1.0, 0.5], count)
    found = under(inputs, lambda c, x: c * x.sum(axis=1), alpha)
    mean, sd = LOADS * count, LOADS * 0.5 * np.sqrt(count)
    np.testing.assert_allclose(found.mean, mean, rtol=moment)
    np.testing.assert_allclose(found.sd, sd, rtol=moment)
    np.testing.assert_allclose(found.standardized[:, 3], 0.0, atol=10 * moment)
    np.testing.assert_allclose(found.standardized[:, 4], 3.0, atol=20 * moment)
    y = mean + np.array([-1.5, 0.2, 2.5]) * sd
    np.testing.assert_allclose(found.cdf(y), stats.norm.cdf(y, mean, sd), atol=level)
    exact = mean[:, None] + sd[:, None] * stats.norm.ppf(LEVELS)
    np.testing.assert_allclose(found.quantile(LEVELS), exact, atol=max(20 * level, 0.02))
    np.testing.assert_allclose(found.cdf(found.quantile(np.array([0.3]))[:, 0]), 0.3, atol=5e-3)


def test_a_skew_outcome() -> None:
    inputs = Inputs({"x": LogNormal(Free(0.1, 3.0), Free(0.1, 2.0))})
    found = under(inputs, lambda c, x: c * x[:, 0], np.array([1.0, 0.5]))
    log_sd = np.sqrt(np.log(1.25))
    law = stats.lognorm(log_sd, scale=LOADS / np.sqrt(1.25))
    np.testing.assert_allclose(found.standardized[:, 3], law.stats("s"), rtol=1e-4)
    np.testing.assert_allclose(found.standardized[:, 4], law.stats("k") + 3.0, rtol=1e-3)
    np.testing.assert_allclose(found.cdf(1.3 * LOADS), law.cdf(1.3 * LOADS), atol=1e-5)


def test_runs_that_fail_count_as_none() -> None:
    found = PredictedOutcomes(np.array([[0.0, 1.0, np.nan, 2.0]]), np.full(4, 0.25), np.array([0]))
    assert found.mean.tolist() == [1.0]
    assert found.quantile(0.5).ravel().tolist() == [1.0]
    # beyond all values there is some probability, of which half is told
    assert found.cdf(np.array([-1.0])) == pytest.approx(1.0 / 12.0)
    assert found.cdf(np.array([3.0])) == pytest.approx(11.0 / 12.0)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_an_outcome_far_out_is_as_rare_as_it_is(count: int) -> None:
    """By the few points of many data sets: four standard deviations are not fifteen."""
    inputs = Inputs({f"x{i}": Normal(Free(-3.0, 3.0), Free(0.1, 2.0)) for i in range(count)})
    response = DirectResponse(lambda _, x: x.sum(axis=1), 1, inputs.box)
    infinite = np.full(1, np.inf)
    few = PointPredictor(inputs, response, np.zeros(1, dtype=int), -infinite, infinite).coarse()
    found = few.under(np.tile([0.0, 1.0], count))
    for sds in (1.0, 2.0, 3.0, 4.0):
        score = stats.norm.ppf(found.cdf(np.array([-sds * np.sqrt(count)])))
        assert score == pytest.approx(-sds, abs=0.35)
