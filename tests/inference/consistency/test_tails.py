"""The measure of tails is normal for few values, and sees what it is for."""

import numpy as np
import pytest
from scipy import stats

from aleator.inference.consistency.battery import moments


def heavy(rows: np.ndarray) -> np.ndarray:
    return np.array([moments(w)[1] for w in rows])


@pytest.mark.parametrize("count", [16, 27])
def test_heavy_tails_of_normal_values_are_as_rare_as_told(count: int) -> None:
    """So many samples lie beyond quantiles of the normal law with their mean and scatter."""
    found = heavy(np.random.default_rng(count).standard_normal((10000, count)))
    z = (found - found.mean()) / found.std()
    for level in (0.02, 0.002):
        share = np.mean(z > stats.norm.isf(level))
        assert share == pytest.approx(level, abs=4.0 * np.sqrt(level / 10000) + 0.1 * level)


def test_heavy_tails_are_larger_than_normal_ones_and_two_modes_smaller() -> None:
    rng = np.random.default_rng(1)
    t3, normal = rng.standard_t(3, (300, 108)), rng.standard_normal((300, 108))
    modes = 0.5 * normal + 1.5 * rng.choice([-1.0, 1.0], normal.shape)
    low, high = np.quantile(heavy(normal), [0.05, 0.95])
    assert np.mean(heavy(t3) > high) > 0.85
    assert np.mean(heavy(modes) < low) > 0.95


def test_size_and_place_do_not_count() -> None:
    w = np.random.default_rng(2).standard_normal(50)
    assert moments(3.0 + 7.0 * w) == pytest.approx(moments(w))
