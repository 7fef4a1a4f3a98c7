"""The baselines: least squares as NumPy has it, and the linear-Gaussian law of CIRCE."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from problems import GROWTH, REGRESSION, SAMPLE, Exact, Problem
from scipy import optimize, stats

from aleator import (
    Constant,
    Free,
    GradientMultistart,
    Inputs,
)
from aleator.core.types import Array
from aleator.fit.search import LinearGaussian, fitted, linear_gaussian

LINE = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 40))


def circe(problem: Problem, y: Array, x0: Array) -> LinearGaussian:
    value, slope = at_point(problem, np.arange(y.size))(x0)
    return linear_gaussian(problem.inputs, x0, value, slope, y, GradientMultistart(4), seed=0)


def at_point(problem: Problem, condition: Array):
    def at(x: Array):
        value, slopes = Exact(problem).evaluate_with_gradient(x[None])
        return value[condition, 0], slopes[condition, 0]

    return at


def fit(problem: Problem, y: Array, start: Array):
    return fitted(at_point(problem, np.arange(y.size)), y, problem.inputs.box, start)


# ------------------------------------------------------------------------------ least squares


def test_least_squares_of_a_line_is_that_of_numpy() -> None:
    y = LINE.draw(1)
    found = fit(LINE, y, np.array([0.0, 0.0]))
    design = np.stack([np.ones_like(y), LINE.z], axis=1)
    expected, rss, *_ = np.linalg.lstsq(design, y)
    np.testing.assert_allclose(found.x, expected, atol=1e-6)
    variance = float(rss[0]) / y.size
    assert found.rmse == pytest.approx(variance**0.5, rel=1e-8)
    residual = y - design @ expected
    exact = stats.norm.logpdf(residual, 0.0, variance**0.5).sum()
    assert found.log_likelihood == pytest.approx(exact, abs=1e-6)


def test_least_squares_of_a_curve_is_that_of_scipy() -> None:
    problem = replace(GROWTH, z=np.linspace(0.5, 2.0, 30))
    y = problem.draw(2)
    found = fit(problem, y, np.array([0.0]))
    other = optimize.minimize_scalar(
        lambda x: np.sum((y - np.exp(problem.z * x)) ** 2), bracket=(0.0, 0.5), tol=1e-10
    )
    assert found.x[0] == pytest.approx(other.x, abs=1e-6)


def test_least_squares_stays_in_the_box() -> None:
    problem = replace(SAMPLE, inputs=Inputs({"x": Constant(Free(-1.0, 0.5))}))
    y = np.full(7, 3.0)
    found = fit(problem, y, np.array([0.0]))
    assert found.x[0] == pytest.approx(0.5, abs=1e-6)
    assert found.x[0] <= 0.5
    assert found.rmse == pytest.approx(2.5, rel=1e-5)


def test_a_perfect_fit_has_a_finite_log_likelihood() -> None:
    y = 1.0 + 2.0 * LINE.z
    found = fit(LINE, y, np.array([0.0, 0.0]))
    assert found.rmse < 1e-6
    assert np.isfinite(found.log_likelihood)


def test_repeated_conditions_are_fitted_once_each() -> None:
    few = replace(LINE, z=np.array([0.0, 1.0]))
    condition = np.array([0, 0, 1, 1, 1])
    y = np.array([1.0, 1.2, 3.0, 3.3, 2.7])
    found = fitted(at_point(few, condition), y, few.inputs.box, np.zeros(2))
    np.testing.assert_allclose(found.x, [1.1, 1.9], atol=1e-6)


# ------------------------------------------------------------------------------ CIRCE


def test_circe_of_a_linear_simulator_is_direct_maximum_likelihood() -> None:
    y = LINE.draw(3)
    found = circe(LINE, y, np.array([0.3, -0.7]))

    def negative(p: Array) -> float:
        scale = np.hypot(np.exp(p[1]), np.exp(p[3]) * LINE.z)
        return -float(stats.norm.logpdf(y, p[0] + p[2] * LINE.z, scale).sum())

    options = {"xatol": 1e-9, "fatol": 1e-11, "maxiter": 20_000, "maxfev": 20_000}
    other = optimize.minimize(
        negative, [1.0, -1.0, 2.0, -1.0], method="Nelder-Mead", options=options
    )
    assert found.log_likelihood == pytest.approx(-other.fun, abs=1e-6)
    expected = other.x.copy()
    expected[[1, 3]] = np.exp(expected[[1, 3]])
    np.testing.assert_allclose(found.alpha, expected, atol=2e-4)


def test_circe_sees_only_the_tangent_of_a_nonlinear_simulator() -> None:
    """exp(z x) linearized at x0: y ~ Normal(e (1 + z (m - x0)), (e z s)^2), e = exp(z x0)."""
    problem = replace(GROWTH, z=np.linspace(0.5, 2.0, 30))
    y, x0 = problem.draw(5), 0.2
    found = circe(problem, y, np.array([x0]))
    e = np.exp(problem.z * x0)
    value = stats.norm.logpdf(
        y, e * (1.0 + problem.z * (found.alpha[0] - x0)), e * problem.z * found.alpha[1]
    ).sum()
    assert found.log_likelihood == pytest.approx(value, abs=1e-9)
    # weighted least squares in the mean, exactly
    w, r = 1.0 / (e * problem.z) ** 2, y / e - 1.0
    mean = x0 + np.sum(w * e * problem.z * r * e) / np.sum(w * (e * problem.z) ** 2)
    assert found.alpha[0] == pytest.approx(mean, abs=1e-4)
