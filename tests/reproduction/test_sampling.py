"""Sampling, where moments and densities are known exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import BINDING, GROWTH, PRODUCT, REGRESSION, SAMPLE, SQUARE, Exact, Problem
from scipy import stats

from aleator.errors import InputsError
from aleator.moments.densities import Gaussian
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.moments import NodeOutcomes
from aleator.moments.quadrature import (
    Cubature,
    MonteCarloPoints,
    ProbabilityGrid,
    Smolyak,
    SobolPoints,
    TensorGauss,
)
from aleator.types import Array
from reproduction.sampling.histogram import HistogramSpline
from reproduction.sampling.likelihood import (
    Choice,
    SampledLikelihood,
    Sampling,
    density_of,
    log_likelihoods,
    samples_needed,
)


def sampling(problem: Problem, cubature: Cubature) -> Sampling:
    return Sampling(Exact(problem), problem.inputs, cubature)


def law_of(problem: Problem) -> Array:
    return problem.alpha[: problem.inputs.size]


def middle_outcomes(problem: Problem) -> Array:
    """Outcomes that are neither rare nor at an edge: at the 35 % point of every parameter."""
    x = problem.inputs.sample(law_of(problem), np.full((1, len(problem.inputs.names)), 0.35))
    return problem.run(np.arange(problem.z.size), np.tile(x, (problem.z.size, 1)))


def mean_errors(problem: Problem, cubature: Cubature, replicates: int = 1) -> Array:
    """Errors (replicates,) of the sampled mean of the last experiment."""
    exact = problem.exact_moments(2)[0]
    way = sampling(problem, cubature)
    return np.array(
        [
            way.replicate(k).outcomes(law_of(problem)).moments(2).mean[-1] - exact[-1]
            for k in range(replicates)
        ]
    )


def log_likelihood(way: Sampling, alpha: Array, density: Choice, y: Array, **choices):
    (found,) = log_likelihoods(way, alpha, [density], y, **choices)
    return found


def order(sizes: list[int], errors: list[float]) -> float:
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


# ------------------------------------------------------------------------------ moments


@pytest.mark.parametrize("problem", [GROWTH, SQUARE, PRODUCT])
def test_sampled_moments_scatter_about_the_exact_ones(problem: Problem) -> None:
    mean, sd, _ = problem.exact_moments(2)
    way = sampling(problem, MonteCarloPoints(2000))
    means = np.stack(
        [way.replicate(k).outcomes(law_of(problem)).moments(2).mean for k in range(40)]
    )
    # the scatter itself is that of a mean of 2,000: known to 1/sqrt(2 39) = 11 %
    np.testing.assert_allclose(means.std(axis=0, ddof=1), sd / np.sqrt(2000), rtol=0.45)
    assert np.all(np.abs(means.mean(axis=0) - mean) < 4.0 * sd / np.sqrt(2000 * 40))


def test_monte_carlo_converges_with_the_root_of_the_samples() -> None:
    sizes = [64, 256, 1024, 4096]
    for problem in (GROWTH, PRODUCT):
        rms = [
            float(np.sqrt(np.mean(mean_errors(problem, MonteCarloPoints(s), 64) ** 2)))
            for s in sizes
        ]
        # each root mean square is known to 9 %
        assert order(sizes, rms) == pytest.approx(-0.5, abs=0.08)


def test_scrambled_sobol_points_beat_the_first_order() -> None:
    sizes = [64, 256, 1024, 4096]
    for problem in (GROWTH, PRODUCT):
        rms = [
            float(np.sqrt(np.mean(mean_errors(problem, SobolPoints(s), 16) ** 2))) for s in sizes
        ]
        assert -1.7 < order(sizes, rms) < -0.85


def test_the_grid_converges_with_the_square_of_its_side_where_the_law_is_bounded() -> None:
    """In probability the midpoint rule sees x = F^-1(u), smooth on a box: m^-2."""
    sides = [32, 64, 128, 256]
    errors = [abs(mean_errors(BINDING, ProbabilityGrid(m)).item()) for m in sides]
    assert order(sides, errors) == pytest.approx(-2.0, abs=0.05)


def test_the_grid_loses_an_order_and_more_where_the_law_is_not_bounded() -> None:
    """The variance of a normal parameter: what is missing of the tails falls as log(m)/m."""
    sides = [32, 128, 512, 2048]
    missing = []
    for m in sides:
        found = sampling(SAMPLE, ProbabilityGrid(m)).outcomes(SAMPLE.alpha).moments(2).sd[0]
        missing.append(1.0 - float(found / SAMPLE.alpha[1]) ** 2)
    assert min(missing) > 0.0
    assert -1.1 < order(sides, missing) < -0.85


# ------------------------------------------------------------------------------ densities


@pytest.mark.parametrize("problem", [REGRESSION, GROWTH, PRODUCT])
def test_a_histogram_of_many_samples_is_the_exact_density(problem: Problem) -> None:
    y = middle_outcomes(problem)
    exact = problem.log_density(problem.alpha, problem.z, y)
    found = log_likelihood(
        sampling(problem, SobolPoints(2**15)), law_of(problem), HistogramSpline(), y, replicates=4
    )
    assert not found.missed.any()
    np.testing.assert_allclose(found.each.mean(axis=0), exact, atol=0.03)


def test_the_histogram_of_random_samples_converges_with_their_cube_root() -> None:
    y = middle_outcomes(REGRESSION)
    exact = REGRESSION.log_density(REGRESSION.alpha, REGRESSION.z, y)
    sizes, errors = [64, 512, 4096, 32768], []
    for s in sizes:
        way = sampling(REGRESSION, MonteCarloPoints(s))
        found = log_likelihood(way, REGRESSION.alpha, HistogramSpline(), y, replicates=24)
        errors.append(float(found.error(exact).floored.mean()))
    assert order(sizes, errors) == pytest.approx(-1.0 / 3.0, abs=0.06)


def test_a_density_of_sampled_moments_converges_faster_than_a_histogram() -> None:
    """A normal outcome, whose shape the Gaussian has: only the moments' error is left."""
    y = middle_outcomes(REGRESSION)
    exact = REGRESSION.log_density(REGRESSION.alpha, REGRESSION.z, y)
    sizes, errors = [64, 512, 4096], []
    for s in sizes:
        way = sampling(REGRESSION, MonteCarloPoints(s))
        found = log_likelihood(way, REGRESSION.alpha, Gaussian(), y, replicates=48)
        errors.append(float(found.error(exact).floored.mean()))
        gap = np.abs(found.each.mean(axis=0) - exact)
        assert np.all(gap < 4.0 * found.each.std(axis=0, ddof=1) / np.sqrt(48) + 2.0 / s)
    assert order(sizes, errors) == pytest.approx(-0.5, abs=0.08)


def test_gauss_nodes_give_what_the_likelihood_gives() -> None:
    for problem in (GROWTH, PRODUCT):
        y = problem.draw(3)
        lower, upper = problem.limits(problem.z)
        found = log_likelihood(
            sampling(problem, TensorGauss(9)), law_of(problem), MaximumEntropy(4), y,
            lower=lower, upper=upper,
        )  # fmt: skip
        expected = problem.likelihood(y, MaximumEntropy(4), nodes=9).evaluate(problem.alpha)
        np.testing.assert_allclose(found.each[0], expected.each, rtol=1e-12)
        assert np.isneginf(found.floor).all()


def test_several_densities_share_their_samples() -> None:
    y, way = middle_outcomes(GROWTH), sampling(GROWTH, MonteCarloPoints(500, seed=4))
    both = log_likelihoods(way, GROWTH.alpha, [Gaussian(), HistogramSpline()], y, replicates=3)
    alone = log_likelihood(way, GROWTH.alpha, HistogramSpline(), y, replicates=3)
    np.testing.assert_array_equal(both[1].each, alone.each)
    assert both[0].each.shape == (3, GROWTH.z.size)
    assert both[0].runs == 500


# ------------------------------------------------------------------------------ what was missed


def test_outcomes_beyond_all_samples_are_counted_and_floored() -> None:
    sample = NodeOutcomes(np.linspace(0.0, 1.0, 101)[None, :], np.full(101, 1.0 / 101.0))
    assert density_of(sample, HistogramSpline(10)).log_pdf([2.0])[0] == -np.inf

    y = np.array([1.0, 20.0])
    way = Sampling(Exact(SAMPLE), SAMPLE.inputs, MonteCarloPoints(1000))
    found = log_likelihood(way, SAMPLE.alpha, HistogramSpline(), np.resize(y, 7), replicates=2)
    assert found.missed[:, :2].tolist() == [[False, True]] * 2
    samples = way.outcomes(SAMPLE.alpha).y[0]
    # Rice's rule: 20 bins for 1,000 samples
    expected = -np.log(1000 * np.ptp(samples) / 20)
    assert found.floored[0, 1] == pytest.approx(expected, rel=1e-12)
    exact = stats.norm.logpdf(np.resize(y, 7), *SAMPLE.alpha)
    error = found.error(exact)
    assert error.missed.tolist() == [3, 3]
    assert np.all(error.others < 0.3)
    assert np.all(error.floored > 100.0)


def test_errors_by_hand() -> None:
    each = np.array([[-1.0, -np.inf, -5.0], [-2.0, -1.0, -3.0]])
    found = SampledLikelihood(each, np.full((2, 3), -4.0), runs=10)
    error = found.error(np.array([-1.5, -1.0, -3.5]))
    np.testing.assert_allclose(error.floored, [(0.5 + 3.0 + 0.5) / 3.0, 1.0 / 3.0])
    np.testing.assert_allclose(error.others, [0.5, 1.0 / 3.0])
    assert error.missed.tolist() == [2, 0]
    assert error.standard_error == pytest.approx(0.5 * (4.0 - 1.0) / 3.0)


def test_where_everything_was_missed_the_others_have_no_error() -> None:
    found = SampledLikelihood(np.full((1, 2), -np.inf), np.full((1, 2), -3.0), runs=4)
    error = found.error(np.zeros(2))
    assert np.isnan(error.others).all()
    assert error.floored.tolist() == [3.0]
    assert np.isnan(error.standard_error)


# ------------------------------------------------------------------------------ samples needed


@given(rate=st.floats(0.1, 3.0), factor=st.floats(0.1, 10.0), share=st.floats(0.01, 0.99))
def test_a_power_law_is_inverted_exactly(rate: float, factor: float, share: float) -> None:
    samples = np.array([10.0, 40.0, 300.0, 1e4])
    wanted = 10.0 * 1000.0**share
    found = samples_needed(samples, factor * samples**-rate, factor * wanted**-rate)
    assert found == pytest.approx(wanted, rel=1e-9)


def test_an_error_that_is_never_or_always_reached() -> None:
    assert np.isnan(samples_needed([10, 100], [1.0, 0.5], 0.4))
    assert samples_needed([10, 100], [1.0, 0.5], 2.0) == 10.0
    assert samples_needed([10, 100, 1000], [1.0, 0.1, 0.5], 0.1) == pytest.approx(100.0)


# ------------------------------------------------------------------------------ misuse


@pytest.mark.parametrize("cubature", [ProbabilityGrid(4), TensorGauss(4), Smolyak(2)])
def test_a_rule_without_a_seed_has_no_replicates(cubature: Cubature) -> None:
    y = middle_outcomes(GROWTH)
    with pytest.raises(InputsError, match="has no seed"):
        log_likelihood(sampling(GROWTH, cubature), GROWTH.alpha, Gaussian(), y, replicates=2)


def test_no_replicate_is_refused() -> None:
    y = middle_outcomes(GROWTH)
    with pytest.raises(InputsError, match="0 replicates"):
        log_likelihood(sampling(GROWTH, SobolPoints(8)), GROWTH.alpha, Gaussian(), y, replicates=0)
