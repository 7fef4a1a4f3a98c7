"""Springs of random softness: a linear model whose information is known in closed form."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
from identifications import unjudged

from aleator import (
    Check,
    Free,
    Identification,
    Inputs,
    Noise,
    Normal,
)
from aleator.core.types import Array

NOISE = 0.5
CANDIDATES = np.array([0.5, 1.0, 2.0, 5.0, 20.0])


def springs(load: Array, x: Array) -> Array:
    return np.asarray(load * x)


def data(scatter: float) -> pd.DataFrame:
    rng = np.random.default_rng(0)
    loads = np.repeat([1.0, 2.0, 3.0], 12)
    x = 1.0 + scatter * rng.standard_normal(loads.size)
    # errors that happen to be small leave no room for scatter
    errors = (NOISE if scatter else 0.8 * NOISE) * rng.standard_normal(loads.size)
    return pd.DataFrame({"load": loads, "y": loads * x + errors})


@cache
def found_with(scatter: float = 0.4, noisy: bool = True) -> Identification:
    table = data(scatter)
    if not noisy:
        table["y"] = table["load"] * (1.0 + scatter * np.random.default_rng(1).standard_normal(36))
    return unjudged(
        springs,
        table,
        Inputs({"x": Normal(Free(-3.0, 3.0), Free(0.01, 1.5))}),
        outcome="y",
        noise=Noise(NOISE) if noisy else None,
        vectorized=True,
        verification=Check(0),
    )


def closed_form(found: Identification, loads: Array) -> Array:
    """Information (C, 2, 2) of mean and sd in y ~ N(load mean, load^2 sd^2 + noise^2).

    (dm)^2/v + (dv)^2/(2 v^2): that of the sd grows with (load sd)^2 against the noise.
    """
    sd = float(found.values["x.sd"])
    variance = loads**2 * sd**2 + NOISE**2
    information = np.zeros((loads.size, 2, 2))
    information[:, 0, 0] = loads**2 / variance
    information[:, 1, 1] = 0.5 * (2.0 * loads**2 * sd / variance) ** 2
    return information


def observed(found: Identification) -> Array:
    return np.asarray(np.linalg.inv(found.covariance.to_numpy()))


def asked(loads: Array = CANDIDATES) -> pd.DataFrame:
    return pd.DataFrame({"load": loads})
