"""Observation models: log p(y | eta, scale), and an identification with one that is not normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import Check, Free, Inputs, Noise, Normal
from aleator.observations.model import NormalError, Observed

TOP = stats.t.logpdf(0.0, 5)


@dataclass(frozen=True)
class StudentError:
    """y = eta + scale t, with t of five degrees of freedom."""

    name: str = "student"

    def log_density(self, y, eta, scale) -> Observed:
        u = (y - eta) / scale
        pull = 6.0 * u / (5.0 + u**2)
        value = TOP - 3.0 * np.log1p(u**2 / 5.0) - np.log(scale)
        return Observed(value, pull / scale, (pull * u - 1.0) / scale)

    def cdf(self, y, eta, scale):
        return stats.t.cdf(y, 5, eta, scale)

    def quantile(self, probability, eta, scale):
        return stats.t.ppf(probability, 5, eta, scale)

    def moments(self, order):
        return np.array([1.0, 0.0, 5.0 / 3.0, 0.0, 25.0])[: order + 1]


def exact(y, z, mean, sd, scale):
    """log of the integral of t5((y - z x)/scale)/scale over x ~ Normal, on a fine grid of x."""
    u = np.linspace(-9.0, 9.0, 801)
    away = (y[:, None] - z[:, None] * (mean + sd * u)) / scale
    each = TOP - 3.0 * np.log1p(away**2 / 5.0) - np.log(scale)
    return np.log(np.trapezoid(np.exp(each + stats.norm.logpdf(u)), u, axis=1))


@pytest.mark.parametrize("kind", [NormalError(), StudentError()], ids=lambda kind: kind.name)
def test_the_derivatives_of_an_observation_model_are_those_of_differences(kind) -> None:
    y, eta, scale, h = np.linspace(-3.0, 4.0, 8), 0.31, 0.7, 1e-6
    value, d_eta, d_scale = kind.log_density(y, eta, scale)
    by_eta = (kind.log_density(y, eta + h, scale)[0] - kind.log_density(y, eta - h, scale)[0]) / 2
    by_scale = (kind.log_density(y, eta, scale + h)[0] - kind.log_density(y, eta, scale - h)[0]) / 2
    np.testing.assert_allclose(d_eta, by_eta / h, atol=1e-7)
    np.testing.assert_allclose(d_scale, by_scale / h, atol=1e-7)
    mass = np.trapezoid(
        np.exp(kind.log_density(np.linspace(-40, 40, 80001), eta, scale)[0]), dx=1e-3
    )
    assert mass == pytest.approx(1.0, abs=1e-5)
    assert value.shape == (8,)


@pytest.mark.slow
def test_noise_of_another_kind_is_identified_exactly() -> None:
    """y = z x + e, x normal and e of Student: the maximum of the exact integral, found by SciPy."""
    rng = np.random.default_rng(3)
    z = np.tile([0.5, 1.0, 2.0, 3.0], 30)
    y = z * rng.normal(1.0, 0.2, z.size) + 0.15 * rng.standard_t(5, z.size)
    law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.02, 1.0))})
    found = unjudged(
        lambda z, x: z * x, pd.DataFrame({"z": z, "y": y}), law, outcome="y", vectorized=True,
        noise=Noise(Free(0.02, 1.0), StudentError()), verification=Check(0),
    )  # fmt: skip

    def lost(alpha):
        return -exact(y, z, *alpha).sum()

    best = optimize.minimize(lost, [1.0, 0.2, 0.15], method="Nelder-Mead", options={"xatol": 1e-7})
    assert found.log_likelihood.estimated == pytest.approx(-best.fun, abs=0.005)
    for estimate, value in zip(found.alpha.values(), best.x, strict=True):
        assert abs(estimate.estimate - value) < 0.01 * estimate.standard_error
    assert found.sound
