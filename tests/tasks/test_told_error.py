"""The error told of the log-likelihood that was verified on the simulator, against a fine sum."""

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged
from scipy import special, stats

from aleator import Experiments, Free, Inputs, LogNormal, Noise, Normal, ResponseSurface
from aleator.core.types import Array

Z = np.linspace(-8.0, 8.0, 4001)
TIME = np.tile([0.5, 1.2, 2.5], 40)
ROWS = np.repeat(np.arange(40), 3)
NOISE, SD = 0.05, 0.6


def decay(time: Array, rate: Array) -> Array:
    return np.exp(-rate * time)


@pytest.mark.parametrize("law", [Normal, LogNormal])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_verified_log_likelihood_is_as_exact_as_told(law, seed) -> None:  # type: ignore[no-untyped-def]
    rng = np.random.default_rng(seed)
    rates = np.exp(SD * rng.standard_normal(40))
    y = decay(TIME, rates[ROWS]) + NOISE * rng.standard_normal(120)
    frame = pd.DataFrame({"id": [f"e{k}" for k in ROWS], "time": TIME, "y": y})
    inputs = Inputs({"rate": law(Free(0.2, 4.0), Free(0.01, 2.0))})
    found = unjudged(
        decay, Experiments.from_frame(frame, outcome="y"), inputs, noise=Noise(NOISE),
        vectorized=True, propagation=ResponseSurface(surfaces="own"),
    )  # fmt: skip
    alpha = np.array([found.values["rate.mean"], found.values["rate.sd"]])
    x = inputs.sample(alpha, special.ndtr(Z)[:, None])[:, 0]
    each = stats.norm.logpdf(y[:, None], decay(TIME[:, None], x), NOISE)
    of_experiment = np.add.reduceat(each, np.arange(0, 120, 3))
    weight = stats.norm.logpdf(Z) + np.log(Z[1] - Z[0])
    exact = special.logsumexp(of_experiment + weight, axis=1).sum()
    told = found.log_likelihood
    assert told.verified is not None
    assert told.verified_standard_error is not None
    assert told.verified_standard_error < 0.01
    assert abs(told.verified - exact) < 3.0 * told.verified_standard_error
