"""The extremes of predictions over bounded hyperparameters, against exact ones."""

import numpy as np
import pytest
from scipy import stats

from aleator import Between, Inputs, Normal
from aleator.core.types import Array
from aleator.inference.extremes import Extremes, PossibleAlphas, Statistic, extremes


def possible(**laws: Normal) -> PossibleAlphas:
    known = Inputs(laws).hyperparameters
    return PossibleAlphas(known, np.array([h.start for h in known]))


def of(statistic: Statistic, mean: Between, sd: float | Between) -> Extremes:
    return extremes(possible(x=Normal(mean, sd)), statistic)


def test_quantiles_of_a_normal_law_end_at_the_corners_of_its_bounds() -> None:
    z = stats.norm.ppf([0.001, 0.2, 0.5, 0.9, 0.9999])

    def quantiles(alpha: Array) -> Array:
        return alpha[:, :1] + alpha[:, 1:] * z

    found = of(quantiles, Between(0.9, 1.1), Between(0.02, 0.05))
    assert found.lower == pytest.approx(0.9 + np.where(z < 0.0, 0.05, 0.02) * z)
    assert found.upper == pytest.approx(1.1 + np.where(z < 0.0, 0.02, 0.05) * z)
    assert np.all(found.at_lower[:, 0] == 0.9)
    assert np.all(found.at_upper[:, 0] == 1.1)


@pytest.mark.parametrize("peak", [0.113, 0.3, 0.77])
def test_an_extreme_inside_the_bounds_is_found(peak: float) -> None:
    found = of(lambda a: -((a[:, :1] - peak) ** 2) * a[:, 1:], Between(0.0, 1.0), Between(0.5, 1.0))
    assert found.upper[0] == pytest.approx(0.0, abs=1e-4)
    assert found.at_upper[0, 0] == pytest.approx(peak, abs=0.01)
    assert found.lower[0] == pytest.approx(-(max(peak, 1.0 - peak) ** 2))


def test_the_higher_of_two_peaks_is_found() -> None:
    def peaks(alpha: Array) -> Array:
        low, high = (stats.norm.pdf(alpha[:, :1], at, 0.1) for at in (0.2, 0.7))
        return np.asarray(low + 1.1 * high)

    found = of(peaks, Between(0.0, 1.0), 1.0)
    assert found.at_upper[0, 0] == pytest.approx(0.7, abs=0.01)
    assert found.upper[0] == pytest.approx(1.1 * stats.norm.pdf(0.0, 0.0, 0.1), rel=1e-3)


def test_many_bounds_are_all_at_their_corners() -> None:
    eight = possible(**{f"x{k}": Normal(Between(-1.0, 2.0), 1.0) for k in range(8)})
    weights = np.arange(1.0, 9.0)
    found = extremes(eight, lambda alpha: alpha[:, ::2] @ weights[:, None])
    assert found.lower[0] == pytest.approx(-36.0)
    assert found.upper[0] == pytest.approx(72.0)


def test_a_bound_that_becomes_known_narrows_the_extremes() -> None:
    whole = possible(x=Normal(Between(0.0, 1.0), Between(0.5, 1.0)))
    found = extremes(whole.pinned(0, 0.25), lambda alpha: alpha.sum(axis=1, keepdims=True))
    assert (found.lower[0], found.upper[0]) == pytest.approx((0.75, 1.25))
    known = whole.pinned(0, 0.25).pinned(1, 0.5)
    found = extremes(known, lambda alpha: alpha.sum(axis=1, keepdims=True))
    assert found.lower[0] == found.upper[0] == 0.75


def test_a_prediction_without_a_number_is_no_extreme() -> None:
    found = of(lambda a: np.where(a[:, :1] > 0.6, np.nan, a[:, :1]), Between(0.0, 1.0), 1.0)
    assert found.lower[0] == 0.0
    assert 0.5 <= found.upper[0] <= 0.6
