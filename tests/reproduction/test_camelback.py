"""The illustrative outcome against integrals by other means."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import truncnorm

from reproduction.illustrative.outcome import POLE, Camelback, raw

LIMIT = 6.0
X = truncnorm(-LIMIT, LIMIT)


def outcome(x: float) -> float:
    return float(np.tan(x / 4) + np.exp(x / 3 - 1) + np.tanh(x))


def mean_of(function, low: float = -LIMIT, high: float = LIMIT) -> float:
    return float(quad(lambda x: function(x) * X.pdf(x), low, high, epsabs=1e-12, limit=400)[0])


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 6])
def test_raw_moments_are_those_of_an_adaptive_integral(m: int) -> None:
    fine = Camelback().fine
    assert raw(fine.y, fine.weights, m)[-1] == pytest.approx(
        mean_of(lambda x: outcome(x) ** m), rel=1e-8
    )


def test_the_mean_has_a_closed_form_but_for_the_cut() -> None:
    # tan and tanh are odd; E exp(x/3 - 1) = exp(1/18 - 1), of which the cut takes 1e-8
    assert Camelback().exact_moments(2).mean[0] == pytest.approx(np.exp(1 / 18 - 1), abs=1e-7)


def test_the_outcome_increases_with_the_slope_that_is_told() -> None:
    c, x, step = Camelback(), np.linspace(-5.9, 5.9, 60), 1e-6
    slope = (c.outcome(x + step) - c.outcome(x - step)) / (2 * step)
    np.testing.assert_allclose(c.slope(x), slope, rtol=1e-6)
    assert np.all(c.slope(x) > 0.0)


def test_the_density_is_the_derivative_of_the_distribution_function() -> None:
    c = Camelback()
    y = np.linspace(-2.5, 3.5, 40)[None]
    step = 1e-5
    slope = (c.exact.cdf(y + step) - c.exact.cdf(y - step)) / (2 * step)
    at = c.at(np.interp(y[0], c.fine.y, c.fine.x))
    np.testing.assert_allclose(slope[0], at.pdf, rtol=2e-3)


def test_coefficients_converge_to_the_exact_ones() -> None:
    c = Camelback()
    exact = c.exact_coefficients(3)
    errors = [np.abs(c.coefficients(3, q) - exact).max() for q in (4, 8, 16)]
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


def test_near_the_poles_the_moments_diverge_as_the_pole_says() -> None:
    # E Y^4 grows by 2 * integral of (4/gap)^4 f(2 pi) = 2 f 4^4/(3 gap^3)
    gaps = np.array([1e-2, 5e-3])
    fourth = [raw(c.fine.y, c.fine.weights, 4)[3] for c in map(Camelback, POLE - gaps)]
    growth = 2 * np.exp(-0.5 * POLE**2) / np.sqrt(2 * np.pi) * 4**4 / 3
    expected = growth * (gaps[1] ** -3 - gaps[0] ** -3)
    assert fourth[1] - fourth[0] == pytest.approx(expected, rel=0.1)
