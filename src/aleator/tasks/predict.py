"""The distribution of what would be measured under conditions that were never tested."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import pandas as pd

from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.observations.errors import Noise
from aleator.observations.experiments import Conditions
from aleator.observations.responses import responses_of
from aleator.progress import Progress
from aleator.results.values import QUANTILES, Estimate, in_order
from aleator.surrogates import ResponseSurface
from aleator.tasks import individual
from aleator.tasks.asked import DEFAULT_PROPAGATION, AnySimulator, runner_on
from aleator.tasks.outcome import predicted

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


def predict(
    simulator: AnySimulator,
    conditions: Conditions | pd.DataFrame,
    inputs: Inputs,
    alpha: Mapping[str, float | Estimate],
    *,
    vectorized: bool = False,
    noise: Noise | Mapping[str, Noise] | None = None,
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
    density: Density | None = None,
    quantiles: tuple[float, ...] = QUANTILES,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Mean, standard deviation and quantiles of what would be measured under the law alpha.

    `alpha` maps the name of every hyperparameter to its value; the `alpha` of an Identification
    will do. Measurement noise is part of it; with a "log" transform it is of the logarithm. Rows
    of `conditions` with the same id are one new experiment; a data frame has the responses of the
    `noise`, if that is one for each. Returns a table with a row for each row and response: id,
    mean, standard_deviation, skewness, kurtosis, a column ``q<p>`` for each quantile, and a status.
    Raises InputsError where alpha lacks a hyperparameter or has an unknown one, and where a law
    follows covariates: `Identification.predict` knows what their formula was resolved by. Cost:
    of a slow simulator the runs of one response surface for each condition, built around the law.

    >>> from aleator.laws import Normal
    >>> table = predict(lambda load, x: load * x, pd.DataFrame({"load": [10.0]}),
    ...                 Inputs({"x": Normal(1.0, 0.1)}), {"x.mean": 1.0, "x.sd": 0.1})
    >>> table[["mean", "standard_deviation", "q0.5"]].round(6).to_numpy().tolist()
    [[10.0, 1.0, 10.0]]
    """
    if isinstance(conditions, pd.DataFrame):
        named = responses_of([*noise]) if isinstance(noise, Mapping) else ()
        conditions = Conditions.from_frame(conditions, responses=named)
    runner = runner_on(simulator, conditions, inputs.names, vectorized)
    if individual.wanted(conditions, inputs, noise):
        return individual.predicted(
            runner, conditions, inputs, noise, propagation, density, alpha, quantiles, progress
        )
    model = Model.of(inputs, propagation, density)
    return predicted(runner, model, in_order(alpha, model.hyperparameters), quantiles, progress)
