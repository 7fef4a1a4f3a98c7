"""What the bases for extensions compute: against SciPy, closed forms and differences."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from aleator import Free
from aleator.errors import InputsError
from aleator.moments.moments import Moments
from aleator.polynomials import evaluate
from aleator.status import DEGENERATE_VALUE, Status

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
@pytest.mark.parametrize("nodes", [2, 5, 10])
def test_a_rule_has_the_moments_and_their_slopes(shape: float, nodes: int) -> None:
    """E x^m is scale^m times a number, so that its derivative by the scale is m E x^m/scale."""
    law, exact = weibull(), stats.weibull_min(shape, scale=SCALE)
    rule = law.rule(np.array([shape, SCALE]), nodes)
    for m in (1, 2, 2 * nodes - 1):
        assert rule.weights @ rule.x**m == pytest.approx(exact.moment(m), rel=1e-9)
        slope = (m * rule.weights * rule.x ** (m - 1)) @ rule.dx + rule.x**m @ rule.dweights
        assert slope[1] == pytest.approx(m * exact.moment(m) / SCALE, rel=1e-8)


def test_polynomials_are_orthonormal() -> None:
    law, values = weibull(), np.array([1.5, SCALE])
    rule = law.rule(values, 8)
    table = evaluate(*law.recurrence(values, 8), rule.t, 7)
    np.testing.assert_allclose((table * rule.weights[:, None]).T @ table, np.eye(8), atol=1e-10)


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


def test_a_law_is_checked_where_it_is_made() -> None:
    with pytest.raises(InputsError, match="scale"):
        weibull(2.0, Free(0.5))


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


def test_without_scatter_it_is_a_point_mass() -> None:
    fitted = logistic(np.array([1.0, 0.0]), np.array([0.0, 1.0]))
    assert fitted.status.tolist() == [Status.DEGENERATE, Status.SOLVED]
    assert fitted.sensitivity([1.0, 0.0]).value[0] == DEGENERATE_VALUE
    assert fitted.log_pdf([1.0, 0.0])[0] == -np.inf
    assert fitted.quantile([0.1, 0.9])[0].tolist() == [1.0, 1.0]
