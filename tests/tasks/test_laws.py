"""Laws identified from start to end: families, priors, correlations, columns that they follow."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest
from identifications import maximum, unjudged
from scipy import optimize, stats

from aleator import (
    Beta,
    By,
    Check,
    Collocation,
    Constant,
    Experiments,
    Free,
    Gamma,
    Gaussian,
    GradientMultistart,
    Identification,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    ScipyLaw,
    Uniform,
    full,
    identify,
)
from aleator.core.types import Array
from aleator.laws import Law

COUNT, NOISE = 60, 0.5
Z = np.linspace(0.5, 1.5, COUNT)
WEIBULL = stats.weibull_min(2.0)


def uniform(mean: float, sd: float) -> Any:
    return stats.uniform(mean - 3.0**0.5 * sd, 2.0 * 3.0**0.5 * sd)


def beta(mean: float, sd: float) -> Any:
    m, v = mean / 4.0, (sd / 4.0) ** 2
    s = m * (1.0 - m) / v - 1.0
    return stats.beta(m * s, (1.0 - m) * s, scale=4.0)


def gamma(mean: float, sd: float) -> Any:
    return stats.gamma((mean / sd) ** 2, scale=sd**2 / mean)


def lognormal(mean: float, sd: float) -> Any:
    s = math.sqrt(math.log1p((sd / mean) ** 2))
    return stats.lognorm(s, scale=mean * math.exp(-0.5 * s**2))


def weibull(mean: float, sd: float) -> Any:
    scale = sd / WEIBULL.std()
    return stats.weibull_min(2.0, loc=mean - scale * WEIBULL.mean(), scale=scale)


MEAN, SD = Free(0.5, 4.0), Free(0.05, 2.0)
LAWS = [
    pytest.param(Uniform(Free(0.0, 4.0), SD), uniform, (2.0, 0.6), id="uniform"),
    pytest.param(Beta((0.0, 4.0), Free(0.5, 2.5), Free(0.05, 1.0)), beta, (1.2, 0.6), id="beta"),
    pytest.param(Gamma(MEAN, SD), gamma, (2.0, 0.8), id="gamma"),
    pytest.param(LogNormal(MEAN, SD), lognormal, (2.0, 0.6), id="lognormal"),
    pytest.param(ScipyLaw(WEIBULL, MEAN, SD), weibull, (2.0, 0.8), id="weibull"),
]


def exact_maximum(y: Array, law: Callable[..., Any], start: tuple[float, float]) -> Array:
    """Of f(y) = E N(y; z x, noise^2), the mean over the law by 300 points of its quantiles."""
    t, w = np.polynomial.legendre.leggauss(300)
    theta, weights = 8.0 * t, 8.0 * w * stats.norm.pdf(8.0 * t)
    u = stats.norm.cdf(theta)

    def negative(p: Array) -> float:
        x = law(*p).ppf(u)
        if not np.all(np.isfinite(x)):
            return 1e10
        away = (y[:, None] - Z[:, None] * x) / NOISE
        return -float(np.sum(np.log(np.exp(-0.5 * away**2) @ weights)))

    options = {"xatol": 1e-5, "fatol": 1e-8}
    return np.asarray(optimize.minimize(negative, start, method="Nelder-Mead", options=options).x)


def identified_by(y: Array, inputs: Inputs, simulator: Callable[..., Array]) -> Any:
    return unjudged(
        simulator, pd.DataFrame({"z": Z, "y": y}), inputs, outcome="y", vectorized=True,
        noise=Noise(NOISE), search=GradientMultistart(4),
        verification=Check(0),
    )  # fmt: skip


@pytest.mark.parametrize(("law", "distribution", "truth"), LAWS)
def test_the_maximum_is_that_of_the_exact_likelihood(law: Law, distribution, truth) -> None:
    rng = np.random.default_rng(2)
    x = distribution(*truth).rvs(size=COUNT, random_state=rng)
    y = Z * x + NOISE * rng.standard_normal(COUNT)
    exact = exact_maximum(y, distribution, truth)
    found = identified_by(y, Inputs({"x": law}), lambda z, x: z * x)
    assert found.sound
    for k, name in enumerate(("x.mean", "x.sd")):
        one = found.alpha[name]
        assert one.estimate == pytest.approx(exact[k], abs=0.05 * one.standard_error)


def test_a_known_law_without_hyperparameters_leaves_the_others_to_be_identified() -> None:
    """y = b + z x with x known: b is the maximum of a likelihood in one variable."""
    rng = np.random.default_rng(5)
    y = 1.5 + Z * WEIBULL.rvs(size=COUNT, random_state=rng) + NOISE * rng.standard_normal(COUNT)
    inputs = Inputs({"x": ScipyLaw(WEIBULL), "b": Constant(Free(-5.0, 5.0))})
    assert [h.name for h in inputs.hyperparameters] == ["b.value"]
    found = identified_by(y, inputs, lambda z, x, b: b + z * x)
    t, w = np.polynomial.legendre.leggauss(300)
    x, weights = WEIBULL.ppf(stats.norm.cdf(8.0 * t)), 8.0 * w * stats.norm.pdf(8.0 * t)

    def negative(b: float) -> float:
        density = stats.norm.pdf(y[:, None], b + Z[:, None] * x, NOISE) @ weights
        return -float(np.sum(np.log(density)))

    exact = optimize.minimize_scalar(negative, bounds=(0.0, 3.0), method="bounded")
    one = found.alpha["b.value"]
    assert one.estimate == pytest.approx(exact.x, abs=0.05 * one.standard_error)
    assert found.log_likelihood.estimated == pytest.approx(-exact.fun, abs=0.05)


# ------------------------------------------------------------------------------ priors

SAMPLE_SIZE, SCATTER, ERROR = 25, 0.4, 0.3
MEASURED = np.random.default_rng(3).normal(2.0, np.hypot(SCATTER, ERROR), SAMPLE_SIZE)
VARIANCE = SCATTER**2 + ERROR**2


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
    precision = 1.0 / sd**2 + SAMPLE_SIZE / variance
    mean = (center / sd**2 + MEASURED.sum() / variance) / precision
    return mean, precision**-0.5


@pytest.mark.parametrize(("noise", "variance"), [(Noise(ERROR), VARIANCE), (None, SCATTER**2)])
@pytest.mark.parametrize("prior_sd", [0.02, 1.0])
def test_a_normal_mean_is_that_of_the_conjugate_posterior(
    noise: Noise | None, variance: float, prior_sd: float
) -> None:
    prior = Normal(1.5, prior_sd)
    found = identified(Normal(Free(-10.0, 10.0, prior=prior), SCATTER), noise)
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
    assert told.estimated + told.log_prior == pytest.approx(-truth.fun, abs=2e-3)


def test_a_limit_stays_a_limit() -> None:
    found = identified(Normal(Free(2.5, 10.0, prior=Normal(2.4, 0.5)), SCATTER), Noise(ERROR))
    assert found.values["x.mean"] == 2.5
    assert found.alpha["x.mean"].at_bound == "lower"


def test_a_coefficient_of_a_covariate_may_have_a_prior() -> None:
    formula = By("1 + z", -10.0, 10.0, terms={"z": Free(-5.0, 5.0, prior=Normal(1.0, 0.1))})
    found = identified(Normal(formula, SCATTER), Noise(ERROR))
    z = np.linspace(0.0, 1.0, SAMPLE_SIZE)
    columns = np.stack([np.ones(SAMPLE_SIZE), z], axis=1)
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
        {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, {("a", "b"): Free(-0.9, 0.9, prior=prior)}
    )
    found = unjudged(
        lambda z, a, b: np.where(z > 0.5, b, a), Experiments.from_frame(table, outcome="y"),
        inputs, vectorized=True, noise=Noise(0.1), verification=Check(0),
    )  # fmt: skip
    assert abs(found.values["correlation.a.b"]) < 0.01


def test_the_likelihood_is_told_without_the_prior() -> None:
    law = Normal(Free(-10.0, 10.0, prior=Normal(1.5, 0.1)), SCATTER)
    for noise, sd in ((Noise(ERROR), np.sqrt(VARIANCE)), (None, SCATTER)):
        found = identified(law, noise)
        told = found.log_likelihood_at({"x.mean": 2.0})
        truth = stats.norm.logpdf(MEASURED, 2.0, sd).sum()
        assert told == pytest.approx(truth, abs=2e-3)
        scored = found.fit.scored()
        assert scored.each.size == SAMPLE_SIZE
        assert scored.total == pytest.approx(scored.likelihood + scored.prior)
        np.testing.assert_allclose(scored.score[0], 0.0, atol=0.2)


# ------------------------------------------------------------------------------ correlations

COEFFICIENTS = "abc"


def conditions(n: int, count: int) -> Array:
    """Regressors (N, n): 1, z along [-1.5, 2], and t, which is not a function of z.

    With t = z^2 the covariance of a and c and the variance of b would both go with z^2.
    """
    z = np.linspace(-1.5, 2.0, count)
    t = np.random.default_rng(0).uniform(-1.0, 2.0, count)
    return np.stack([np.ones(count), z, t][:n], axis=1)


def outcomes(mean: Array, covariance: Array, regressors: Array, seed: int) -> Array:
    x = np.random.default_rng(seed).multivariate_normal(mean, covariance, regressors.shape[0])
    return np.asarray(np.sum(x * regressors, axis=1))


def log_likelihood(p: Array, regressors: Array, y: Array) -> float:
    """Exact: y ~ Normal(g mean, g S g'), from means, sds and plain correlations."""
    n = regressors.shape[1]
    mean, sd = p[:n], p[n : 2 * n]
    matrix = np.eye(n)
    matrix[np.tril_indices(n, -1)] = p[2 * n :]
    matrix = matrix + matrix.T - np.eye(n)
    if np.any(sd <= 0.0) or np.linalg.eigvalsh(matrix)[0] <= 0.0:
        return -1e10
    scaled = regressors * sd
    spread = np.sqrt(np.sum(scaled @ matrix * scaled, axis=1))
    return float(stats.norm.logpdf(y, regressors @ mean, spread).sum())


def test_two_correlated_coefficients() -> None:
    mean, sd, rho = np.array([1.0, 2.0]), np.array([0.5, 0.4]), -0.6
    covariance = np.outer(sd, sd) * np.array([[1.0, rho], [rho, 1.0]])
    regressors = conditions(2, 60)
    y = outcomes(mean, covariance, regressors, 3)
    exact, value, error = maximum(lambda p: log_likelihood(p, regressors, y), [[*mean, *sd, rho]])
    found = unjudged(
        lambda z, a, b: a + b * z, pd.DataFrame({"y": y, "z": regressors[:, 1]}),
        Inputs({name: Normal(Free(-2.0, 4.0), Free(0.05, 3.0)) for name in "ab"}, full("ab")),
        outcome="y", vectorized=True, propagation=Collocation(nodes=4), density=Gaussian(),
        search=GradientMultistart(2), verification=Check(0),
    )  # fmt: skip
    names = ["a.mean", "b.mean", "a.sd", "b.sd", "correlation.a.b"]
    estimates = np.array([found.alpha[name].estimate for name in names])
    # a hundredth of a standard error
    assert np.all(np.abs(estimates - exact) < 0.01 * error)
    assert found.log_likelihood.estimated == pytest.approx(value, abs=1e-4)
    told = np.array([found.alpha[name].standard_error for name in names], dtype=float)
    np.testing.assert_allclose(told, error, rtol=0.01)
    # of two parameters the partial correlation is the correlation
    (plain,) = found.parameter_correlations
    assert plain.between == ("a", "b")
    assert plain.estimate == pytest.approx(estimates[-1], abs=1e-12)
    assert plain.standard_error == pytest.approx(told[-1], rel=1e-6)
    # the linear-Gaussian law is the same model
    assert found.baselines["circe"]["log_likelihood"] == pytest.approx(value, abs=1e-4)


def test_a_known_correlation_and_what_follows_from_known_ones_have_no_error() -> None:
    regressors = conditions(3, 60)
    y = outcomes(np.array([1.0, 2.0, 0.5]), 0.2 * np.eye(3), regressors, 5)
    laws = {name: Normal(Free(-2.0, 4.0), 0.45) for name in COEFFICIENTS}
    found = unjudged(
        lambda z, t, a, b, c: a + b * z + c * t,
        pd.DataFrame({"z": regressors[:, 1], "t": regressors[:, 2], "y": y}),
        Inputs(laws, {("a", "b"): 0.3, ("a", "c"): Free(-0.9, 0.9)}),
        outcome="y",
        vectorized=True,
        propagation=Collocation(nodes=2),
        density=Gaussian(),
        search=GradientMultistart(2),
        verification=Check(0),
    )
    ab, ac, bc = found.parameter_correlations
    own = found.alpha["correlation.a.c"]
    assert (ab.estimate, ab.standard_error) == (0.3, None)
    assert (ac.estimate, ac.standard_error) == pytest.approx((own.estimate, own.standard_error))
    # independent given a: r_bc = r_ab r_ac, and so is its error
    assert (bc.estimate, bc.standard_error) == pytest.approx(
        (0.3 * own.estimate, 0.3 * (own.standard_error or 0.0))
    )


# ------------------------------------------------------------------------------ columns

SUBJECTS, TIMES = 27, np.array([-3.0, -1.0, 1.0, 3.0])


def growing(time, level, slope):
    return level + slope * time


@pytest.mark.parametrize("seed", [2, 4])
def test_what_a_law_follows_does_not_contradict_it(seed: int) -> None:
    """Sums over a part of the column are zero at the maximum, and nearly so in replicates."""
    rng = np.random.default_rng(seed)
    kind = (np.arange(SUBJECTS) < 16).astype(int)
    level = 22.6 + 2.3 * kind + 1.7 * rng.standard_normal(SUBJECTS)
    slope = 0.48 + 0.3 * kind + 0.15 * rng.standard_normal(SUBJECTS)
    y = level[:, None] + slope[:, None] * TIMES + 1.3 * rng.standard_normal((SUBJECTS, 4))
    rows = pd.DataFrame(
        {
            "id": np.repeat(np.arange(SUBJECTS), 4),
            "time": np.tile(TIMES, SUBJECTS),
            "kind": np.repeat(np.where(kind == 1, "new", "old"), 4),
            "y": y.ravel(),
        }
    )
    laws = {
        "level": Normal(By("1 + kind", 10.0, 40.0), Free(0.0, 6.0)),
        "slope": Normal(By("1 + kind", -2.0, 4.0), Free(0.0, 2.0)),
    }
    found = identify(
        growing, rows, Inputs(laws), outcome="y", vectorized=True, noise=Noise(Free(0.05, 6.0)),
        search=GradientMultistart(2), best_law=False,
    )  # fmt: skip
    pinned = [t for t in found.consistency.tests if t.column == "kind" and ".mean" in t.of]
    assert len(pinned) == 4
    assert min(test.p for test in pinned) > 0.5
    assert found.consistent
