"""Standard errors and profile intervals against closed forms of the normal linear model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from problems import BINDING, REGRESSION, SAMPLE, Problem, raw_normal
from scipy import optimize, stats

from aleator import Constant, Free, Gaussian, GradientMultistart, Inputs, Normal
from aleator.core.types import Array
from aleator.inference.diagnostics import bound_warnings
from aleator.inference.identifiability import identifiability_warnings, weak_directions
from aleator.inference.information import Inference, infer, observed_information
from aleator.inference.profile import Profile, profile_intervals
from aleator.moments.likelihood import Likelihood
from aleator.search import SearchResult

DROP = 0.5 * stats.chi2.ppf(0.95, 1)


# y = b0 + b1 z with a normal b0: least squares, seen as an identification
LINE = Problem(
    "line: y = b1 z + b0, b0 normal",
    lambda z, b1, b0: b0 + b1 * z,
    Inputs({"b1": Constant(Free(-20.0, 20.0)), "b0": Normal(Free(-20.0, 20.0), Free(1e-3, 20.0))}),
    np.linspace(0.0, 4.0, 60),
    np.array([2.0, 1.0, 0.5]),
    lambda alpha, z, m: raw_normal(alpha[1] + alpha[0] * z, alpha[2], m),
    lambda alpha, z, y: stats.norm.logpdf(y, alpha[1] + alpha[0] * z, alpha[2]),
)


def maximized(problem: Problem, y: Array) -> tuple[Likelihood, SearchResult, Inference]:
    """The maximum, and what is inferred there."""
    likelihood = problem.likelihood(y, Gaussian())
    found = GradientMultistart(3).maximize(likelihood, problem.hyperparameters, seed=0)
    return likelihood, found, infer(likelihood, found.alpha, problem.hyperparameters)


def intervals(likelihood: Likelihood, found: SearchResult, inference: Inference) -> Array:
    profile = profile_intervals(likelihood, found.alpha, likelihood.hyperparameters, inference)
    assert profile.better is None
    return profile.intervals


# ------------------------------------------------------------------------------ standard errors


def test_errors_of_a_normal_sample_are_those_of_the_books() -> None:
    """sd/sqrt(N) of the mean, sd/sqrt(2 N) of the sd, and no correlation between them."""
    problem = replace(SAMPLE, z=np.zeros(50))
    y = problem.draw(1)
    _, found, inference = maximized(problem, y)
    sd = y.std()
    # differences of the score, in steps of a hundredth of a standard error, leave 1e-4
    np.testing.assert_allclose(inference.standard_error, [sd / 50**0.5, sd / 100**0.5], rtol=1e-3)
    assert abs(inference.correlation[0, 1]) < 1e-3
    np.testing.assert_allclose(np.diag(inference.correlation), 1.0, rtol=1e-14)
    half = stats.norm.ppf(0.975) * inference.standard_error
    np.testing.assert_allclose(inference.lower, found.alpha - half)
    np.testing.assert_allclose(inference.upper, found.alpha + half)
    assert inference.positive
    assert 0.0 <= inference.edm < 1e-6
    assert inference.at_bound == (None, None)


def test_errors_of_least_squares_are_those_of_the_books() -> None:
    y = LINE.draw(2)
    _, found, inference = maximized(LINE, y)
    design = np.stack([LINE.z, np.ones_like(y)], axis=1)
    coefficients, rss, *_ = np.linalg.lstsq(design, y)
    variance = float(rss[0]) / y.size
    np.testing.assert_allclose(found.alpha[:2], coefficients, atol=1e-4)
    assert found.alpha[2] == pytest.approx(variance**0.5, rel=1e-4)
    covariance = variance * np.linalg.inv(design.T @ design)
    np.testing.assert_allclose(inference.covariance[:2, :2], covariance, rtol=2e-3)
    assert inference.standard_error[2] == pytest.approx((variance / (2 * y.size)) ** 0.5, rel=2e-3)


def test_the_observed_information_is_the_second_derivative() -> None:
    """At a point that is no maximum, against differences of the exact log-density."""
    y = BINDING.draw(3)
    likelihood = BINDING.likelihood(y)
    alpha, free = BINDING.alpha, np.array([0, 1])
    scores = likelihood(alpha).scores
    found = observed_information(likelihood, alpha, BINDING.hyperparameters, free, scores)

    def total(*p: float) -> float:
        return float(BINDING.log_density(np.array(p), BINDING.z, y).sum())

    h, (m, s) = 1e-4, alpha
    second = np.array(
        [
            [
                total(m + h, s) - 2 * total(m, s) + total(m - h, s),
                0.25
                * (
                    total(m + h, s + h)
                    - total(m + h, s - h)
                    - total(m - h, s + h)
                    + total(m - h, s - h)
                ),
            ],
            [0.0, total(m, s + h) - 2 * total(m, s) + total(m, s - h)],
        ]
    )
    second[1, 0] = second[0, 1]
    np.testing.assert_allclose(found, -second / h**2, rtol=1e-3)


def test_the_sandwich_is_that_of_white_where_the_noise_is_not_the_same() -> None:
    """Least squares under heteroscedastic noise: (X'X)^-1 X' diag(r^2) X (X'X)^-1, exactly."""
    rng = np.random.default_rng(4)
    y = 1.0 + 2.0 * LINE.z + 0.2 * LINE.z**2 * rng.standard_normal(LINE.z.size)
    _, found, inference = maximized(LINE, y)
    design = np.stack([LINE.z, np.ones_like(y)], axis=1)
    residual = y - design @ found.alpha[:2]
    bread = np.linalg.inv(design.T @ design)
    white = bread @ (design.T * residual**2) @ design @ bread
    np.testing.assert_allclose(inference.sandwich_error[:2], np.sqrt(np.diag(white)), rtol=5e-3)
    assert inference.sandwich_error[0] > 1.2 * inference.standard_error[0]


def test_the_distance_to_the_maximum_is_told_away_from_it() -> None:
    """A quarter of a standard error off, the log-likelihood is 1/32 lower."""
    problem = replace(SAMPLE, z=np.zeros(400))
    y = problem.draw(7)
    likelihood, found, inference = maximized(problem, y)
    moved = found.alpha.copy()
    moved[0] += 0.25 * inference.standard_error[0]
    away = infer(likelihood, moved, problem.hyperparameters)
    assert away.edm == pytest.approx(1.0 / 32.0, rel=0.02)
    drop = found.log_likelihood - likelihood.evaluate(moved).total
    assert away.edm == pytest.approx(drop, rel=0.02)


# ------------------------------------------------------------------------------ profile intervals


def test_the_interval_of_a_known_mean_s_sd_is_the_exact_one() -> None:
    """One hyperparameter: N log(s) + S/(2 s^2) rises by 1.92 at both ends, not symmetric."""
    problem = replace(
        SAMPLE, z=np.zeros(8), inputs=Inputs({"x": Normal(mean=1.0, sd=Free(0.01, 10.0))})
    )
    y = problem.draw(8)
    likelihood, found, inference = maximized(problem, y)
    total = np.sum((y - 1.0) ** 2)
    best = (total / 8) ** 0.5

    def drop(s: float) -> float:
        return 8 * np.log(s / best) + 0.5 * total * (s**-2 - best**-2) - DROP

    exact = [optimize.brentq(drop, 0.2 * best, best), optimize.brentq(drop, best, 10.0 * best)]
    ends = intervals(likelihood, found, inference)
    assert np.all(np.isnan(ends[0]))
    # an end is taken when the root of twice the drop is within 0.02 of 1.96
    np.testing.assert_allclose(ends[1], exact, atol=0.05 * inference.standard_error[1])
    assert exact[1] - best > 2.0 * (best - exact[0])


def test_the_interval_of_a_mean_with_unknown_sd_is_the_exact_one() -> None:
    """The sd follows the mean: N/2 log(1 + (m - mean)^2/s^2) = 1.92."""
    problem = replace(SAMPLE, z=np.zeros(10))
    y = problem.draw(9)
    likelihood, found, inference = maximized(problem, y)
    half = y.std() * np.sqrt(np.expm1(2.0 * DROP / 10))
    ends = intervals(likelihood, found, inference)
    tolerance = 0.05 * inference.standard_error[0]
    np.testing.assert_allclose(ends[0], [y.mean() - half, y.mean() + half], atol=tolerance)
    assert half > 1.05 * stats.norm.ppf(0.975) * inference.standard_error[0]


def test_a_hyperparameter_on_its_limit_has_an_interval_and_no_error() -> None:
    """Outcomes that scatter the same at every z leave the slope without scatter of its own."""
    problem = replace(REGRESSION, z=np.repeat([-1.0, 0.0, 1.0], 15))
    rng = np.random.default_rng(11)
    # less scatter at the ends than in the middle: the variance of the slope wants to be negative
    scatter = np.where(problem.z == 0.0, 0.8, 0.4)
    y = 1.0 + 2.0 * problem.z + scatter * rng.standard_normal(45)
    likelihood, found, inference = maximized(problem, y)
    limit = problem.hyperparameters[3].lower
    assert found.alpha[3] == pytest.approx(limit, rel=1e-6)
    assert inference.at_bound == (None, None, None, "lower")
    assert np.isnan(inference.standard_error[3])
    assert np.isfinite(inference.standard_error[:3]).all()
    assert inference.positive
    assert inference.free.tolist() == [0, 1, 2]
    ends = intervals(likelihood, found, inference)
    assert ends[3, 0] == pytest.approx(limit)
    # at the other end the log-likelihood, the others following, has dropped by 1.92
    upper = ends[3, 1]
    assert limit < upper < 1.0

    def negative(p: Array) -> float:
        scale = np.hypot(np.exp(p[1]), upper * problem.z)
        return -float(stats.norm.logpdf(y, p[0] + p[2] * problem.z, scale).sum())

    there = optimize.minimize(
        negative, [1.0, -0.5, 2.0], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9}
    )
    # a root within 0.02 of 1.96 is a drop within 0.04
    assert found.log_likelihood + there.fun == pytest.approx(DROP, abs=0.05)


def test_an_interval_stops_at_a_limit() -> None:
    problem = replace(
        SAMPLE, z=np.zeros(5), inputs=Inputs({"x": Normal(mean=Free(0.9, 1.1), sd=Free(0.05, 3.0))})
    )
    y = np.array([0.2, 1.8, 1.0, 0.6, 1.4])
    likelihood, found, inference = maximized(problem, y)
    assert intervals(likelihood, found, inference)[0].tolist() == [0.9, 1.1]
    assert inference.lower[0] == 0.9
    assert inference.upper[0] == 1.1


def test_the_profile_tells_of_a_better_maximum() -> None:
    """Begun at a point that is no maximum, it must not report an interval about it."""
    problem = replace(SAMPLE, z=np.zeros(20))
    y = problem.draw(12)
    likelihood, found, inference = maximized(problem, y)
    start = found.alpha + np.array([1.2, 0.0]) * inference.standard_error[0]
    wrong = infer(likelihood, start, problem.hyperparameters)
    profile = profile_intervals(likelihood, start, problem.hyperparameters, wrong)
    assert likelihood(profile.better).total > likelihood(start).total + 0.01


# ------------------------------------------------------------------------------ weak directions


def test_a_sum_of_two_parameters_is_named() -> None:
    """y = a + b: neither the means nor the standard deviations can be told apart."""
    problem = replace(
        REGRESSION,
        z=np.ones(40),
        inputs=Inputs(
            {
                "a": Normal(mean=Free(-5.0, 5.0), sd=Free(0.05, 3.0)),
                "b": Normal(mean=Free(-5.0, 5.0), sd=Free(0.05, 3.0)),
            }
        ),
    )
    *_, inference = maximized(problem, problem.draw(13))
    assert not inference.positive
    assert np.isnan(inference.edm)
    weak = weak_directions(inference, problem.hyperparameters)
    (means,) = (w.message for w in weak if set(w.concerns) == {"a.mean", "b.mean"})
    # of opposite sign: one up, the other down
    assert "+ 0.71" in means
    assert "- 0.71" in means


def test_a_nearly_flat_direction_is_named_with_its_combination() -> None:
    problem = replace(LINE, z=10.0 + np.linspace(0.0, 1.0, 60))
    y = 1.0 + 2.0 * problem.z + 0.5 * np.random.default_rng(14).standard_normal(60)
    *_, inference = maximized(problem, y)
    assert inference.positive
    # the correlation of intercept and slope is -mean(z)/rms(z)
    expected = -problem.z.mean() / np.sqrt(np.mean(problem.z**2))
    assert inference.correlation[0, 1] == pytest.approx(expected, abs=2e-4)
    (weak,) = weak_directions(inference, problem.hyperparameters)
    assert sorted(weak.concerns) == ["b0.mean", "b1.value"]


@pytest.mark.parametrize(
    ("share", "told"), [((0.0, 1.0), True), ((0.0, 0.9), False), ((0.1, 1.0), False)]
)
def test_an_interval_from_limit_to_limit_is_told_with_what_goes_with_it(
    share: tuple[float, float], told: bool
) -> None:
    *_, inference = maximized(SAMPLE, SAMPLE.draw(13))
    k = int(inference.free[1])
    profile = Profile.unknown_ends(len(SAMPLE.hyperparameters))
    h = SAMPLE.hyperparameters[k]
    ends = [h.lower + part * (h.upper - h.lower) for part in share]
    profile.intervals[k], profile.drops[k] = ends, (0.01, 1.05)
    found = identifiability_warnings(inference, SAMPLE.hyperparameters, profile)
    assert [one.concerns for one in found] == [(h.name,)] * told
    assert all(SAMPLE.hyperparameters[inference.free[0]].name in one.message for one in found)
    (unknown,) = bound_warnings(SAMPLE.hyperparameters, inference, profile)
    assert (h.name in unknown.remedy) is told


def test_a_parameter_without_effect_is_named() -> None:
    problem = replace(
        SAMPLE,
        z=np.zeros(20),
        eta=lambda z, x, k: x + 0.0 * k + 0.0 * z,
        inputs=Inputs({**SAMPLE.inputs.laws, "k": Constant(Free(0.0, 1.0))}),
        alpha=np.array([1.0, 0.6, 0.5]),
    )
    *_, inference = maximized(problem, problem.draw(15))
    assert not inference.positive
    weak = weak_directions(inference, problem.hyperparameters)
    assert [w.concerns for w in weak] == [("k.value",)]
