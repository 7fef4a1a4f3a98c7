"""The search: maxima known in closed form or by another method, limits, optima, cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import BINDING, GROWTH, REGRESSION, SAMPLE, SQUARE, Problem
from scipy import optimize, stats

from aleator import Free, Gaussian, GradientMultistart, Inputs, MaximumEntropy, Normal
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.moments.likelihood import Continued
from aleator.search import ascend
from aleator.search.interface import LogLikelihood
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
    found = GradientMultistart(5).maximize(problem.likelihood(y), problem.hyperparameters, seed=0)
    alpha, value = regression_by_simplex(problem.z, y)
    assert found.log_likelihood == pytest.approx(value, abs=1e-6)
    # within a thousandth of a standard error, which is about 0.05 here
    np.testing.assert_allclose(found.alpha, alpha, atol=1e-4)


def test_generalized_least_squares_holds_at_the_maximum() -> None:
    """Given the variances, the means of random coefficients are weighted least squares."""
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 50))
    y = problem.draw(3)
    found = GradientMultistart(4).maximize(
        problem.likelihood(y, Gaussian()), problem.hyperparameters, seed=0
    )
    variance = found.alpha[1] ** 2 + (found.alpha[3] * problem.z) ** 2
    design = np.stack([np.ones_like(y), problem.z], axis=1)
    weighted = design / variance[:, None]
    expected = np.linalg.solve(weighted.T @ design, weighted.T @ y)
    np.testing.assert_allclose(found.alpha[[0, 2]], expected, atol=1e-4)


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


@pytest.mark.parametrize(
    ("theta", "order"),
    [(3.0, 4), (3.0, 6), (6.0, 4), (6.0, 6)],
)
def test_an_outlier_does_not_lift_the_maximum_above_the_exact_one(theta, order) -> None:
    problem, y = lognormal_with_outlier(theta)
    found = GradientMultistart(3).maximize(
        problem.likelihood(y, MaximumEntropy(order)), problem.hyperparameters, seed=0
    )
    exact = stats.norm.logpdf(np.log(y), np.log(y).mean(), np.log(y).std()).sum() - np.log(y).sum()
    # a density of a few moments may exceed the true one by chance, by tenths for sixty outcomes
    assert found.log_likelihood < exact + 0.5


@pytest.mark.parametrize("order", [4, 6, 8])
def test_failed_solves_do_not_push_the_maximum_aside(order) -> None:
    """exp(z x) up to a kurtosis of 6, whose order 8 no density within 8 standard deviations has:
    the reach follows the moments."""
    problem = replace(GROWTH, z=np.linspace(0.5, 2.0, 60))
    y = problem.draw(1)
    found = GradientMultistart(2).maximize(
        problem.likelihood(y, MaximumEntropy(order)), problem.hyperparameters, seed=0
    )
    scaled = np.log(y) / problem.z
    # log y/z is normal: mean and sd, the latter known to 1/sqrt(120) of itself
    assert abs(found.alpha[0] - scaled.mean()) < 0.3 * scaled.std() / 60**0.5
    assert abs(found.alpha[1] - scaled.std()) < 0.3 * scaled.std() / 120**0.5


# ------------------------------------------------------------------------------ limits, cost


def test_limits_are_respected_and_a_maximum_beyond_ends_on_them() -> None:
    problem = replace(
        SAMPLE,
        z=np.zeros(20),
        inputs=Inputs({"x": Normal(mean=Free(-2.0, 0.5), sd=Free(0.05, 3.0))}),
    )
    y = problem.draw(5, np.array([1.0, 0.6]))
    objective = Counted(problem.likelihood(y))
    found = GradientMultistart(4).maximize(objective, problem.hyperparameters, seed=3)
    asked = np.array(objective.asked)
    assert asked[:, 0].min() >= -2.0
    assert asked[:, 0].max() <= 0.5
    assert asked[:, 1].min() >= 0.05
    assert asked[:, 1].max() <= 3.0
    assert found.alpha[0] == 0.5
    # given the mean on its limit, the variance is the mean square about it
    assert found.alpha[1] == pytest.approx(np.sqrt(np.mean((y - 0.5) ** 2)), abs=1e-4)


def test_fixed_hyperparameters_stay() -> None:
    slope = Normal(mean=Free(-5.0, 5.0), sd=0.3)
    problem = replace(REGRESSION, inputs=Inputs({**REGRESSION.inputs.laws, "b": slope}))
    objective = Counted(Continued(problem.likelihood(problem.draw(6))))
    GradientMultistart(2).maximize(objective, problem.hyperparameters, seed=0)
    assert np.all(np.array(objective.asked)[:, 3] == 0.3)


def test_nothing_to_search_is_one_evaluation() -> None:
    problem = replace(SAMPLE, inputs=Inputs({"x": Normal(mean=1.0, sd=0.6)}))
    y = problem.draw(7)
    found = GradientMultistart(5).maximize(problem.likelihood(y), problem.hyperparameters, seed=0)
    assert found.alpha.tolist() == [1.0, 0.6]
    assert found.evaluations == 1
    assert found.log_likelihood == pytest.approx(
        SAMPLE.log_density(found.alpha, problem.z, y).sum(), abs=1e-7
    )


@pytest.mark.parametrize("limit", [3, 8, 60])
def test_no_start_takes_more_evaluations_than_allowed(limit) -> None:
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 20))
    objective = Counted(problem.likelihood(problem.draw(8)))
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
    y = REGRESSION.draw(9)
    search = GradientMultistart(4)

    def found(seed: int):
        return search.maximize(REGRESSION.likelihood(y), REGRESSION.hyperparameters, seed=seed)

    one, two, other = found(1), found(1), found(2)
    for a, b in zip(one.ascents, two.ascents, strict=True):
        np.testing.assert_array_equal(a.alpha, b.alpha)
        np.testing.assert_array_equal(a.start, b.start)
    assert not np.array_equal(one.ascents[1].start, other.ascents[1].start)
    np.testing.assert_array_equal(one.ascents[0].start, other.ascents[0].start)


def test_guesses_are_starts() -> None:
    y = SAMPLE.draw(10)
    guess = np.array([0.25, 0.125])
    found = GradientMultistart(3).maximize(
        SAMPLE.likelihood(y), SAMPLE.hyperparameters, seed=0, guesses=[guess]
    )
    np.testing.assert_allclose(found.ascents[1].start, guess, rtol=1e-12)
    assert len(found.ascents) == 3


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
        problem.likelihood(problem.draw(12)), problem.hyperparameters, seed=0
    )
    assert found.optima[0].starts >= 6
    assert len(found.optima) <= 2


def test_an_improvement_goes_in_front() -> None:
    y = SAMPLE.draw(13)
    found = GradientMultistart(1).maximize(SAMPLE.likelihood(y), SAMPLE.hyperparameters, seed=0)
    alpha = np.array([0.1, 0.2])
    at = SAMPLE.likelihood(y)(alpha)
    better = found.improved(alpha, at, np.arange(2))
    assert better.log_likelihood == at.total
    assert better.optima[0].log_likelihood == better.log_likelihood
    assert better.optima[1:] == found.optima


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
