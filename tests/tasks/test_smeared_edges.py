"""Exact surfaces of a density that ends: the check's kernel smears the end, and refuses nothing."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import optimize, stats

from aleator import Budget, Free, Inputs, TruncatedNormal
from aleator.core.types import Array

NARROW = 0.005
"""Standard deviation of what is added to the outcome, a fortieth of the other law's."""
PEAK, WIDTH, FIRST = 1.5, 0.25, 0.6
"""The first experiment's outcome is largest at the peak, and was measured there."""


def simulator(load: Array, a: Array, z: Array) -> Array:
    peaked = 1.0 / (1.0 + ((a - PEAK) / WIDTH) ** 2)
    return np.where(load < FIRST, peaked, load * a) + z


def exact_loss(load: Array, y: Array, alpha: Array) -> float:
    """Minus the log-likelihood, z left out of each outcome by its own density."""
    mean, sd, shift = alpha
    a = np.linspace(mean - 8.0 * sd, mean + 8.0 * sd, 4001)
    weight = stats.norm.pdf(a, mean, sd) * (a[1] - a[0])
    rest = y[:, None] - simulator(load[:, None], a, 0.0) - shift
    return -float(np.sum(np.log(stats.norm.pdf(rest, 0.0, NARROW) @ weight + 1e-300)))


def test_a_right_answer_is_sound_where_the_kernel_smears_the_end_of_a_density() -> None:
    rng, load = np.random.default_rng(1), np.linspace(0.5, 2.0, 10)
    a = 1.0 + 0.2 * rng.standard_normal(10)
    z = NARROW * rng.standard_normal(10)
    a[0], z[0] = PEAK, 0.0
    y = simulator(load, a, z)
    laws = {
        "a": TruncatedNormal((0.2, 2.0), Free(0.5, 1.5), Free(0.02, 0.6)),
        "z": TruncatedNormal((-0.2, 0.2), Free(-0.1, 0.1), NARROW),
    }
    found = unjudged(
        simulator, pd.DataFrame({"load": load, "y": y}), Inputs(laws), outcome="y",
        vectorized=True, budget=Budget(runs=10**9),
    )  # fmt: skip
    alpha = [found.alpha[name] for name in ("a.mean", "a.sd", "z.mean")]
    estimates = np.array([e.estimate for e in alpha])
    truth = optimize.minimize(
        lambda p: exact_loss(load, y, p), estimates, method="Nelder-Mead",
        bounds=[(0.5, 1.5), (0.02, 0.6), (-0.1, 0.1)],
    )  # fmt: skip
    errors = np.array([e.standard_error for e in alpha], dtype=float)
    assert np.abs((estimates - truth.x) / errors).max() < 0.1
    assert found.log_likelihood.estimated == pytest.approx(-truth.fun, abs=0.02)
    assert found.sound
