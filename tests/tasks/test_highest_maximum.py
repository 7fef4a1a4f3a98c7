"""The maximum that is told is the highest, where a search with few nodes prefers another."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import Free, Inputs, Noise, TruncatedNormal
from aleator.core.types import Array

BOX = (0.5, 2.0)
GRID = np.linspace(*BOX, 15_001)


def peak(c: Array, a: Array) -> Array:
    """The resonance of an oscillator of natural frequency a with a damping of 0.05."""
    return 1.0 / np.sqrt((1.0 - (c / a) ** 2) ** 2 + (0.1 * c / a) ** 2)


def within(mean: float, sd: float) -> object:
    return stats.truncnorm((BOX[0] - mean) / sd, (BOX[1] - mean) / sd, mean, sd)


def log_likelihood(alpha: Array, c: Array, y: Array) -> float:
    """By the trapezoidal rule on 15,001 points of a."""
    mean, sd, noise = alpha
    law = within(mean, sd).pdf(GRID)
    density = stats.norm.pdf(y[:, None], peak(c[:, None], GRID), noise) * law
    return float(np.sum(np.log(np.trapezoid(density, GRID, axis=1))))


def test_no_climb_from_another_noise_ends_higher() -> None:
    """Fifteen experiments hardly tell noise from scatter: there are maxima at many noises."""
    rng = np.random.default_rng(1017)
    c = rng.uniform(0.8, 1.6, 15)
    a = within(1.2, 0.1).ppf(stats.norm.cdf(rng.standard_normal(15)))
    y = peak(c, a) + rng.normal(0.0, 0.02, 15)
    found = unjudged(
        peak,
        pd.DataFrame({"c": c, "y": y}),
        Inputs({"a": TruncatedNormal(BOX, Free(), Free())}),
        outcome="y",
        noise=Noise(Free(0.002, 1.0)),
        vectorized=True,
        seed=0,
    )
    told = log_likelihood(np.array([e.estimate for e in found.alpha.values()]), c, y)
    highest = [
        -optimize.minimize(
            lambda u: -log_likelihood(np.array([u[0], *np.exp(u[1:])]), c, y),
            [1.195, np.log(0.09), np.log(noise)],
            method="Nelder-Mead",
            options={"xatol": 1e-3, "fatol": 1e-4},
        ).fun
        for noise in (0.02, 0.2)
    ]
    assert told > max(highest) - 2e-3
    assert found.log_likelihood.estimated == pytest.approx(told, abs=2e-3)
