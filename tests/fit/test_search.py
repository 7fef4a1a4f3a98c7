"""Baselines and searches: least squares as NumPy has it, CIRCE, a search of a sample of many."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from problems import REGRESSION, SAMPLE, Exact, Problem
from scipy import optimize, stats

from aleator import (
    Check,
    Constant,
    Free,
    Gamma,
    Gaussian,
    GradientMultistart,
    Identification,
    Inputs,
    Noise,
    Normal,
    ScipyLaw,
    identify,
)
from aleator.core.types import Array
from aleator.fit import search as searching
from aleator.fit.question import start_point
from aleator.fit.search import LinearGaussian, fitted, linear_gaussian
from aleator.laws import Law
from aleator.likelihood.individual import IndividualLikelihood
from aleator.moments.likelihood import Continued
from aleator.search import Ascent, Optimum, SearchResult

LINE = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 40))


def circe(problem: Problem, y: Array, x0: Array) -> LinearGaussian:
    value, slope = at_point(problem, np.arange(y.size))(x0)
    own = value[:, None], slope[:, None], y[:, None]
    return linear_gaussian(problem.inputs, x0, *own, GradientMultistart(4), seed=0)


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


# of a simulator z x + b, linear already
LOADS = np.linspace(0.5, 1.5, 60)
WEIBULL = stats.weibull_min(2.0)
MEAN, SD = Free(0.5, 4.0), Free(0.05, 2.0)


@pytest.mark.parametrize(
    "law",
    [ScipyLaw(WEIBULL), Gamma(MEAN, 0.4), Normal(MEAN, SD)],
    ids=lambda law: type(law).__name__,
)
def test_the_linear_gaussian_law_takes_any_law(law: Law) -> None:
    """Its log-likelihood is that of Normal(z m + b, z^2 s^2) with the law's m and s."""
    inputs = Inputs({"x": law, "b": Constant(Free(-5.0, 5.0))})
    y = 1.0 + LOADS * WEIBULL.rvs(size=60, random_state=np.random.default_rng(1))
    x0 = start_point(inputs)
    value, slope = LOADS * x0[0] + x0[1], np.stack([LOADS, np.ones(60)], axis=1)
    each = value[:, None], slope[:, None], y[:, None]
    found = linear_gaussian(inputs, x0, *each, GradientMultistart(3), seed=0)
    *own, b = found.alpha
    moments = law.mean_and_sd(np.array(own))
    truth = stats.norm.logpdf(y, LOADS * moments.mean + b, LOADS * moments.sd).sum()
    assert found.log_likelihood == pytest.approx(truth, abs=1e-9)


def test_the_linear_gaussian_law_of_several_outcomes_is_that_of_their_sample() -> None:
    """Two outcomes of a linear simulator of two correlated normal parameters, in closed form."""
    law = Normal(Free(-5.0, 5.0), Free(0.01, 5.0))
    inputs = Inputs({"a": law, "b": law}, {("a", "b"): Free(-0.95, 0.95)})
    x = np.random.default_rng(2).multivariate_normal([1.0, -0.5], [[0.5, 0.2], [0.2, 0.3]], 40)
    turn, x0 = np.array([[1.0, 2.0], [-1.0, 0.5]]), np.zeros(2)
    y = x @ turn.T
    slope = np.broadcast_to(turn, (40, 2, 2))
    found = linear_gaussian(inputs, x0, np.zeros((40, 2)), slope, y, GradientMultistart(3), seed=0)
    covariance = np.cov(x.T, bias=True)
    sds = np.sqrt(np.diag(covariance))
    rho = covariance[0, 1] / sds.prod()
    truth = [x[:, 0].mean(), sds[0], x[:, 1].mean(), sds[1], rho]
    np.testing.assert_allclose(found.alpha, truth, atol=1e-4)
    value = stats.multivariate_normal.logpdf(y, y.mean(axis=0), np.cov(y.T, bias=True)).sum()
    assert found.log_likelihood == pytest.approx(value, abs=1e-8)


# ------------------------------------------------------------------------------ many experiments


def table(count: int) -> pd.DataFrame:
    rng = np.random.default_rng(4)
    z = np.linspace(1.0, 2.0, count)
    return pd.DataFrame({"z": z, "y": z * (1.0 + 0.1 * rng.standard_normal(count))})


def scatter(law: Inputs, data: pd.DataFrame) -> Identification:
    return identify(
        lambda z, a: z * a, data, law, outcome="y", vectorized=True, density=Gaussian(),
        verification=Check(0), consistency=False, best_law=False,
    )  # fmt: skip


@pytest.mark.parametrize("times", [1.5, 25.0])
def test_the_answer_is_that_of_all_experiments(times: float, monkeypatch) -> None:
    """y = z a with a normal: mean and sd of y/z, whether or not a sample of 40 was searched."""
    settings = searching.SampledSearch(40, least=40, times=times)
    monkeypatch.setattr(searching.by_sample, "__defaults__", (settings,))
    data = table(300)
    found = scatter(Inputs({"a": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))}), data)
    ratio = data["y"] / data["z"]
    assert found.alpha["a.mean"].estimate == pytest.approx(ratio.mean(), abs=1e-5)
    assert found.alpha["a.sd"].estimate == pytest.approx(ratio.std(ddof=0), abs=1e-5)
    assert found.search["distinct_optima"] == 1
    assert found.sound


def test_experiments_of_many_observations_are_searched_by_fewer_of_them(monkeypatch) -> None:
    """y = a + error, 5 times for each of 60 experiments: the analysis of variance, balanced."""
    settings, sampled = searching.SampledSearch(least=10, observations=100), list[int]()
    monkeypatch.setattr(searching.by_sample, "__defaults__", (settings,))
    drawn = IndividualLikelihood.sampled

    def noted(likelihood: IndividualLikelihood, size: int) -> IndividualLikelihood:
        sampled.append(size)
        return drawn(likelihood, size)

    monkeypatch.setattr(IndividualLikelihood, "sampled", noted)
    rng = np.random.default_rng(8)
    y = 2.0 + 0.3 * rng.standard_normal((60, 1)) + 0.2 * rng.standard_normal((60, 5))
    data = pd.DataFrame({"id": np.repeat(np.arange(60), 5), "y": y.ravel()})
    law = Inputs({"a": Normal(mean=Free(0.5, 4.0), sd=Free(0.01, 2.0))})
    found = identify(
        lambda a: a, data, law, outcome="y", id="id", noise=Noise(Free(0.01, 2.0)),
        vectorized=True, verification=Check(0), consistency=False, best_law=False,
    )  # fmt: skip
    within, mean = y.var(axis=1).sum() / (60 * 4 / 5), y.mean(axis=1)
    assert sampled == [20]
    assert found.alpha["a.mean"].estimate == pytest.approx(mean.mean(), abs=1e-5)
    assert found.alpha["a.sd"].estimate == pytest.approx((mean.var() - within / 5) ** 0.5, abs=1e-5)
    assert found.alpha["noise.sd"].estimate == pytest.approx(within**0.5, abs=1e-5)


def test_the_ends_of_a_sample_that_become_one_optimum_are_one() -> None:
    """Three optima that a search of the sample claims: two near the maximum, one left out."""
    data = table(2500)
    small = scatter(Inputs({"a": Normal(mean=Free(0.5, 1.5), sd=Free(0.01, 0.5))}), data)
    problem = small.fit.likelihood.problem
    places = [np.array([1.003, 0.1]), np.array([0.99, 0.11]), np.array([1.4, 0.5])]

    def search(objective: Continued) -> SearchResult:
        assert objective(places[0]).each.size == searching.SAMPLE.size
        optima = tuple(Optimum(p, -float(k), 1) for k, p in enumerate(places))
        ascents = tuple(Ascent(p, p, -float(k), 9, True) for k, p in enumerate(places))
        return SearchResult(places[0], 0.0, ascents, optima)

    found = searching.by_sample(problem, search, searching.SampledSearch(best=2))
    assert len(found.optima) == 1
    assert len(found.ascents) == 2
    assert found.converged
    assert found.alpha == pytest.approx(small.fit.alpha, abs=1e-4)
    assert found.log_likelihood == pytest.approx(small.fit.scored().total, abs=1e-4)
