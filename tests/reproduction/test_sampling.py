"""Sampling, where moments and densities are known exactly, and the paper's histogram."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from problems import BINDING, GROWTH, PRODUCT, REGRESSION, SAMPLE, Exact, Problem
from scipy import integrate, stats

from aleator.core.types import Array
from aleator.laws.quadrature import (
    Cubature,
    MonteCarloPoints,
    ProbabilityGrid,
    SobolPoints,
    TensorGauss,
)
from aleator.moments.maximum_entropy import MaximumEntropy
from aleator.moments.moments import NodeOutcomes
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


# ------------------------------------------------------------------------------ densities


def test_the_histogram_of_random_samples_converges_with_their_cube_root() -> None:
    y = middle_outcomes(REGRESSION)
    exact = REGRESSION.log_density(REGRESSION.alpha, REGRESSION.z, y)
    sizes, errors = [64, 512, 4096, 32768], []
    for s in sizes:
        way = sampling(REGRESSION, MonteCarloPoints(s))
        found = log_likelihood(way, REGRESSION.alpha, HistogramSpline(), y, replicates=24)
        errors.append(float(found.error(exact).floored.mean()))
    assert order(sizes, errors) == pytest.approx(-1.0 / 3.0, abs=0.06)


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


# ------------------------------------------------------------------------------ samples needed


@given(rate=st.floats(0.1, 3.0), factor=st.floats(0.1, 10.0), share=st.floats(0.01, 0.99))
def test_a_power_law_is_inverted_exactly(rate: float, factor: float, share: float) -> None:
    samples = np.array([10.0, 40.0, 300.0, 1e4])
    wanted = 10.0 * 1000.0**share
    found = samples_needed(samples, factor * samples**-rate, factor * wanted**-rate)
    assert found == pytest.approx(wanted, rel=1e-9)


# ------------------------------------------------------------------------------ misuse


def sampled(law, size: int, count: int = 1) -> NodeOutcomes:
    p = (np.arange(size) + 0.5) / size
    y = np.stack([law.ppf(p) * (1.0 + k) for k in range(count)])
    return NodeOutcomes(y, np.full(size, 1.0 / size))


def test_bins_keep_their_mass_and_the_density_integrates_to_one() -> None:
    fitted = HistogramSpline(20).fit_sample(sampled(stats.gamma(3.0), 500))
    edges = np.linspace(fitted.low[0], fitted.high[0], 21)
    counts = np.histogram(sampled(stats.gamma(3.0), 500).y[0], edges)[0] / 500
    masses = [
        integrate.quad(lambda y: float(fitted.pdf([[y]])[0, 0]), a, b)[0]
        for a, b in pairwise(edges)
    ]
    np.testing.assert_allclose(masses, counts, atol=1e-9)
    np.testing.assert_allclose(np.diff(fitted.cdf(edges[None, :])[0]), counts, atol=1e-12)
