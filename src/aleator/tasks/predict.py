"""The distribution of the outcome under conditions that were never tested."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from aleator.densities import Density, NodeDensity, Status
from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.likelihood.propagation import Collocation
from aleator.observations.experiments import Conditions
from aleator.observations.noise import Noise
from aleator.progress import Progress
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.asked import DEFAULT_PROPAGATION, AnySimulator, runner_on
from aleator.tasks.refinement import under_law
from aleator.tasks.results.values import QUANTILES, Estimate, in_order
from aleator.types import Array


def predict(
    simulator: AnySimulator,
    conditions: Conditions | pd.DataFrame,
    inputs: Inputs,
    alpha: Mapping[str, float | Estimate],
    *,
    vectorized: bool = False,
    noise: Noise | None = None,
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
    density: Density | NodeDensity | None = None,
    quantiles: tuple[float, ...] = QUANTILES,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Mean, standard deviation and quantiles of the outcome for new conditions under the law alpha.

    `alpha` maps the name of every hyperparameter to its value; the `alpha` of an Identification
    will do. The outcome includes measurement noise; with a "log" transform it is the logarithm.
    Returns a table with a row for each condition: id, mean, standard_deviation, skewness,
    kurtosis, a column ``q<p>`` for each quantile, and the density's status. Raises InputsError
    where alpha lacks a hyperparameter or has an unknown one. Cost: the runs of one response
    surface for each condition, built around the law.

    >>> from aleator.laws import Normal
    >>> table = predict(lambda load, x: load * x, pd.DataFrame({"load": [10.0]}),
    ...                 Inputs({"x": Normal(1.0, 0.1)}), {"x.mean": 1.0, "x.sd": 0.1})
    >>> table[["mean", "standard_deviation", "q0.5"]].round(6).to_numpy().tolist()
    [[10.0, 1.0, 10.0]]
    """
    model = Model.of(inputs, noise, propagation, density)
    values = in_order(alpha, model.hyperparameters)
    runner = runner_on(simulator, conditions, inputs.names, vectorized)
    return predicted(runner, model, values, quantiles, progress)


def predicted(
    runner: Runner,
    model: Model,
    alpha: Array,
    quantiles: tuple[float, ...] = QUANTILES,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """The table of `predict` for the conditions of a runner, under the law alpha (K,)."""
    ready = under_law(runner, model, alpha, progress)
    moments, fitted = ready.predictive.moments(alpha), ready.predictive.fitted(alpha)
    if model.open and np.any(fitted.status == Status.TOO_COARSE):
        fitted = ready.by(model.by_moments()).predictive.fitted(alpha)
    found = fitted.quantile(np.array(quantiles))
    columns: dict[str, Any] = {
        "id": list(runner.ids),
        "mean": moments.mean,
        "standard_deviation": moments.sd,
        "skewness": moments.standardized[:, 3],
        "kurtosis": moments.standardized[:, 4],
    }
    columns |= {f"q{p:g}": found[:, i] for i, p in enumerate(quantiles)}
    columns["status"] = [Status(int(code)).name.lower() for code in fitted.status]
    return pd.DataFrame(columns)
