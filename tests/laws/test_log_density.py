"""Densities of laws and of the joint law, and the normal scores: against SciPy and closed forms."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from scipy import stats

from aleator import (
    Beta,
    Constant,
    Gamma,
    Inputs,
    LogNormal,
    Normal,
    ScipyLaw,
    TruncatedNormal,
    Uniform,
)
from aleator.laws import Law
from aleator.laws.quadrature import TensorGauss

INF = math.inf
WEIBULL = stats.weibull_min(1.8, loc=-1.0, scale=2.0)

# law, its values, and SciPy's own
LAWS = {
    "normal": (Normal(0.3, 2.0), stats.norm(0.3, 2.0)),
    "lognormal": (
        LogNormal(1.0 + math.exp(0.125), math.exp(0.125) * math.sqrt(math.expm1(0.25)), lower=1.0),
        stats.lognorm(0.5, loc=1.0),
    ),
    "exponential": (Gamma(3.0, 2.0, lower=1.0), stats.expon(1.0, 2.0)),
    "gamma, infinite at its end": (Gamma(0.5, 1.0), stats.gamma(0.25, scale=2.0)),
    "gamma, nearly normal": (Gamma(100.0, 0.5), stats.gamma(4e4, scale=0.0025)),
    "beta": (Beta((-1.0, 3.0), 0.6, 0.8), stats.beta(1.8, 2.7, loc=-1.0, scale=4.0)),
    "uniform": (Uniform.between(-1.0, 0.5), stats.uniform(-1.0, 1.5)),
    "truncated": (TruncatedNormal((-1.0, 1.0), 0.8, 0.5), stats.truncnorm(-3.6, 0.4, 0.8, 0.5)),
    "half normal": (TruncatedNormal((0.0, INF), 0.0, 1.0), stats.halfnorm()),
    "known": (ScipyLaw(WEIBULL), WEIBULL),
}


def values_of(law: Law) -> np.ndarray:
    return np.array([h.start for h in law.hyperparameters])


def beta_values() -> np.ndarray:
    exact = LAWS["beta"][1]
    return np.array([exact.mean(), exact.std()])


def chosen(name: str) -> tuple[Law, np.ndarray, object]:
    law, exact = LAWS[name]
    return law, beta_values() if name == "beta" else values_of(law), exact


@pytest.mark.parametrize("name", LAWS)
def test_the_log_density_is_scipys(name) -> None:
    law, values, exact = chosen(name)
    lower, upper = exact.support()
    inside = exact.ppf(np.linspace(1e-9, 1.0 - 1e-9, 101))
    np.testing.assert_allclose(law.log_density(values, inside), exact.logpdf(inside), atol=1e-9)
    outside = [end for end in (lower - 0.1, upper + 0.1) if math.isfinite(end)]
    assert np.all(law.log_density(values, np.array(outside)) == -INF)


@pytest.mark.parametrize("name", LAWS)
def test_the_normal_score_is_the_inverse_of_the_isoprobabilistic_transform(name) -> None:
    law, values, exact = chosen(name)
    theta = np.linspace(-5.0, 5.0, 41)
    x = law.standard(values, theta).x
    # next to an end of the law x holds few digits of its distance from it
    np.testing.assert_allclose(law.normal_score(values, x), theta, rtol=1e-7, atol=1e-7)
    lower, upper = exact.support()
    if math.isfinite(lower):
        assert law.normal_score(values, np.array([lower - 0.1]))[0] == -INF
    if math.isfinite(upper):
        assert law.normal_score(values, np.array([upper + 0.1]))[0] == INF


@pytest.mark.parametrize(("mean", "sd"), [(-20.0, 1.0), (0.5, 100.0), (30.0, 1.0)])
def test_a_box_far_in_a_tail_keeps_the_digits(mean, sd) -> None:
    """The truncated density by the ratio to its own mass, integrated by 400 Gauss points."""
    law, values = TruncatedNormal((0.0, 1.0), mean, sd), np.array([mean, sd])
    t, w = np.polynomial.legendre.leggauss(400)
    x = 0.5 + 0.5 * t
    assert 0.5 * w @ np.exp(law.log_density(values, x)) == pytest.approx(1.0, rel=1e-11)
    # t - a, of the order of 1e-8 beside 20, holds eight digits
    theta = np.linspace(-5.0, 5.0, 21)
    again = law.normal_score(values, law.standard(values, theta).x)
    np.testing.assert_allclose(again, theta, atol=1e-6)


def test_a_constant_has_all_its_probability_at_its_value() -> None:
    law = Constant(2.0)
    assert law.log_density(np.array([2.0]), np.array([2.0, 2.1])).tolist() == [0.0, -INF]
    assert law.normal_score(np.array([2.0]), np.array([1.0, 2.0, 3.0])).tolist() == [-INF, 0.0, INF]


# ------------------------------------------------------------------------------ the joint law


def test_correlated_normal_parameters_have_the_multivariate_normal_density() -> None:
    inputs = Inputs(
        {"a": Normal(1.0, 2.0), "c": Constant(4.0), "b": Normal(0.0, 0.5), "d": Normal(-1.0, 1.0)},
        {("a", "b"): 0.6, ("b", "d"): -0.7, ("a", "d"): 0.2},
    )
    alpha = np.array([h.start for h in inputs.hyperparameters])
    sd = np.array([2.0, 0.5, 1.0])
    which = [0, 2, 3]
    matrix = inputs.correlation_matrix(alpha)[np.ix_(which, which)]
    exact = stats.multivariate_normal([1.0, 0.0, -1.0], matrix * np.outer(sd, sd))
    x = np.insert(exact.rvs(20, random_state=1), 1, 4.0, axis=1)
    found = inputs.log_density(alpha, x)
    np.testing.assert_allclose(found, exact.logpdf(x[:, which]), rtol=1e-11)
    assert inputs.log_density(alpha, x + np.eye(4)[1]).tolist() == [-INF] * 20


def test_the_density_of_a_copula_is_that_of_its_image() -> None:
    """p(x) |dx/dtheta| = phi(theta; R) at the images of the grid; outside there is nothing."""
    laws = {"u": TruncatedNormal((-1.0, 1.0), 0.8, 0.5), "g": Gamma(1.5, 1.0)}
    inputs = Inputs(laws, {("u", "g"): 0.7})
    alpha = np.array([h.start for h in inputs.hyperparameters])
    theta = np.array(list(product((-2.0, 0.1, 1.5), repeat=2)))
    parts = [
        law.standard(alpha[2 * i : 2 * i + 2], theta[:, i]) for i, law in enumerate(laws.values())
    ]
    x = np.stack([part.x for part in parts], axis=1)
    slope = np.prod([part.dtheta for part in parts], axis=0)
    exact = stats.multivariate_normal(cov=[[1.0, 0.7], [0.7, 1.0]]).logpdf(theta) - np.log(slope)
    np.testing.assert_allclose(inputs.log_density(alpha, x), exact, rtol=1e-9)
    outside = np.array([[-1.5, 1.0], [0.0, -1.0]])
    assert inputs.log_density(alpha, outside).tolist() == [-INF, -INF]


def test_a_moved_and_scaled_law_of_scipy() -> None:
    law, values = ScipyLaw(WEIBULL, 5.0, 0.1), np.array([5.0, 0.1])
    scale = 0.1 / WEIBULL.std()
    x = np.linspace(4.9, 5.2, 7)
    exact = stats.weibull_min(1.8, loc=5.0 - scale * (WEIBULL.mean() + 1.0), scale=2.0 * scale)
    np.testing.assert_allclose(law.log_density(values, x), exact.logpdf(x), rtol=1e-9)


def test_the_mean_of_a_ratio_of_densities_is_one() -> None:
    """E_alpha[p(x | beta)/p(x | alpha)] = 1, as importance sampling needs it."""
    inputs = Inputs({"a": Normal(0.0, 1.0), "b": LogNormal(1.5, 0.6)}, {("a", "b"): 0.5})
    alpha = np.array([0.0, 1.0, 1.5, 0.6, 0.5])
    beta = np.array([0.1, 0.9, 1.4, 0.5, 0.3])
    nodes = TensorGauss(60).nodes(inputs, alpha)
    ratio = np.exp(inputs.log_density(beta, nodes.x) - inputs.log_density(alpha, nodes.x))
    assert nodes.weights @ ratio == pytest.approx(1.0, abs=1e-9)
    # the density of another law is not that of the nodes
    assert nodes.weights @ ratio**2 > 1.01
