"""Every partial derivative against central differences, in every place an outcome may fall."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from moments.densities.targets import mixed

from aleator.moments.densities import Gaussian, MaximumEntropy, Sensitivity
from aleator.moments.densities.moments import (
    Moments,
    weighted_moments,
    weighted_moments_with_gradient,
)
from aleator.status import Status
from aleator.types import Array

Change = Callable[[float], tuple[Moments, Array, Array]]


def difference(density: MaximumEntropy | Gaussian, y: Array, change: Change) -> Array:
    """Central differences of order four."""
    h = 1e-4
    value = [density.fit(*change(k * h)).sensitivity(y).value for k in (-2, -1, 1, 2)]
    slope: Array = (8.0 * (value[2] - value[1]) - (value[3] - value[0])) / (12.0 * h)
    return slope


def check_all(
    density: MaximumEntropy | Gaussian, m: Moments, low: Array, high: Array, y: Array
) -> Sensitivity:
    found = density.fit(m, low, high).sensitivity(y)

    def close(exact: Array, change: Change) -> None:
        slope = difference(density, y, change)
        np.testing.assert_allclose(exact, slope, rtol=1e-6, atol=1e-6 * (1 + np.abs(exact).max()))

    close(found.d_mean * m.sd, lambda h: (replace(m, mean=m.mean + h * m.sd), low, high))
    close(found.d_sd * m.sd, lambda h: (replace(m, sd=m.sd * (1 + h)), low, high))
    close(found.d_lower * m.sd, lambda h: (m, low + h * m.sd, high))
    close(found.d_upper * m.sd, lambda h: (m, low, high + h * m.sd))
    for k in range(3, m.order + 1):
        unit = np.eye(m.order + 1)[k]
        close(
            found.d_standardized[:, k],
            lambda h, unit=unit: (replace(m, standardized=m.standardized + h * unit), low, high),
        )
    np.testing.assert_allclose(found.d_standardized[:, :3], 0.0, atol=0)
    return found


def smooth(order: int, range_known: bool) -> tuple[Moments, Array, Array]:
    m, low, high = mixed(12, order, seed=8)
    keep = np.arange(12) % 4 != 0
    m = Moments(m.mean[keep], m.sd[keep], m.standardized[keep])
    if range_known:
        return m, low[keep], high[keep]
    return m, np.full(m.mean.shape, -np.inf), np.full(m.mean.shape, np.inf)


@pytest.mark.parametrize("order", [2, 3, 4, 5])
@pytest.mark.parametrize("range_known", [True, False])
def test_inside_the_support(order: int, range_known: bool) -> None:
    m, low, high = smooth(order, range_known)
    y = m.mean + 0.9 * m.sd * np.cos(np.arange(m.mean.size))
    found = check_all(MaximumEntropy(order, reach=5.0), m, low, high, y)
    assert (found.status == Status.SOLVED).all()
    assert np.any(found.d_lower != 0.0) == range_known


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("range_known", [True, False])
@pytest.mark.parametrize("order", [2, 4])
def test_outside_the_support(side: float, range_known: bool, order: int) -> None:
    m, low, high = smooth(order, range_known)
    edge = np.minimum(high, m.mean + 4 * m.sd) if side > 0 else np.maximum(low, m.mean - 4 * m.sd)
    found = check_all(MaximumEntropy(order, reach=4.0), m, low, high, edge + side * 0.7 * m.sd)
    assert (found.status == Status.OUTSIDE_SUPPORT).all()


@pytest.mark.parametrize("order", [6, 7, 8])
def test_high_orders(order: int) -> None:
    m, low, high = mixed(4, order, seed=9)
    m, low, high = Moments(m.mean[1::2], m.sd[1::2], m.standardized[1::2]), low[1::2], high[1::2]
    check_all(MaximumEntropy(order), m, low, high, m.mean + 0.3 * m.sd)


@pytest.mark.parametrize("order", range(2, 9))
@pytest.mark.parametrize("place", [1.5, 60.0])
def test_along_a_law_with_heavy_tails(order: int, place: float) -> None:
    """A scaled lognormal outcome: mean, sd, moments and with them the reach move with its sigma.

    At 1.5 the outcome lies inside the density, at 60 outside its reach.
    """
    x, w = np.polynomial.hermite_e.hermegauss(50)

    def moments(sigma: float) -> Moments:
        return weighted_moments(np.exp(sigma * x)[None], w / w.sum(), order)

    sigma, h = 0.35, 1e-5
    m = moments(sigma)
    y = m.mean + place * m.sd
    density = MaximumEntropy(order)
    found = density.fit(m, 0.0, np.inf).sensitivity(y)
    values = [
        density.fit(moments(sigma + k * h), 0.0, np.inf).sensitivity(y).value
        for k in (-2, -1, 1, 2)
    ]
    slope = (8.0 * (values[2] - values[1]) - (values[3] - values[0])) / (12.0 * h)
    moved = weighted_moments_with_gradient(
        np.exp(sigma * x)[None],
        w / w.sum(),
        order,
        (x * np.exp(sigma * x))[None, :, None],
        np.zeros((x.size, 1)),
    )
    assert moved.mean_jac is not None
    assert moved.sd_jac is not None
    assert moved.standardized_jac is not None
    exact = (
        found.d_mean * moved.mean_jac[:, 0]
        + found.d_sd * moved.sd_jac[:, 0]
        + (found.d_standardized * moved.standardized_jac[:, :, 0]).sum(axis=1)
    )
    outside = Status.OUTSIDE_SUPPORT if place > 10.0 else Status.SOLVED
    assert found.status.tolist() == [outside]
    np.testing.assert_allclose(exact, slope, rtol=2e-5)


@pytest.mark.parametrize("place", [0.3, 3.9])
def test_fallback_has_its_own_exact_partials(place: float) -> None:
    # kurtosis 1.2 with skewness 0.8 does not exist: kurtosis >= 1 + skewness^2
    m = Moments(np.array([0.2]), np.array([0.5]), np.array([[1.0, 0.0, 1.0, 0.8, 1.2]]))
    low, high = np.array([-1.0]), np.array([1.5])
    found = check_all(MaximumEntropy(4), m, low, high, m.mean + place * m.sd)
    assert found.status.tolist() == [Status.NOT_REALIZABLE]


def test_gaussian() -> None:
    m, low, high = smooth(4, range_known=True)
    check_all(Gaussian(), m, low, high, m.mean + 2.3 * m.sd)


def test_fewer_moments_used_than_given() -> None:
    m, low, high = smooth(5, range_known=True)
    found = check_all(MaximumEntropy(3), m, low, high, m.mean + 0.2 * m.sd)
    assert found.d_standardized.shape == m.standardized.shape
    np.testing.assert_allclose(found.d_standardized[:, 4:], 0.0, atol=0)


def test_value_inside_is_the_log_pdf() -> None:
    m, low, high = mixed(40, 4, seed=10)
    fitted = MaximumEntropy(4).fit(m, low, high)
    y = m.mean + 0.5 * m.sd
    np.testing.assert_allclose(fitted.sensitivity(y).value, fitted.log_pdf(y), atol=1e-10)
