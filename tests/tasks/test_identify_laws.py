"""Every law identified from start to end, held to the exact likelihood that SciPy maximizes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import (
    Beta,
    Check,
    Constant,
    Free,
    Gamma,
    Inputs,
    LogNormal,
    Noise,
    Normal,
    ScipyLaw,
    Uniform,
)
from aleator.core.types import Array
from aleator.fit.question import start_point
from aleator.fit.search import linear_gaussian
from aleator.laws import Law
from aleator.search import GradientMultistart

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


def identified(y: Array, inputs: Inputs, simulator: Callable[..., Array]) -> Any:
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
    found = identified(y, Inputs({"x": law}), lambda z, x: z * x)
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
    found = identified(y, inputs, lambda z, x, b: b + z * x)
    t, w = np.polynomial.legendre.leggauss(300)
    x, weights = WEIBULL.ppf(stats.norm.cdf(8.0 * t)), 8.0 * w * stats.norm.pdf(8.0 * t)

    def negative(b: float) -> float:
        density = stats.norm.pdf(y[:, None], b + Z[:, None] * x, NOISE) @ weights
        return -float(np.sum(np.log(density)))

    exact = optimize.minimize_scalar(negative, bounds=(0.0, 3.0), method="bounded")
    one = found.alpha["b.value"]
    assert one.estimate == pytest.approx(exact.x, abs=0.05 * one.standard_error)
    assert found.log_likelihood.estimated == pytest.approx(-exact.fun, abs=0.05)


class Line:
    """eta = z x + b."""

    def evaluate(self, x: Array) -> Array:
        return Z[:, None] * x[:, 0] + x[:, 1]

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        slope = np.stack([np.repeat(Z[:, None], len(x), axis=1), np.ones((COUNT, len(x)))], axis=2)
        return self.evaluate(x), slope


@pytest.mark.parametrize(
    "law",
    [ScipyLaw(WEIBULL), Gamma(MEAN, 0.4), Normal(MEAN, SD)],
    ids=lambda law: type(law).__name__,
)
def test_the_linear_gaussian_law_takes_any_law(law: Law) -> None:
    """Its log-likelihood is that of Normal(z m + b, z^2 s^2) with the law's m and s."""
    inputs = Inputs({"x": law, "b": Constant(Free(-5.0, 5.0))})
    y = 1.0 + Z * WEIBULL.rvs(size=COUNT, random_state=np.random.default_rng(1))
    x0 = start_point(inputs)
    value, slope = (part[:, 0] for part in Line().evaluate_with_gradient(x0[None]))
    found = linear_gaussian(inputs, x0, value, slope, y, GradientMultistart(3), seed=0)
    *own, b = found.alpha
    moments = law.mean_and_sd(np.array(own))
    truth = stats.norm.logpdf(y, Z * moments.mean + b, Z * moments.sd).sum()
    assert found.log_likelihood == pytest.approx(truth, abs=1e-9)
