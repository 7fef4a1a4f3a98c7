"""Identification with priors against conjugate closed forms and searches of SciPy's own."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import (
    Check,
    Experiments,
    Free,
    Gamma,
    Identification,
    Inputs,
    LogNormal,
    Noise,
    Normal,
)
from aleator.core.types import Array
from aleator.laws import By, Law

COUNT, SD, NOISE = 25, 0.4, 0.3
MEASURED = np.random.default_rng(3).normal(2.0, np.hypot(SD, NOISE), COUNT)
VARIANCE = SD**2 + NOISE**2


def direct(z: Array, x: Array) -> Array:
    return x + 0.0 * z


def identified(law: Law, noise: Noise | None, y: Array = MEASURED) -> Identification:
    table = pd.DataFrame({"z": np.linspace(0.0, 1.0, y.size), "y": y})
    return unjudged(
        direct, table, Inputs({"x": law}), outcome="y", vectorized=True, noise=noise,
        verification=Check(0),
    )  # fmt: skip


def conjugate(center: float, sd: float, variance: float) -> tuple[float, float]:
    """Mean and sd of a normal mean given data of this variance (Gelman et al., 2013, sec. 2.5)."""
    precision = 1.0 / sd**2 + COUNT / variance
    mean = (center / sd**2 + MEASURED.sum() / variance) / precision
    return mean, precision**-0.5


@pytest.mark.parametrize(("noise", "variance"), [(Noise(NOISE), VARIANCE), (None, SD**2)])
@pytest.mark.parametrize("prior_sd", [0.02, 0.1, 1.0])
def test_a_normal_mean_is_that_of_the_conjugate_posterior(
    noise: Noise | None, variance: float, prior_sd: float
) -> None:
    prior = Normal(1.5, prior_sd)
    found = identified(Normal(Free(-10.0, 10.0, prior=prior), SD), noise)
    mean, sd = conjugate(1.5, prior_sd, variance)
    entry = found.alpha["x.mean"]
    assert entry.estimate == pytest.approx(mean, abs=2e-3 * sd)
    assert entry.standard_error == pytest.approx(sd, rel=3e-3)
    assert entry.interval == pytest.approx((mean - 1.96 * sd, mean + 1.96 * sd), abs=0.04 * sd)
    likelihood = stats.norm.logpdf(MEASURED, mean, np.sqrt(variance)).sum()
    assert found.log_likelihood.estimated == pytest.approx(likelihood, abs=2e-3)
    believed = stats.norm.logpdf(mean, 1.5, prior_sd)
    assert found.log_likelihood.log_prior == pytest.approx(believed, abs=2e-3)
    assert found.sound


def test_priors_of_law_and_noise_move_the_maximum_as_a_search_of_its_own_finds() -> None:
    found = identified(
        Normal(Free(-10.0, 10.0), Free(0.0, 2.0, prior=Gamma(0.2, 0.1))),
        Noise(Free(0.01, 2.0, prior=LogNormal(0.3, 0.03))),
    )

    def loss(alpha: Array) -> float:
        sd = np.hypot(alpha[1], alpha[2])
        s = np.sqrt(np.log1p(0.01))
        return -float(
            stats.norm.logpdf(MEASURED, alpha[0], sd).sum()
            + stats.gamma.logpdf(alpha[1], 4.0, scale=0.05)
            + stats.lognorm.logpdf(alpha[2], s, scale=0.3 * np.exp(-0.5 * s**2))
        )

    bounds = [(-10.0, 10.0), (1e-4, 2.0), (0.01, 2.0)]
    truth = optimize.minimize(loss, [2.0, 0.3, 0.3], bounds=bounds, tol=1e-12)
    np.testing.assert_allclose(found.values.to_numpy(), truth.x, atol=1e-3)
    told = found.log_likelihood
    assert told.log_prior is not None
    assert told.estimated + told.log_prior == pytest.approx(-truth.fun, abs=2e-3)


def test_a_prior_far_stronger_than_the_data_is_the_answer() -> None:
    found = identified(Normal(Free(-10.0, 10.0, prior=Normal(-3.0, 1e-3)), SD), Noise(NOISE))
    assert found.values["x.mean"] == pytest.approx(-3.0, abs=1e-3)
    assert found.sound


def test_a_limit_stays_a_limit() -> None:
    found = identified(Normal(Free(2.5, 10.0, prior=Normal(2.4, 0.5)), SD), Noise(NOISE))
    assert found.values["x.mean"] == 2.5
    assert found.alpha["x.mean"].at_bound == "lower"


def test_a_coefficient_of_a_covariate_may_have_a_prior() -> None:
    formula = By("1 + z", -10.0, 10.0, terms={"z": Free(-5.0, 5.0, prior=Normal(1.0, 0.1))})
    found = identified(Normal(formula, SD), Noise(NOISE))
    z = np.linspace(0.0, 1.0, COUNT)
    columns = np.stack([np.ones(COUNT), z], axis=1)
    precision = columns.T @ columns / VARIANCE + np.diag([0.0, 100.0])
    mean = np.linalg.solve(precision, columns.T @ MEASURED / VARIANCE + [0.0, 100.0])
    np.testing.assert_allclose(found.values.to_numpy()[:2], mean, atol=2e-3)


def test_a_correlation_may_have_a_prior() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.multivariate_normal([0.0, 0.0], [[1.0, 0.5], [0.5, 1.0]], 30).T
    table = pd.DataFrame({"id": np.repeat(np.arange(30), 2), "z": np.tile([0.0, 1.0], 30)})
    table["y"] = np.stack([a, b], axis=1).ravel()
    prior = Normal(0.0, 0.01)
    inputs = Inputs(
        {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)},
        {("a", "b"): Free(-0.9, 0.9, prior=prior)},
    )
    found = unjudged(
        lambda z, a, b: np.where(z > 0.5, b, a), Experiments.from_frame(table, outcome="y"),
        inputs, vectorized=True, noise=Noise(0.1), verification=Check(0),
    )  # fmt: skip
    assert abs(found.values["correlation.a.b"]) < 0.01


def test_nothing_changes_without_a_prior() -> None:
    found = identified(Normal(Free(-10.0, 10.0), SD), Noise(NOISE))
    assert found.log_likelihood.log_prior is None
    assert found.values["x.mean"] == pytest.approx(MEASURED.mean(), abs=1e-3)
    assert "prior" not in repr(found)


def test_the_likelihood_is_told_without_the_prior() -> None:
    law = Normal(Free(-10.0, 10.0, prior=Normal(1.5, 0.1)), SD)
    for noise, sd in ((Noise(NOISE), np.sqrt(VARIANCE)), (None, SD)):
        found = identified(law, noise)
        told = found.log_likelihood_at({"x.mean": 2.0})
        truth = stats.norm.logpdf(MEASURED, 2.0, sd).sum()
        assert told == pytest.approx(truth, abs=2e-3)
        scored = found.fit.scored()
        assert scored.each.size == COUNT
        assert scored.total == pytest.approx(scored.likelihood + scored.prior)
        np.testing.assert_allclose(scored.score[0], 0.0, atol=0.2)
