"""The log-likelihood: closed forms, its exact score, and that nothing fools it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import BINDING, GROWTH, PROBLEMS, REGRESSION, SAMPLE, SQUARE, collocated, title

from aleator import Gaussian, MaximumEntropy
from aleator.core.status import Status
from aleator.core.types import Array
from aleator.moments.densities import Density
from aleator.moments.entropy_solver import SETTINGS
from aleator.moments.likelihood import Continued, Likelihood
from aleator.search.interface import LogLikelihood
from aleator.simulators.response_functions import DirectResponse

DENSITIES = [Gaussian(), *(MaximumEntropy(order) for order in (3, 4, 6))]


def name(density: Density) -> str:
    return density.name


def score_by_differences(likelihood: Likelihood, alpha: Array, free: Array) -> Array:
    """d log f_l/d alpha (N, F) by differences of fourth order of the searched value."""
    columns = []
    for k in free:
        h = 2e-4 * (alpha[k] if likelihood.hyperparameters[k].log else 1.0)
        ends = []
        for s in (-2, -1, 1, 2):
            moved = alpha.copy()
            moved[k] += s * h
            ends.append(Continued(likelihood)(moved).each)
        columns.append((8.0 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / (12.0 * h))
    return np.stack(columns, axis=1)


# ------------------------------------------------------------------------------ closed forms


@pytest.mark.parametrize("density", DENSITIES, ids=name)
@pytest.mark.parametrize("problem", [SAMPLE, REGRESSION], ids=title)
def test_a_linear_gaussian_problem_has_its_closed_form(problem, density) -> None:
    """Every density is the normal one here; the bounded support cuts off 1e-15."""
    y = problem.draw(1)
    found = problem.likelihood(y, density).evaluate(problem.alpha)
    truth = problem.log_density(problem.alpha, problem.z, y)
    np.testing.assert_allclose(found.each, truth, atol=1e-8)
    assert found.total == pytest.approx(truth.sum(), abs=1e-7)


@pytest.mark.parametrize("order", [2, 3, 4, 6])
def test_a_truncated_normal_outcome_has_its_closed_form(order) -> None:
    """On its own support the truncated normal law is of largest entropy for two moments."""
    y = BINDING.draw(2)
    found = BINDING.likelihood(y, MaximumEntropy(order)).evaluate(BINDING.alpha)
    truth = BINDING.log_density(BINDING.alpha, BINDING.z, y)
    np.testing.assert_allclose(found.each, truth, atol=1e-7)


@pytest.mark.parametrize("problem", [GROWTH, SQUARE], ids=title)
def test_more_moments_come_closer_to_the_exact_log_density(problem) -> None:
    """Root mean square error of the log-density under the law itself, by 400 draws."""
    many = replace(problem, z=np.repeat(problem.z[1:3], 200))
    y = many.draw(3)
    truth = many.log_density(many.alpha, many.z, y)
    errors = []
    for order in (2, 4, 6):
        found = many.likelihood(y, MaximumEntropy(order)).evaluate(many.alpha)
        assert np.all(found.status == Status.SOLVED)
        errors.append(float(np.sqrt(np.mean((found.each - truth) ** 2))))
    assert errors[2] < errors[1] < 0.7 * errors[0]
    # in likelihood what counts is the mean, the Kullback-Leibler distance
    assert errors[1] < 0.2


# ------------------------------------------------------------------------------ the score


@pytest.mark.parametrize("density", DENSITIES, ids=name)
@pytest.mark.parametrize("problem", PROBLEMS, ids=title)
def test_the_score_is_that_of_differences(problem, density) -> None:
    """Seven outcomes of the law, at an alpha that is not a maximum."""
    y = problem.draw(5)
    likelihood = problem.likelihood(y, density)
    found = likelihood(problem.alpha)
    assert np.all(found.status == Status.SOLVED)
    expected = score_by_differences(likelihood, problem.alpha, problem.free)
    scores = found.scores[:, problem.free]
    scale = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(scores / scale, expected / scale, atol=1e-6)
    np.testing.assert_allclose(found.score[problem.free], scores.sum(axis=0), rtol=1e-12)


@pytest.mark.parametrize("degree", [None, 4], ids=["quadrature", "expansion"])
@pytest.mark.parametrize("problem", [GROWTH, BINDING], ids=title)
def test_the_score_through_collocation_is_that_of_differences(problem, degree) -> None:
    """Five nodes of the simulator itself, whose slope is a central difference."""
    y = problem.draw(7)
    exact = problem.likelihood(y, nodes=5, degree=degree)
    response = DirectResponse(problem.run, problem.z.size, problem.inputs.box)
    way = collocated(problem.inputs, response, 5, degree)
    likelihood = replace(exact, predictive=replace(exact.predictive, propagation=way))
    found = likelihood(problem.alpha)
    expected = score_by_differences(likelihood, problem.alpha, problem.free)
    scale = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(found.scores[:, problem.free] / scale, expected / scale, atol=2e-6)


# ------------------------------------------------------------------------------ invariance


# ------------------------------------------------------------------------------ honesty


def assert_never_above(found: LogLikelihood, honest: LogLikelihood, edge: Array) -> None:
    """The searched value is the honest one, or below what the density has anywhere near."""
    solved = found.status == Status.SOLVED
    np.testing.assert_allclose(found.each[solved], honest.each[solved], rtol=1e-8, atol=1e-8)
    outside = found.status == Status.OUTSIDE_SUPPORT
    assert np.all(found.each[outside] <= edge[outside] + 1e-9)
    assert np.all(honest.each[outside] == -np.inf)
    failed = ~solved & ~outside
    finite = failed & np.isfinite(honest.each)
    assert np.all(found.each[finite] <= honest.each[finite] - SETTINGS.penalty + 1e-9)
    assert np.all(found.each[failed & ~finite] <= np.maximum(edge, 0.0)[failed & ~finite])


@given(
    mean=st.floats(-0.5, 1.5),
    sd=st.floats(-2.0, 0.0),
    y=st.lists(st.floats(-0.5, 2.5), min_size=7, max_size=7),
    order=st.sampled_from([3, 4, 6]),
)
def test_the_search_never_sees_more_than_the_honest_density(mean, sd, y, order) -> None:
    alpha, outcomes = np.array([mean, 10.0**sd]), np.array(y)
    likelihood = BINDING.likelihood(outcomes, MaximumEntropy(order))
    found, honest = Continued(likelihood)(alpha), likelihood.evaluate(alpha)
    assert np.isfinite(found.each).all()
    assert np.isfinite(found.scores).all()
    fitted = likelihood.predictive.under(alpha).fitted
    inside = np.clip(outcomes, *fitted.quantile([0.0, 1.0]).T)
    assert_never_above(found, honest, fitted.log_pdf(inside))


@pytest.mark.parametrize("order", [2, 3, 4, 6])
def test_a_tiny_sd_is_punished_without_limit(order) -> None:
    """One outcome off the mean: the value falls as sd shrinks, in both kinds."""
    y = SAMPLE.alpha[0] + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    likelihood = SAMPLE.likelihood(y, MaximumEntropy(order))
    sds = np.array([0.05, 1e-2, 1e-3, 1e-5, 1e-8])
    totals = [Continued(likelihood)(np.array([1.0, sd])).total for sd in sds]
    honest = [likelihood.evaluate(np.array([1.0, sd])).total for sd in sds]
    best = SAMPLE.log_density(np.array([1.0, 0.5 / 7.0**0.5]), SAMPLE.z, y).sum()
    assert np.all(np.diff(totals) < 0.0)
    assert max(totals) < best
    assert np.all(np.array(totals)[2:] < -1e3)
    assert honest[-1] == -np.inf


def test_a_user_calls_the_honest_likelihood() -> None:
    """Minus infinity where an outcome cannot be, the same value and score as a search elsewhere."""
    y = BINDING.z * np.array([0.5, -0.02, 1.03, 0.5, 0.7, 0.2, 0.8])
    likelihood = BINDING.likelihood(y)
    found, searched = likelihood(BINDING.alpha), Continued(likelihood)(BINDING.alpha)
    outside = searched.status == Status.OUTSIDE_SUPPORT
    assert outside.tolist() == [False, True, True, False, False, False, False]
    assert np.all(found.each[outside] == -np.inf)
    np.testing.assert_allclose(found.each[~outside], searched.each[~outside], rtol=1e-12)
    np.testing.assert_array_equal(found.scores, searched.scores)
