"""Whole identifications of cases whose exact likelihood is maximized here by another method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identifications import Array, estimates, identified, maximum
from problems import REGRESSION, SAMPLE
from scipy import stats

from aleator import Collocation, Gaussian, Identification, MaximumEntropy

# ------------------------------------------------------------------------------ a normal sample


@pytest.fixture(scope="module")
def sample() -> tuple[Array, Identification]:
    problem = replace(SAMPLE, z=np.zeros(40))
    y = problem.draw(1)
    return y, identified(problem, y, samples=512)


def test_a_normal_sample_has_its_mean_and_sd(sample) -> None:
    y, found = sample
    assert found.alpha["x.mean"].estimate == pytest.approx(y.mean(), abs=1e-4)
    assert found.alpha["x.sd"].estimate == pytest.approx(y.std(), abs=1e-4)
    assert found.alpha["x.mean"].standard_error == pytest.approx(y.std() / 40**0.5, rel=1e-3)
    assert found.alpha["x.sd"].standard_error == pytest.approx(y.std() / 80**0.5, rel=2e-3)
    exact = stats.norm.logpdf(y, y.mean(), y.std()).sum()
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=1e-4)
    assert found.sound
    assert found.search["edm"] < 1e-3


def test_what_is_said_of_each_experiment_is_its_normal_law(sample) -> None:
    y, found = sample
    mean, sd = y.mean(), y.std()
    for report, outcome in zip(found.experiments, y, strict=True):
        assert report.outcome == outcome
        assert report.mean == pytest.approx(mean, abs=1e-3)
        assert report.standard_deviation == pytest.approx(sd, abs=1e-3)
        assert (report.skewness, report.kurtosis) == pytest.approx((0.0, 3.0), abs=1e-6)
        assert report.pit == pytest.approx(stats.norm.cdf(outcome, mean, sd), abs=1e-3)
        for p, q in report.quantiles.items():
            assert q == pytest.approx(stats.norm.ppf(float(p), mean, sd), abs=2e-3)
        assert report.log_density == pytest.approx(stats.norm.logpdf(outcome, mean, sd), abs=1e-3)
        assert report.status == "solved"


def test_the_baselines_of_a_normal_sample_are_the_same_answer(sample) -> None:
    y, found = sample
    fit, circe = found.baselines["least_squares"], found.baselines["circe"]
    assert fit["parameters"]["x"] == pytest.approx(y.mean(), abs=1e-4)
    assert fit["rmse"] == pytest.approx(y.std(), abs=1e-5)
    assert fit["log_likelihood"] == pytest.approx(found.log_likelihood.estimated, abs=1e-3)
    assert circe["alpha"]["x.sd"] == pytest.approx(y.std(), abs=1e-4)


def test_the_same_seed_gives_the_same_document() -> None:
    problem = replace(SAMPLE, z=np.zeros(12))
    y = problem.draw(2)
    documents = [identified(problem, y, samples=64, seed=3).to_dict() for _ in range(2)]
    for document in documents:
        del document["seconds"]
    assert documents[0] == documents[1]


def test_the_order_of_rows_does_not_matter() -> None:
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 30))
    y = problem.draw(3)
    turn = np.random.default_rng(0).permutation(30)
    turned = replace(problem, z=problem.z[turn])
    one, other = identified(problem, y), identified(turned, y[turn])
    # both ends are within the search's tolerance of the same maximum
    np.testing.assert_allclose(estimates(other), estimates(one), atol=2e-4)
    assert other.log_likelihood.estimated == pytest.approx(one.log_likelihood.estimated, abs=1e-5)


# ------------------------------------------------------------------------------ random coefficients


@pytest.mark.parametrize("density", [Gaussian(), MaximumEntropy(4)], ids=lambda d: d.name)
def test_random_coefficients_of_hildreth_and_houck(density) -> None:
    """y = a + b z with a and b normal, against the Gaussian likelihood written here."""
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 60))
    y = problem.draw(4)

    def log_likelihood(p: Array) -> float:
        return float(
            stats.norm.logpdf(y, p[0] + p[2] * problem.z, np.hypot(p[1], p[3] * problem.z)).sum()
        )

    alpha, value, error = maximum(log_likelihood, [[1.0, 0.5, 2.0, 0.3], [0.0, 1.0, 1.0, 0.1]])
    found = identified(problem, y, density)
    # a hundredth of a standard error
    assert np.all(np.abs(estimates(found) - alpha) < 0.01 * error)
    assert found.log_likelihood.estimated == pytest.approx(value, abs=1e-4)
    told = np.array([e.standard_error for e in found.alpha.values()], dtype=float)
    np.testing.assert_allclose(told, error, rtol=0.01)


def test_repeated_conditions_share_their_runs_and_change_nothing() -> None:
    """Three conditions, not in order, ten times each; a nudge of 1e-9 makes all distinct."""
    z = np.tile([2.0, 2.0, -1.0, 0.5, 0.5, -1.0], 5)
    problem = replace(REGRESSION, z=z)
    apart = replace(REGRESSION, z=z + 1e-9 * np.arange(30))
    y = problem.draw(13)
    one, other = identified(problem, y), identified(apart, y)
    np.testing.assert_allclose(estimates(one), estimates(other), atol=5e-4)
    shared, alone = (f.runs_by_stage["response surface"] for f in (one, other))
    assert 4 * shared < alone


@pytest.mark.slow
def test_random_coefficients_by_collocation_are_the_same() -> None:
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 15))
    y = problem.draw(5)
    by_surface = identified(problem, y)
    by_runs = identified(problem, y, propagation=Collocation(nodes=5))
    as_paper = identified(
        problem, y, propagation=Collocation(nodes=5, moments="expansion", degree=4)
    )
    np.testing.assert_allclose(estimates(by_runs), estimates(by_surface), atol=5e-4)
    np.testing.assert_allclose(estimates(as_paper), estimates(by_surface), atol=5e-4)
    assert by_runs.propagation == "collocation(quadrature)"
    assert by_runs.surface is None
    # an evaluation costs the runs of nodes and of differences, less those that another has made
    evaluations = by_runs.search["evaluations"] + by_runs.search["distinct_optima"]
    most = evaluations * 15 * 25 * 5
    assert 0.9 * most < by_runs.runs_by_stage["search"] <= most


# ------------------------------------------------------------------------------ stochastic frontier
