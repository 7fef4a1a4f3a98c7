"""What the bases for extensions compute: against SciPy, closed forms and differences."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from aleator import Free
from aleator.moments.moments import Moments

PLUGINS = Path(__file__).parent / "plugins"
SCALE = 1.3


@pytest.fixture(autouse=True)
def beside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(PLUGINS)


def weibull(shape: Any = 2.0, scale: Any = SCALE) -> Any:
    return importlib.import_module("weibull").Weibull(shape, scale)


def differences(function: Any, values: np.ndarray, k: int) -> np.ndarray:
    step = np.zeros(values.size)
    step[k] = 1e-5
    return (function(values + step) - function(values - step)) / 2e-5


@pytest.mark.parametrize("shape", [0.8, 1.0, 2.0, 5.0])
def test_mean_and_sd_and_their_slopes(shape: float) -> None:
    """Both are the scale times a number, so that their derivatives by the scale are this number."""
    law, exact = weibull(), stats.weibull_min(shape, scale=SCALE)
    found = law.mean_and_sd(np.array([shape, SCALE]))
    assert (found.mean, found.sd) == pytest.approx((exact.mean(), exact.std()), rel=1e-10)
    slopes = found.dmean[1], found.dsd[1]
    assert slopes == pytest.approx((exact.mean() / SCALE, exact.std() / SCALE), rel=1e-9)


def test_a_rule_is_exact_in_theta_and_converges_in_x() -> None:
    law, values = weibull(), np.array([2.0, SCALE])
    exact = stats.weibull_min(2.0, scale=SCALE)
    errors = [abs(law.rule(values, q).weights @ law.rule(values, q).x ** 2 - exact.moment(2))
              for q in (2, 5, 10, 20)]  # fmt: skip
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-5


def test_the_image_of_the_normal_variate_and_its_slopes() -> None:
    law, values = weibull(Free(0.5, 4.0), Free(0.5, 4.0)), np.array([1.5, SCALE])
    theta = np.linspace(-7.0, 7.0, 29)
    found = law.standard(values, theta)
    exact, below = stats.weibull_min(1.5, scale=SCALE), stats.norm.cdf(-np.abs(theta))
    x = np.where(theta < 0.0, exact.ppf(below), exact.isf(below))
    np.testing.assert_allclose(found.x, x, rtol=1e-9)
    np.testing.assert_allclose(law.normal_score(values, found.x), theta, atol=1e-9)
    for k in range(2):
        slope = differences(lambda at: law.standard(at, theta).x, values, k)
        np.testing.assert_allclose(found.dvalues[:, k], slope, rtol=1e-6, atol=1e-9)
    h = 1e-5
    slope = (law.standard(values, theta + h).x - law.standard(values, theta - h).x) / (2.0 * h)
    np.testing.assert_allclose(found.dtheta, slope, rtol=1e-6)


def test_the_law_about_a_center_has_this_mean_and_sd_within_its_limits() -> None:
    law = weibull(Free(0.5, 8.0), Free(0.1, 4.0))
    exact = stats.weibull_min(3.0, scale=2.0)
    values = law.filling(exact.mean(), exact.std())
    assert values == pytest.approx([3.0, 2.0], rel=1e-6)
    assert weibull(2.0, Free(0.1, 4.0)).filling(1e3).tolist() == pytest.approx([2.0, 4.0])
    assert weibull().filling(1.0).tolist() == [2.0, SCALE]
    own = law.mean_and_sd(np.array([3.0, 2.0]))
    assert (own.mean, own.sd) == pytest.approx((exact.mean(), exact.std()))


def logistic(mean: np.ndarray, sd: np.ndarray) -> Any:
    moments = Moments(mean, sd, np.tile([1.0, 0.0, 1.0, 0.0, 3.0], (mean.size, 1)))
    return importlib.import_module("logistic").Logistic().fit(moments, -np.inf, np.inf)


def test_a_standardized_density_is_its_own_in_the_unit_of_the_outcome() -> None:
    mean, sd = np.array([1.0, -300.0]), np.array([0.2, 40.0])
    exact = stats.logistic(mean[:, None], sd[:, None] * np.sqrt(3.0) / np.pi)
    fitted = logistic(mean, sd)
    y = mean[:, None] + sd[:, None] * np.array([-6.0, -0.3, 0.0, 2.0])
    np.testing.assert_allclose(fitted.log_pdf(y), exact.logpdf(y), rtol=1e-12)
    np.testing.assert_allclose(fitted.cdf(y), exact.cdf(y), rtol=1e-12)
    p = np.array([1e-9, 0.3, 0.5, 0.999])
    np.testing.assert_allclose(fitted.quantile(p), exact.ppf(p), rtol=1e-9, atol=1e-9)


def test_its_derivatives_are_those_of_differences() -> None:
    y, at = np.array([0.7]), np.array([1.0, 0.4])

    def value(alpha: np.ndarray) -> np.ndarray:
        return logistic(alpha[:1], alpha[1:]).sensitivity(y).value

    found = logistic(at[:1], at[1:]).sensitivity(y)
    assert found.d_mean == pytest.approx(differences(value, at, 0), rel=1e-6)
    assert found.d_sd == pytest.approx(differences(value, at, 1), rel=1e-6)
    assert not found.d_standardized.any()
