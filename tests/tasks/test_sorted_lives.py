"""Lives as books print them: sorted, and most of them bounds."""

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats

from aleator import Censoring, Check, Constant, Experiments, Free, Inputs, Noise, identify
from aleator.core.types import Array


def life(log_life: Array) -> Array:
    return np.exp(log_life)


def test_sorted_lives_with_bounds_do_not_drift() -> None:
    rng = np.random.default_rng(6)
    lives, stopped = np.exp(rng.normal(10.0, 0.5, 40)), np.exp(rng.normal(9.7, 0.4, 40))
    km, runs = np.minimum(lives, stopped), lives > stopped
    order = np.argsort(km)
    km, runs = km[order], runs[order]
    frame = pd.DataFrame({"km": km, "ended": np.where(runs, "running", "failed")})
    found = identify(
        life,
        Experiments.from_frame(
            frame, outcome="km", transform="log", censored=Censoring("ended", right="running")
        ),
        Inputs({"log_life": Constant(Free(6.0, 14.0))}),
        noise=Noise(Free(0.01, 3.0)),
        vectorized=True,
        verification=Check(0),
        best_law=False,
    )

    def minus(p: Array) -> float:
        u = (np.log(km) - p[0]) / np.exp(p[1])
        return -float(np.where(runs, stats.norm.logsf(u), stats.norm.logpdf(u) - p[1]).sum())

    exact = optimize.minimize(minus, (10.0, -0.5))
    assert found.log_likelihood.estimated == pytest.approx(-exact.fun, abs=1e-3)
    assert found.values["log_life.value"] == pytest.approx(exact.x[0], abs=1e-3)
    assert found.consistent
