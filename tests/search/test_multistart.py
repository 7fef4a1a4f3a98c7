"""Climbs from many starts: known maxima, where they begin, what they see of alpha, and optima."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from landscapes import CENTERS, Recorded, box, hills
from problems import BINDING, GROWTH, REGRESSION, SAMPLE, SQUARE, Problem
from scipy import optimize, stats

from aleator import By, Free, Gaussian, MaximumEntropy, Normal
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.inference.diagnostics import once_warnings
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.search import GradientMultistart, ascend
from aleator.search.interface import LogLikelihood, hills_of
from aleator.search.multistart import Reached, starting_points
from aleator.search.newton import ASCENT, ascended, on_limits, outer, positive
from aleator.search.objective import Coordinates


class Counted:
    """An objective that counts its calls and remembers where it was asked."""

    def __init__(self, objective) -> None:
        self.objective, self.asked = objective, []

    def __call__(self, alpha: Array) -> LogLikelihood:
        self.asked.append(alpha.copy())
        return self.objective(alpha)


def regression_by_simplex(z: Array, y: Array) -> tuple[Array, float]:
    """Random coefficients by Nelder-Mead on a likelihood written here, from three starts."""

    def negative(p: Array) -> float:
        scale = np.hypot(np.exp(p[1]), np.exp(p[3]) * z)
        return -float(stats.norm.logpdf(y, p[0] + p[2] * z, scale).sum())

    options = {"xatol": 1e-9, "fatol": 1e-11, "maxiter": 20_000, "maxfev": 20_000}
    starts = [np.array([0.0, s, 1.0, s]) for s in (-2.0, -1.0, 0.0)]
    ends = [optimize.minimize(negative, p, method="Nelder-Mead", options=options) for p in starts]
    best = min(ends, key=lambda end: end.fun)
    x = best.x.copy()
    x[[1, 3]] = np.exp(x[[1, 3]])
    return x, -float(best.fun)


# ------------------------------------------------------------------------------ the maximum


@pytest.mark.parametrize("density", [Gaussian(), MaximumEntropy(4)], ids=lambda d: d.name)
def test_the_maximum_of_a_normal_sample_is_its_mean_and_sd(density) -> None:
    problem = replace(SAMPLE, z=np.zeros(30))
    y = problem.draw(1)
    found = GradientMultistart(3).maximize(
        problem.likelihood(y, density), problem.hyperparameters, seed=0
    )
    # gtol 1e-4 in variables of unit information is 1e-4 standard errors, here 1e-5
    assert found.alpha == pytest.approx([y.mean(), y.std()], abs=1e-5)
    exact = stats.norm.logpdf(y, y.mean(), y.std()).sum()
    assert found.log_likelihood == pytest.approx(exact, abs=1e-7)
    assert found.converged
    assert len(found.optima) == 1


def test_the_maximum_of_random_coefficients_is_that_of_another_method() -> None:
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 80))
    y = problem.draw(2)
    found = GradientMultistart(5).maximize(
        problem.likelihood(y, Gaussian()), problem.hyperparameters, seed=0
    )
    alpha, value = regression_by_simplex(problem.z, y)
    assert found.log_likelihood == pytest.approx(value, abs=1e-6)
    # within a thousandth of a standard error, which is about 0.05 here
    np.testing.assert_allclose(found.alpha, alpha, atol=1e-4)


def test_the_maximum_on_a_binding_box_is_that_of_the_exact_likelihood() -> None:
    """On its own support the density is exact, so that the searches must agree."""
    problem = replace(BINDING, z=np.linspace(0.5, 2.0, 60))
    y = problem.draw(4)
    found = GradientMultistart(5).maximize(problem.likelihood(y), problem.hyperparameters, seed=0)

    def negative(p: Array) -> float:
        return -float(problem.log_density(np.array([p[0], np.exp(p[1])]), problem.z, y).sum())

    other = optimize.minimize(
        negative, [0.7, -1.0], method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-10}
    )
    assert found.log_likelihood == pytest.approx(-other.fun, abs=1e-5)
    assert found.alpha == pytest.approx([other.x[0], np.exp(other.x[1])], abs=1e-3)


# ------------------------------------------------------------------------------ not fooled


def lognormal_with_outlier(theta: float) -> tuple[Problem, Array]:
    """Sixty outcomes exp(x), one of them theta standard deviations of x above its mean."""
    inputs = Inputs({"x": Normal(mean=Free(-1.0, 2.0), sd=Free(0.02, 1.5))})
    problem = replace(GROWTH, z=np.ones(60), inputs=inputs, alpha=np.array([0.3, 0.3]))
    y = problem.draw(1)
    y[0] = np.exp(0.3 + 0.3 * theta)
    return problem, y


@pytest.mark.parametrize(("theta", "order"), [(3.0, 6), (6.0, 4)])
def test_an_outlier_does_not_lift_the_maximum_above_the_exact_one(theta, order) -> None:
    problem, y = lognormal_with_outlier(theta)
    found = GradientMultistart(3).maximize(
        problem.likelihood(y, MaximumEntropy(order)), problem.hyperparameters, seed=0
    )
    exact = stats.norm.logpdf(np.log(y), np.log(y).mean(), np.log(y).std()).sum() - np.log(y).sum()
    # a density of a few moments may exceed the true one by chance, by tenths for sixty outcomes
    assert found.log_likelihood < exact + 0.5


@pytest.mark.parametrize("order", [4, 8])
def test_failed_solves_do_not_push_the_maximum_aside(order) -> None:
    """exp(z x) up to a kurtosis of 6, whose order 8 no density within 8 standard deviations has:
    the reach follows the moments."""
    problem = replace(GROWTH, z=np.linspace(0.5, 2.0, 60))
    y = problem.draw(1)
    found = GradientMultistart(1).maximize(
        problem.likelihood(y, MaximumEntropy(order)), problem.hyperparameters, seed=0
    )
    scaled = np.log(y) / problem.z
    # log y/z is normal: mean and sd, the latter known to 1/sqrt(120) of itself
    assert abs(found.alpha[0] - scaled.mean()) < 0.3 * scaled.std() / 60**0.5
    assert abs(found.alpha[1] - scaled.std()) < 0.3 * scaled.std() / 120**0.5


# ------------------------------------------------------------------------------ limits, cost


@pytest.mark.parametrize("limit", [3, 8, 60])
def test_no_start_takes_more_evaluations_than_allowed(limit) -> None:
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 20))
    objective = Counted(problem.likelihood(problem.draw(8), Gaussian()))
    found = GradientMultistart(4, evaluations=limit).maximize(
        objective, problem.hyperparameters, seed=0
    )
    assert all(ascent.evaluations <= limit for ascent in found.ascents)
    # what the starts report is what was asked; one more for each distinct optimum, and one for each
    # time that was seen whether a second start came to the best
    beside = len(objective.asked) - found.evaluations - len(found.optima)
    assert 0 <= beside <= len(found.ascents) - 4 + 2
    if limit == 3:
        assert not found.converged


def test_the_same_seed_finds_the_same_and_another_seed_starts_elsewhere() -> None:
    likelihood = REGRESSION.likelihood(REGRESSION.draw(9), Gaussian())
    search = GradientMultistart(4)

    def found(seed: int):
        return search.maximize(likelihood, REGRESSION.hyperparameters, seed=seed)

    one, two, other = found(1), found(1), found(2)
    for a, b in zip(one.ascents, two.ascents, strict=True):
        np.testing.assert_array_equal(a.alpha, b.alpha)
        np.testing.assert_array_equal(a.start, b.start)
    assert not np.array_equal(one.ascents[1].start, other.ascents[1].start)
    np.testing.assert_array_equal(one.ascents[0].start, other.ascents[0].start)


# ------------------------------------------------------------------------------ several optima


def test_two_optima_of_equal_height_are_counted_as_two() -> None:
    """y = x^2 does not tell the sign of the mean."""
    problem = replace(SQUARE, z=np.zeros(40))
    y = problem.draw(11)
    found = GradientMultistart(10).maximize(problem.likelihood(y), problem.hyperparameters, seed=0)
    best = found.optima[0]
    mirrored = [
        o for o in found.optima if abs(o.alpha[0] + best.alpha[0]) < 1e-3 * abs(best.alpha[0])
    ]
    assert len(mirrored) == 1
    assert mirrored[0].log_likelihood == pytest.approx(best.log_likelihood, abs=1e-5)
    assert sum(o.starts for o in found.optima) == 10
    values = [o.log_likelihood for o in found.optima]
    assert values == sorted(values, reverse=True)


def test_ends_of_the_same_optimum_are_one() -> None:
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 40))
    found = GradientMultistart(8).maximize(
        problem.likelihood(problem.draw(12), Gaussian()), problem.hyperparameters, seed=0
    )
    assert found.optima[0].starts >= 6
    assert len(found.optima) <= 2


def test_an_improvement_goes_in_front() -> None:
    y = SAMPLE.draw(13)
    found = GradientMultistart(1).maximize(SAMPLE.likelihood(y), SAMPLE.hyperparameters, seed=0)
    alpha = np.array([0.1, 0.2])
    at = SAMPLE.likelihood(y)(alpha)
    better = found.improved(alpha, at.total)
    assert better.log_likelihood == at.total
    assert better.optima[0].log_likelihood == better.log_likelihood
    assert better.optima[1:] == found.optima


def test_an_improvement_beside_the_ends_of_starts_is_met_by_them_and_one_far_away_once() -> None:
    problem = replace(SAMPLE, z=np.zeros(30))
    likelihood = problem.likelihood(problem.draw(13), Gaussian())
    found = GradientMultistart(4).maximize(likelihood, problem.hyperparameters, seed=0)
    for away, once in ((1e-3, False), (2.0, True)):
        alpha = found.alpha + np.array([away, 0.0])
        at = likelihood(alpha)
        better = found.improved(alpha, max(at.total, found.log_likelihood + 1.0))
        met = hills_of(better, at.scores, np.arange(2))
        assert bool(once_warnings(better, met)) is once
        assert (met[0].starts < 2) is once


def test_an_optimum_that_moves_takes_the_starts_that_led_to_it_along() -> None:
    y = SAMPLE.draw(13)
    found = GradientMultistart(4).maximize(SAMPLE.likelihood(y), SAMPLE.hyperparameters, seed=0)
    moved = found.moved(np.array([0.1, 0.2]), found.log_likelihood - 3.0)
    assert moved.converged
    assert moved.optima[0].starts == found.optima[0].starts
    assert {tuple(a.alpha) for a in moved.ascents} == {(0.1, 0.2)}


# ------------------------------------------------------------------------------ parts


@given(
    u=st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2),
    score=st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3),
)
def test_coordinates_go_there_and_back(u, score) -> None:
    coordinates = Coordinates(
        [
            Hyperparameter("a", -2.0, 6.0, 1.0, free=True),
            Hyperparameter("b", 3.0, 3.0, 3.0, free=False),
            Hyperparameter("c", 0.01, 10.0, 0.5, free=True, log=True),
        ]
    )
    alpha = coordinates.to_alpha(np.array(u))
    assert alpha[1] == 3.0
    np.testing.assert_allclose(coordinates.to_unit(alpha), u, atol=1e-12)
    # d alpha/du: the width, times alpha where the scale is logarithmic
    expected = np.array([score[0] * 8.0, score[2] * alpha[2] * np.log(1000.0)])
    found = coordinates.gradient(alpha, np.array(score))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-300)


def quadratic(alpha: Array) -> LogLikelihood:
    """log L = -0.5 (a - c)' H (a - c) with a known maximum c."""
    hessian = np.array([[4.0, 1.5], [1.5, 1.0]])
    gap = alpha - np.array([0.3, -0.2])
    return LogLikelihood(
        np.array([-0.5 * gap @ hessian @ gap]), -(hessian @ gap)[None, :], np.zeros(1, dtype=int)
    )


def test_ascend_reaches_a_quadratic_maximum_in_one_step_of_the_right_information() -> None:
    objective = Counted(quadratic)
    limits = [Hyperparameter(n, -1.0, 1.0, 0.0, free=True) for n in "ab"]
    moving = np.array([0, 1])
    alpha, value = ascend(
        objective, np.array([0.9, 0.9]), limits, moving, np.array([[4.0, 1.5], [1.5, 1.0]])
    )
    np.testing.assert_allclose(alpha, [0.3, -0.2], atol=1e-12)
    assert value == pytest.approx(0.0, abs=1e-20)
    assert len(objective.asked) == 2
    # with the wrong information it takes more, and still arrives
    alpha, value = ascend(quadratic, np.array([0.9, 0.9]), limits, moving, np.eye(2))
    assert value > -1e-5


def test_ascend_keeps_limits_and_what_does_not_move() -> None:
    limits = [
        Hyperparameter("a", -1.0, 0.1, 0.0, free=True),
        Hyperparameter("b", -1.0, 1.0, 0.0, free=True),
    ]
    both = np.array([0, 1])
    alpha, _ = ascend(quadratic, np.array([0.0, 0.0]), limits, both, np.eye(2))
    # on a = 0.1 the maximum over b is -0.2 + 1.5 * 0.2
    assert alpha == pytest.approx([0.1, 0.1], abs=0.01)
    alpha, _ = ascend(quadratic, np.array([0.0, 0.7]), limits, np.array([0]), np.eye(1))
    assert alpha[1] == 0.7
    assert alpha[0] == pytest.approx(0.3 - 1.5 * 0.9 / 4.0, abs=0.01)


def test_ascend_never_returns_less_than_it_was_given() -> None:
    limits = [Hyperparameter(n, -1.0, 1.0, 0.0, free=True) for n in "ab"]
    start = np.array([0.3, -0.2])
    alpha, value = ascend(quadratic, start, limits, np.array([0, 1]), 1e-6 * np.eye(2))
    np.testing.assert_array_equal(alpha, start)
    assert value == 0.0


@pytest.mark.parametrize(("starts", "evaluations"), [(0, 60), (5, 0)])
def test_misuse_has_a_remedy(starts, evaluations) -> None:
    with pytest.raises(InputsError) as caught:
        GradientMultistart(starts, evaluations)
    assert caught.value.remedy


# ---------------------------------------------------------------------- where climbs begin


LOW, HIGH = -2.0, 6.0
LIMITS = [
    Hyperparameter("a", LOW, HIGH, 1.0, free=True),
    Hyperparameter("known", 3.0, 3.0, 3.0, free=False),
    Hyperparameter("c", 0.01, 10.0, 0.5, free=True, log=True),
]


def test_own_start_and_guesses_come_first_and_points_fill_the_limits() -> None:
    guess = np.array([7.0, 3.0, 0.2])
    points = starting_points(Coordinates(LIMITS), [guess], 18, seed=0)
    assert points.shape == (18, 3)
    np.testing.assert_array_equal(points[0], [1.0, 3.0, 0.5])
    # a guess beyond a limit starts on it
    np.testing.assert_array_equal(points[1], [HIGH, 3.0, 0.2])
    unit = (points[2:, 0] - LOW) / (HIGH - LOW)
    # a twentieth away from either limit
    assert np.histogram(unit, bins=4, range=(0.05, 0.95))[0].tolist() == [4, 4, 4, 4]


def test_fewer_points_than_are_known_are_the_first_of_them() -> None:
    guesses = [np.array([float(k), 3.0, 0.2]) for k in range(3)]
    points = starting_points(Coordinates(LIMITS), guesses, 2, seed=0)
    np.testing.assert_array_equal(points, [[1.0, 3.0, 0.5], guesses[0]])


def test_in_wide_limits_points_lie_around_the_guesses_at_distances_of_every_size() -> None:
    wide = [Hyperparameter("b", -1e12, 1e12, 0.0, free=True), LIMITS[2]]
    guess = np.array([3.0, 0.2])
    points = starting_points(Coordinates(wide), [guess], 66, seed=0)[2:]
    distance = np.abs(points[:, 0] - 3.0)
    # from a hundredth of the guess to the limits are 14 decades, of which the starts fill 12
    decades = np.histogram(np.log10(distance), bins=[-2, 1, 4, 7, 10])[0]
    assert np.all(decades >= 10)
    assert 20 <= np.sum(points[:, 0] < 3.0) <= 44
    # without a guess there is nothing to lie around
    even = starting_points(Coordinates(wide), [], 65, seed=0)[1:]
    assert np.median(np.abs(even[:, 0])) > 1e11


@settings(max_examples=30, deadline=None)
@given(
    width=st.floats(1e-3, 1e200),
    guess=st.floats(-1e6, 1e6),
    count=st.integers(1, 20),
    seed=st.integers(0, 3),
)
def test_every_start_is_finite_and_within_the_limits(width, guess, count, seed) -> None:
    limits = [Hyperparameter("b", -width, 2.0 * width, 0.0, free=True)]
    points = starting_points(Coordinates(limits), [np.array([guess])], count, seed)
    assert points.shape == (count, 1)
    assert np.all((points >= -width) & (points <= 2.0 * width))


# ---------------------------------------------------------------------- what a search sees of alpha


TABLE = pd.DataFrame({"kelvin": 300.0 + np.array([-10.0, -6.0, -1.0, 2.0, 5.0, 8.0])})
REGRESSED = Inputs({"k": Normal(By("1 + kelvin", 2.0, 12.0), Free(0.0, 4.0))}).resolved(TABLE)


def slopes(coordinates: Coordinates, u: Array) -> Array:
    """d alpha/du (K, F) by differences."""
    h = 1e-6 * np.eye(u.size)
    ends = [[coordinates.to_alpha(u + sign * step) for step in h] for sign in (1.0, -1.0)]
    return ((np.array(ends[0]) - np.array(ends[1])) / 2e-6).T


@pytest.mark.parametrize("u", [(0.5, 0.5, 0.5), (0.2, 0.6, 0.05), (0.9, 0.3, 0.99)])
def test_coordinates_go_there_and_back_and_scores_with_them(u: tuple[float, ...]) -> None:
    coordinates, at = Coordinates(REGRESSED.hyperparameters), np.array(u)
    alpha = coordinates.to_alpha(at)
    np.testing.assert_allclose(coordinates.to_unit(alpha), at, atol=1e-10)
    score = np.array([0.3, -200.0, 5.0])
    expected = score @ slopes(coordinates, at)
    np.testing.assert_allclose(coordinates.gradient(alpha, score), expected, rtol=1e-6)


def test_the_first_coordinate_is_the_value_at_the_mean_of_the_covariate() -> None:
    coordinates = Coordinates(REGRESSED.hyperparameters)
    middle = TABLE["kelvin"].mean()
    for slope in (0.1, 0.5, 0.9):
        intercept, by_kelvin, _ = coordinates.to_alpha(np.array([0.25, slope, 0.5]))
        assert intercept + by_kelvin * middle == pytest.approx(2.0 + 0.25 * 10.0)


def test_a_known_coefficient_stands_beside_as_well() -> None:
    law = Normal(By("1 + kelvin", 2.0, 12.0, terms={"kelvin": 0.1}), 1.0)
    coordinates = Coordinates(Inputs({"k": law}).resolved(TABLE).hyperparameters)
    alpha = coordinates.to_alpha(np.array([0.5]))
    assert alpha[0] + 0.1 * TABLE["kelvin"].mean() == pytest.approx(7.0)


def normal(y: Array, mean: Array, variance: Array, dmean: Array, dvariance: Array) -> LogLikelihood:
    """Normal log-likelihoods (N,) with scores by the derivatives (N, K) of mean and variance."""
    gap = y - mean
    value = -0.5 * np.log(2.0 * np.pi * variance) - 0.5 * gap**2 / variance
    by_variance = 0.5 * (gap**2 / variance - 1.0) / variance
    scores = (gap / variance)[:, None] * dmean + by_variance[:, None] * dvariance
    return LogLikelihood(value, scores, np.zeros(y.size, dtype=int))


@pytest.mark.parametrize("between", [0.0, 0.02, 0.3])
@pytest.mark.parametrize("start", [None, 3.9, 1e-4])
def test_a_scale_of_zero_and_one_next_to_zero_are_found(
    between: float, start: float | None
) -> None:
    # means of groups with a known error: mean and sd have closed forms
    error, y = 0.5, np.array([-1.0, 0.0, 1.0, 0.0])
    y = y / y.std() * np.hypot(error, between) if between else 0.7 * error * y / y.std()
    law = Normal(Free(-3.0, 5.0), Free(0.0, 4.0, start=start))

    def likelihood(alpha: Array) -> LogLikelihood:
        one, none = np.ones(y.size), np.zeros(y.size)
        by = np.stack([one, none], axis=1), np.stack([none, 2.0 * alpha[1] * one], axis=1)
        return normal(y, alpha[0] * one, (error**2 + alpha[1] ** 2) * one, *by)

    found = GradientMultistart(1).maximize(likelihood, Inputs({"b": law}).hyperparameters, seed=0)
    best = likelihood(np.array([0.0, between])).total
    assert found.log_likelihood == pytest.approx(best, abs=1e-4)
    # the log-likelihood hardly tells such an sd from zero
    assert found.alpha[1] == pytest.approx(between, abs=0.03)


def test_a_line_far_from_zero_is_found_from_any_start() -> None:
    t = TABLE["kelvin"].to_numpy()
    y = 4.0 + 0.2 * (t - 290.0) + 0.3 * np.array([1.0, -1.0, 0.5, -0.5, 1.0, -1.0])
    columns = np.stack([np.ones(t.size), t], axis=1)
    beta, squares, *_ = np.linalg.lstsq(columns, y)
    sd = np.sqrt(squares[0] / t.size)

    def likelihood(alpha: Array) -> LogLikelihood:
        by_mean = np.column_stack([columns, np.zeros(t.size)])
        by_variance = np.outer(np.ones(t.size), [0.0, 0.0, 2.0 * alpha[2]])
        return normal(y, columns @ alpha[:2], np.full(t.size, alpha[2] ** 2), by_mean, by_variance)

    search = GradientMultistart(6)
    found = search.maximize(likelihood, REGRESSED.hyperparameters, seed=1)
    best = likelihood(np.array([*beta, sd])).total
    assert found.log_likelihood == pytest.approx(best, abs=1e-6)
    np.testing.assert_allclose(found.alpha, [*beta, sd], rtol=1e-3)
    # each start gets there, as it would with a centered covariate
    assert all(end.log_likelihood > best - 1e-3 for end in found.ascents)


# ---------------------------------------------------------------------- climbs that join


OBSERVED = np.array([[-0.4, 0.1], [0.9, -1.2], [0.3, 0.8], [-0.6, 0.2], [0.1, -0.3]])
"""Observations of experiments, whose mean is the maximum."""


def sample(alpha: Array) -> LogLikelihood:
    """Five experiments about a normal law of sd one: a paraboloid."""
    away = OBSERVED - alpha
    return LogLikelihood(-0.5 * np.sum(away**2, axis=1), away, np.zeros(len(away), dtype=int))


def two_hills(alpha: Array) -> LogLikelihood:
    """The first two hills as a sum over forty experiments, whose scores scatter."""
    found = hills(alpha)
    scatter = 0.3 * np.sin(np.arange(40.0)[:, None] * [1.0, 2.3])
    scatter -= scatter.mean(axis=0)
    each = np.full(40, found.total / 40.0)
    return LogLikelihood(each, found.score / 40.0 + scatter, np.zeros(40, dtype=int))


class Guided(Recorded):
    """An objective whose own way leads half of the rest to a goal, in limits or not."""

    def __init__(self, function, goal: Array) -> None:
        super().__init__(function)
        self.goal, self.steps = goal, 0

    def expectation_step(self, alpha: Array) -> tuple[float, Array]:
        self.steps += 1
        return self.function(alpha).total, 0.5 * (alpha + self.goal)


def test_a_way_that_leads_to_the_maximum_is_gone():
    wanted = OBSERVED.mean(axis=0)
    guided = Guided(lambda alpha: scaled(alpha, 1e4), wanted)
    found = GradientMultistart(1).maximize(guided, box(), seed=0)
    assert found.alpha == pytest.approx(wanted, abs=1e-4)
    assert guided.steps == found.evaluations - guided.scored + 1
    # nearly all of the way was gone before the first score was asked for
    assert np.max(np.abs(guided.asked[0] - wanted)) < 0.02


def scaled(alpha: Array, factor: float) -> LogLikelihood:
    found = sample(alpha)
    assert found.scores is not None
    return LogLikelihood(factor * found.each, factor * found.scores, found.status)


@pytest.mark.parametrize("goal", [np.array([-4.0, 4.0]), np.array([50.0, 50.0])])
def test_a_way_that_leads_elsewhere_does_no_harm(goal):
    guided = Guided(sample, goal)
    found = GradientMultistart(3).maximize(guided, box(), seed=0)
    assert found.alpha == pytest.approx(OBSERVED.mean(axis=0), abs=1e-4)
    assert found.converged
    assert np.all(np.abs(guided.asked) <= 5.0)


@pytest.mark.parametrize("limit", [2, 5, 12])
def test_own_steps_count_among_the_evaluations_of_a_start(limit):
    found = GradientMultistart(4, evaluations=limit).maximize(
        Guided(sample, OBSERVED.mean(axis=0) + 0.3), box(), seed=0
    )
    assert all(ascent.evaluations <= limit for ascent in found.ascents)


def test_starts_that_join_another_are_counted_at_its_optimum_and_cost_less():
    """Along a ridge that is curved in most experiments the way is long."""

    def curved(alpha: Array) -> LogLikelihood:
        a, b = alpha[0], alpha[1] - 0.3 * alpha[0] ** 2
        found = scaled(np.array([a, b]), 50.0)
        assert found.scores is not None
        by_a = found.scores[:, 0] - 0.6 * a * found.scores[:, 1]
        return LogLikelihood(found.each, np.stack([by_a, found.scores[:, 1]], axis=1), found.status)

    found = GradientMultistart(8).maximize(curved, box(), seed=0)
    assert [optimum.starts for optimum in found.optima] == [8]
    assert all(ascent.converged for ascent in found.ascents)
    ends = {tuple(ascent.alpha) for ascent in found.ascents}
    assert len(ends) == 1
    alone = sum(
        GradientMultistart(1).maximize(curved, started(ascent.start), seed=0).evaluations
        for ascent in found.ascents
    )
    assert found.evaluations < alone - 7


def started(start: Array) -> list[Hyperparameter]:
    return [replace(h, start=float(at)) for h, at in zip(box(), start, strict=True)]


def test_no_optimum_is_lost_by_joining():
    found = GradientMultistart(10).maximize(two_hills, box(), seed=0)
    ends = np.array([optimum.alpha for optimum in found.optima])
    for center in CENTERS[:2]:
        assert np.min(np.linalg.norm(ends - center, axis=1)) < 1e-2
    assert sum(optimum.starts for optimum in found.optima) == 10


def reached(alpha: Array, at: LogLikelihood) -> Reached:
    return Reached(alpha, at, np.arange(2))


def test_a_climb_joins_what_is_near_if_its_slope_leads_there():
    top = OBSERVED.mean(axis=0)
    there, near = reached(top, sample(top)), top + np.array([0.15, -0.1])
    at = sample(near)
    assert there.joins(near, at)
    assert not there.joins(top + 2.0, sample(top + 2.0))
    assert at.scores is not None
    assert not there.joins(near, LogLikelihood(at.each, -at.scores, at.status))
    assert not there.joins(near, LogLikelihood(at.each + 0.1, at.scores, at.status))


@pytest.mark.parametrize(
    "scores",
    [
        [[1.0, 0.0], [-1.0, 0.0], [0.5, 0.0]],
        [[1.0, 2.0], [-1.0, -2.0], [0.5, 1.0]],
        [[1.0, 0.3], [-1.0, -0.3]],
    ],
)
def test_scores_that_tell_no_distance_join_nothing(scores):
    flat = LogLikelihood(np.zeros(len(scores)), np.array(scores), np.zeros(len(scores), dtype=int))
    assert not reached(np.zeros(2), flat).joins(np.zeros(2), flat)


# ---------------------------------------------------------------------- how far a step may go


class Near:
    """-(a - 10)^2/2, whose steps go no farther than one."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def __call__(self, alpha: Array) -> LogLikelihood:
        self.asked.append(float(alpha[0]))
        away = alpha - 10.0
        return LogLikelihood(-0.5 * away**2, -away[None], np.zeros(1, dtype=np.int64))

    def values(self, alphas: Array) -> Array:
        return np.array([self(alpha).total for alpha in alphas])

    def reach(self, alpha: Array, ahead: Array) -> float:
        return float(min(1.0, 1.0 / np.abs(ahead - alpha).max()))


def test_an_ascent_arrives_by_steps_no_longer_than_they_may_be() -> None:
    """But where little is left to gain: the last ones are as long as the curvature says."""
    objective, limits = Near(), [Hyperparameter("a", -20.0, 20.0, 0.0, free=True)]
    end = ascended(objective, np.zeros(1), limits, np.array([0]), np.eye(1))
    np.testing.assert_allclose(end.alpha, 10.0)
    assert np.abs(np.diff(objective.asked)).max() <= np.sqrt(2.0 * ASCENT.believed) + 1e-12


def test_what_stays_on_a_limit_is_on_it_and_would_leave() -> None:
    point = np.array([0.0, 0.0, 0.5, 0.5, 1.0, 1.0, 0.0, 1.0])
    score = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 0.0, 0.0])
    stays = on_limits(point, score, np.zeros(8), np.ones(8))
    assert np.flatnonzero(stays).tolist() == [0, 5]


def test_information_is_made_positive_and_is_left_where_it_is() -> None:
    sound = np.array([[4.0, 1.0], [1.0, 9.0]])
    np.testing.assert_allclose(positive(sound), sound, rtol=1e-14)
    found = positive(np.array([[4.0, 12.0], [12.0, 9.0]]))  # 2 in units of its diagonal
    units = found / np.outer([2.0, 3.0], [2.0, 3.0])
    np.testing.assert_allclose(np.linalg.eigvalsh(units), [ASCENT.curvature, 3.0])
    scores = np.array([[2.0, 0.5], [0.0, np.nan], [1.0, 3.0]])
    np.testing.assert_allclose(outer(scores), [[5.0, 4.0], [4.0, 9.25]], rtol=1e-14)
