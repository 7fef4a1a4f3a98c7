"""Intervals of replicates: those of laws whose intervals are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, stats

from aleator.tasks.bootstrap import acceleration, basic, bias_corrected, percentile

MANY = 200_000
NOTHING = np.zeros((10, 1))


def test_percentiles_are_quantiles_and_basic_ones_are_mirrored() -> None:
    alpha = np.random.default_rng(0).gamma(3.0, size=(MANY, 1))
    low, high = stats.gamma(3.0).ppf([0.025, 0.975])
    assert percentile(alpha)[0] == pytest.approx([low, high], rel=0.02)
    assert basic(np.array([3.0]), alpha)[0] == pytest.approx([6.0 - high, 6.0 - low], abs=0.1)


def test_without_bias_and_skewness_it_is_the_percentile_interval() -> None:
    alpha = np.random.default_rng(1).normal(2.0, 1.0, (MANY, 1))
    found = bias_corrected(np.array([2.0]), alpha, NOTHING)
    assert found == pytest.approx(percentile(alpha), abs=0.02)


def test_a_scale_has_the_interval_of_its_transformation() -> None:
    """Efron 1987, section 3: theta chi2_19 / 19, whose score has the skewness sqrt(8 / 19)."""
    df = 19
    alpha = np.random.default_rng(2).chisquare(df, (4 * MANY, 1)) / df
    skewness = np.sqrt(8.0 / df)
    other = optimize.brentq(lambda t: acceleration(pair(t))[0] - skewness / 6.0, -1.0, 0.0)
    found = bias_corrected(np.array([1.0]), alpha, pair(other), level=0.9)[0]
    exact = df / stats.chi2(df).ppf([0.95, 0.05])
    assert found == pytest.approx(exact, rel=0.02)
    assert percentile(alpha, 0.9)[0, 1] < 0.9 * exact[1]


def pair(other: float) -> np.ndarray:
    """The influence of two experiments."""
    return np.array([[1.0], [other]])


def test_the_acceleration_is_a_sixth_of_the_skewness() -> None:
    each = np.random.default_rng(4).gamma(1.0, size=(400, 1))
    deviation = each - each.mean()
    skewness = stats.skew(each[:, 0])
    assert acceleration(deviation)[0] == pytest.approx(skewness / 6.0 / np.sqrt(400))
    assert acceleration(NOTHING)[0] == 0.0


def test_without_replicates_or_on_one_side_nothing_is_known() -> None:
    assert np.all(np.isnan(bias_corrected(np.zeros(2), np.zeros((0, 2)), np.zeros((3, 2)))))
    assert np.all(np.isnan(percentile(np.zeros((0, 2)))))
    assert np.all(np.isnan(bias_corrected(np.zeros(1), np.ones((9, 1)), NOTHING)))
