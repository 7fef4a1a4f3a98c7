"""One exact outcome an experiment: answers in closed form, or by an exact likelihood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identifications import Array, estimates, identified, maximum, unjudged
from problems import REGRESSION, SAMPLE
from scipy import optimize, stats

from aleator import (
    Check,
    Collocation,
    Free,
    Gaussian,
    GradientMultistart,
    Identification,
    Inputs,
    MaximumEntropy,
    Normal,
    ResponseSurface,
)
from aleator.core.polynomials import gauss_hermite

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


def test_random_coefficients_by_collocation_are_the_same() -> None:
    problem = replace(REGRESSION, z=np.linspace(-2.0, 3.0, 8))
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


# ------------------------------------------------------------------------------ skew outcomes


# Millions of revolutions to failure of 23 ball bearings: Lieblein and Zelen, J. Res. Nat. Bur.
# Stand. 57 (1956) 273, as in the package surpyval (load_bearing_failures).
BEARINGS = np.array([
    17.88, 28.92, 33.00, 41.52, 42.12, 45.60, 48.40, 51.84, 51.96, 54.12, 55.56, 67.80,
    68.64, 68.64, 68.88, 84.12, 93.12, 98.64, 105.12, 105.84, 127.92, 128.04, 173.40,
])  # fmt: skip


EXPONENT = Inputs({"x": Normal(mean=Free(2.0, 6.0), sd=Free(0.05, 2.0))})


def exponential(x: np.ndarray) -> np.ndarray:
    return np.exp(x)


def lognormal(y: np.ndarray, **more: object) -> Identification:
    return unjudged(
        exponential, pd.DataFrame({"y": y}), EXPONENT, outcome="y", vectorized=True,
        verification=Check(0), search=GradientMultistart(3), **more,
    )  # type: ignore[arg-type]  # fmt: skip


def offset(found: Identification, y: np.ndarray) -> np.ndarray:
    """Estimates from the maximum in closed form, in standard errors."""
    mean, sd, count = np.log(y).mean(), np.log(y).std(), y.size
    law = np.array([found.alpha["x.mean"].estimate, found.alpha["x.sd"].estimate])
    return (law - [mean, sd]) / (sd / np.sqrt([count, 2.0 * count]))


def test_ball_bearings_have_the_lognormal_maximum() -> None:
    found = lognormal(BEARINGS, propagation=ResponseSurface(surfaces="own"))
    assert found.density == "level sets"
    assert found.sound
    assert np.abs(offset(found, BEARINGS)).max() < 0.05
    assert found.alpha["x.mean"].estimate == pytest.approx(4.1505, abs=0.005)
    assert found.alpha["x.sd"].estimate == pytest.approx(0.5215, abs=0.005)
    log_y = np.log(BEARINGS)
    exact = float(stats.norm.logpdf(log_y, log_y.mean(), log_y.std()).sum() - log_y.sum())
    assert found.log_likelihood.estimated == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize(("extra", "tolerance"), [([], 0.005), ([4.5], 1e-5)])
def test_a_skewness_of_four_and_an_outlier_cost_nothing(
    extra: list[float], tolerance: float
) -> None:
    """The tolerance is relative to the scatter, which an outlier makes large beside the others."""
    rng = np.random.default_rng(2)
    y = np.exp(4.0 + 0.8 * np.append(rng.standard_normal(59), extra))
    found = lognormal(y, propagation=ResponseSurface(tolerance=tolerance))
    assert found.sound
    assert {e.status for e in found.experiments} == {"solved"}
    assert np.abs(offset(found, y)).max() < 0.1


@pytest.mark.parametrize(
    ("sd", "propagation"), [(0.8, ResponseSurface()), (1.5, ResponseSurface(tolerance=0.005))]
)
def test_no_outcome_is_out_of_reach_of_a_normal_law_without_a_box(
    sd: float, propagation: ResponseSurface
) -> None:
    """A pilot that is linear in x knows little of exp(x) over six decades."""
    y = np.exp(2.0 + sd * np.random.default_rng(0).standard_normal(60))
    wide = Inputs({"x": Normal(mean=Free(-5.0, 10.0), sd=Free(0.02, 3.0))})
    found = unjudged(
        exponential, pd.DataFrame({"y": y}), wide, outcome="y", vectorized=True,
        verification=Check(0), search=GradientMultistart(3), propagation=propagation,
    )  # fmt: skip
    assert found.sound
    assert np.abs(offset(found, y)).max() < 0.1


def test_of_two_parameters_the_exact_density_is_taken_where_it_moves_an_estimate() -> None:
    """y = w exp(x) is normal given x, which a Gauss rule integrates."""
    rng, (node, weight) = np.random.default_rng(5), gauss_hermite(60)
    y = (1.0 + 0.1 * rng.standard_normal(25)) * np.exp(0.5 * rng.standard_normal(25))
    law = Inputs(
        {"x": Normal(mean=0.0, sd=Free(0.1, 1.0)), "w": Normal(mean=Free(0.5, 2.0), sd=0.1)}
    )
    found = unjudged(
        lambda x, w: w * np.exp(x), pd.DataFrame({"y": y}), law, outcome="y", vectorized=True,
        verification=Check(0), search=GradientMultistart(2),
        propagation=ResponseSurface(tolerance=1e-3),
    )  # fmt: skip
    assert found.density == "level sets"
    assert found.sound

    def exact(p: np.ndarray) -> float:
        factor = np.exp(p[0] * node)
        return -float(
            np.log(stats.norm.pdf(y[:, None] / factor, p[1], 0.1) / factor @ weight).sum()
        )

    end = optimize.minimize(exact, [0.5, 1.0], method="Nelder-Mead")
    for name, value in zip(("x.sd", "w.mean"), end.x, strict=True):
        estimate = found.alpha[name]
        assert abs(estimate.estimate - value) < 0.05 * estimate.standard_error
