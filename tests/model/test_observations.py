"""Observation models: log p(y | eta, scale), and identifications by the integral over the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats

from aleator import Convolution, Free, Inputs, MaximumEntropy, MonteCarlo, Noise, Normal, identify
from aleator.densities.outcomes import Outcomes
from aleator.errors import InputsError
from aleator.likelihood.integral import NodeIntegral
from aleator.likelihood.model import Model
from aleator.observations.model import Observed
from aleator.observations.normal import NormalError


@dataclass(frozen=True)
class LaplaceError:
    """exp(-|y - eta|/scale)/(2 scale)."""

    name: str = "laplace"
    reach: float = float("inf")

    def log_density(self, y, eta, scale) -> Observed:
        u = (y - eta) / scale
        return Observed(
            -np.abs(u) - np.log(2.0 * scale), np.sign(u) / scale, (np.abs(u) - 1.0) / scale
        )

    def cdf(self, y, eta, scale):
        return stats.laplace.cdf(y, eta, scale)

    def quantile(self, probability, eta, scale):
        return stats.laplace.ppf(probability, eta, scale)

    def moments(self, order):
        return np.array([1.0, 0.0, 2.0, 0.0, 24.0])[: order + 1]


def normal_laplace(y, mean, sd, scale):
    """log density of Normal(mean, sd^2) + Laplace(scale) in closed form (Reed, 2006)."""
    u, r = (y - mean) / sd, sd / scale
    ends = [stats.norm.logcdf(-(r + s * u)) + 0.5 * (r + s * u) ** 2 for s in (1.0, -1.0)]
    return stats.norm.logpdf(u) + np.logaddexp(*ends) - np.log(2.0 * scale) + HALF_LOG_2_PI


HALF_LOG_2_PI = 0.5 * np.log(2.0 * np.pi)


@pytest.mark.parametrize("kind", [NormalError(), LaplaceError()], ids=lambda kind: kind.name)
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


def test_the_integral_over_nodes_is_the_sum_of_the_convolution() -> None:
    rng = np.random.default_rng(0)
    nodes = Outcomes(rng.normal(size=(3, 200)), np.full(200, 1.0 / 200))
    y = np.array([0.1, -0.4, 1.3])
    one = NodeIntegral(NormalError()).fit_nodes(nodes, 0.5, -np.inf, np.inf)
    two = Convolution().fit_nodes(nodes, 0.5, -np.inf, np.inf)
    np.testing.assert_allclose(one.log_pdf(y), two.log_pdf(y), rtol=1e-12)
    np.testing.assert_allclose(one.cdf(y), two.cdf(y), rtol=1e-12)
    np.testing.assert_allclose(one.quantile([0.1, 0.9]), two.quantile([0.1, 0.9]), rtol=1e-9)
    a, b = one.node_sensitivity(y), two.node_sensitivity(y)
    for part in ("value", "d_y", "d_weights", "d_noise"):
        np.testing.assert_allclose(getattr(a, part), getattr(b, part), rtol=1e-9, atol=1e-12)


def test_noise_of_another_kind_is_identified_exactly() -> None:
    """y = z x + e with x normal and e Laplace: the maximum of the closed form, by another way."""
    rng = np.random.default_rng(3)
    z = np.tile([0.5, 1.0, 2.0, 3.0], 30)
    y = z * rng.normal(1.0, 0.2, z.size) + rng.laplace(0.0, 0.15, z.size)
    law = Inputs({"x": Normal(mean=Free(0.5, 1.5), sd=Free(0.02, 1.0))})
    found = identify(
        lambda z, x: z * x, pd.DataFrame({"z": z, "y": y}), law, outcome="y",
        noise=Noise(Free(0.02, 1.0), LaplaceError()), verification=MonteCarlo(20_000),
    )  # fmt: skip

    def lost(alpha):
        return -normal_laplace(y, z * alpha[0], z * alpha[1], alpha[2]).sum()

    best = optimize.minimize(lost, [1.0, 0.2, 0.15], method="Nelder-Mead", options={"xatol": 1e-7})
    assert found.log_likelihood.estimated == pytest.approx(-best.fun, abs=0.005)
    for estimate, value in zip(found.alpha.values(), best.x, strict=True):
        assert abs(estimate.estimate - value) < 0.05 * estimate.standard_error
    assert found.accepted
    verified = found.log_likelihood
    assert abs(verified.verified - verified.estimated) < 4.0 * verified.verified_standard_error


def test_a_density_of_moments_does_not_take_noise_of_another_kind() -> None:
    inputs = Inputs({"x": Normal(0.0, 1.0)})
    with pytest.raises(InputsError, match="laplace"):
        Model.of(inputs, Noise(0.1, LaplaceError()), density=MaximumEntropy(4))
