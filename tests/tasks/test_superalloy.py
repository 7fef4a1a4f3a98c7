"""Intervals of a random fatigue limit from 26 lives, whose ends need more nodes than the answer."""

import io

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, special, stats

from aleator import (
    Censoring,
    Check,
    Constant,
    Experiments,
    Free,
    GradientMultistart,
    Inputs,
    Noise,
    Normal,
    identify,
)
from aleator.core.types import Array

# low-cycle fatigue of a nickel-base superalloy (Nelson, 1984): stress, thousands of cycles, and
# whether the specimen broke
LIVES = """
80.3 211.629 broke, 80.6 200.027 broke, 80.8 57.923 ran, 84.3 155.000 broke, 85.2 13.949 broke,
85.6 112.968 ran, 85.8 152.680 broke, 86.4 156.725 broke, 86.7 138.114 ran, 87.2 56.723 broke,
87.3 121.075 broke, 89.7 122.372 ran, 91.3 112.002 broke, 99.8 43.331 broke, 100.1 12.076 broke,
100.5 13.181 broke, 113.0 18.067 broke, 114.8 21.300 broke, 116.4 15.616 broke, 118.0 13.030 broke,
118.4 8.489 broke, 118.6 12.434 broke, 120.4 9.750 broke, 142.5 11.865 broke, 144.5 6.705 broke,
145.9 5.733 broke
"""
TABLE = pd.read_csv(
    io.StringIO(LIVES.replace(",", "\n")), sep=r"\s+", names=["stress", "kilocycles", "ended"]
)
START = np.array([4.26, 0.05, 9.5, -1.8, 0.55])
Z = np.linspace(-8.0, 8.0, 2001)


def kilocycles(stress: Array, v: Array, b0: Array, b1: Array) -> Array:
    with np.errstate(divide="ignore"):
        return np.exp(b0 + b1 * np.log(np.maximum(stress - np.exp(v), 0.0)))


def log_likelihood(alpha: Array) -> float:
    """By a sum over a fine grid of fatigue limits."""
    mean, sd, b0, b1, noise = alpha
    stress, broke = TABLE["stress"].to_numpy()[:, None], (TABLE["ended"] == "broke").to_numpy()
    with np.errstate(divide="ignore", invalid="ignore"):
        eta = b0 + b1 * np.log(np.maximum(stress - np.exp(mean + sd * Z), 0.0))
        u = (np.log(TABLE["kilocycles"].to_numpy())[:, None] - eta) / noise
    density = stats.norm.logpdf(u) - np.log(noise)
    each = np.where(broke[:, None], density, stats.norm.logsf(u))
    return float(special.logsumexp(each + stats.norm.logpdf(Z) + np.log(Z[1] - Z[0]), axis=1).sum())


def maximum(start: Array, held: dict[int, float]) -> float:
    """The largest log-likelihood where some hyperparameters are held."""
    moving = [k for k in range(5) if k not in held]

    def lost(some: Array) -> float:
        alpha = start.copy()
        alpha[list(held)], alpha[moving] = list(held.values()), some
        alpha[[1, 4]] = np.maximum(alpha[[1, 4]], 0.005)
        return -log_likelihood(alpha)

    options = {"fatol": 1e-5, "xatol": 1e-4, "maxiter": 2000}
    found = optimize.minimize(lost, start[moving], method="Nelder-Mead", options=options)
    found = optimize.minimize(lost, found.x, method="Nelder-Mead", options=options)
    return float(-found.fun)


def test_an_end_that_needs_more_nodes_than_the_answer_is_found_and_a_limit_is_told() -> None:
    found = identify(
        kilocycles,
        Experiments.from_frame(
            TABLE, outcome="kilocycles", transform="log",
            censored=Censoring("ended", right="ran", measured="broke"),
        ),
        Inputs({
            "v": Normal(Free(3.5, 4.6), Free(0.005, 0.5)),
            "b0": Constant(Free(0.0, 30.0)), "b1": Constant(Free(-8.0, -0.1)),
        }),
        noise=Noise(Free(0.01, 1.5)), vectorized=True, search=GradientMultistart(starts=1),
        verification=Check(0), consistency=False, best_law=False,
    )  # fmt: skip
    top = maximum(START, {})
    assert found.log_likelihood.estimated == pytest.approx(top, abs=0.005)
    mean = found.alpha["v.mean"]
    assert mean.interval is not None
    assert (mean.cut, mean.interval[0]) == ("lower", 3.5)
    at_limit = maximum(np.array([3.5, 0.11, 20.7, -4.05, 0.62]), {0: 3.5})
    assert mean.drops is not None
    assert mean.drops[0] == pytest.approx(top - at_limit, abs=0.02)
    assert "to its lower limit (drop 1.26)" in " ".join(str(found).split())
    beyond = maximum(np.array([4.4, 0.057, 6.4, -1.1, 0.45]), {0: mean.interval[1]})
    assert top - beyond == pytest.approx(1.92, abs=0.05)
