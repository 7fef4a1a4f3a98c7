"""The task `predict`: the distribution of a measurement under conditions that were not tested."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.core.progress import Progress
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.fit.question import DEFAULT_PROPAGATION, Way, is_exact, surfaces_alone, way_of
from aleator.fit.regions import REGIONS, region_of
from aleator.inference.alpha_draws import AlphaDraws
from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.observations.experiments import Conditions
from aleator.results.values import Estimate, in_order
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.arguments import AnyNoise, Columns, Laws, conditions_in, inputs_of, noise_of
from aleator.tasks.prediction import PREDICTION
from aleator.tasks.runs import AnySimulator, runner_on
from aleator.tasks.session import Session

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


def predict(
    simulator: AnySimulator,
    at: Conditions | pd.DataFrame | Columns,
    inputs: Laws,
    alpha: Mapping[str, float | Estimate],
    *,
    vectorized: bool | None = None,
    noise: AnyNoise = None,
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
    density: Density | None = None,
    quantiles: tuple[float, ...] = PREDICTION.quantiles,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """The mean, standard deviation and quantiles of a measurement under the law alpha.

    `at` are the conditions: a mapping from names to values, or to lists of one length, or a table.
    `alpha` maps the name of every hyperparameter to its value, as the `alpha` of an Identification
    does. Measurement noise is included. With a "log" transform the prediction is that of the
    logarithm. Rows with the same id are one new experiment. If `noise` is a mapping by outcome, the
    simulator has these outcomes. Returns a table with a row for each row and outcome: the
    conditions, outcome, mean, standard_deviation, skewness, kurtosis, a column ``q<p>`` for each
    quantile, and a status.

    Raises InputsError if alpha lacks a hyperparameter or has an unknown one. Raises it also if a
    law depends on covariates; use `Identification.predict` then. Cost: with a slow simulator the
    runs of one response surface for each condition, near the law.

    >>> from aleator.laws import Normal
    >>> table = predict(lambda load, x: load * x, {"load": 10.0}, {"x": Normal(1.0, 0.1)},
    ...                 {"x.mean": 1.0, "x.sd": 0.1})
    >>> table[["load", "mean", "standard_deviation", "q0.5"]].round(6).to_numpy().tolist()
    [[10.0, 10.0, 1.0, 10.0]]
    """
    inputs, noise = inputs_of(inputs), noise_of(noise)
    conditions = conditions_in(at, "at", noise)
    runner = runner_on(simulator, conditions, inputs.names, vectorized)
    asked = (inputs, noise, conditions.responses, None, lambda _: runner, None)
    if is_exact(conditions, inputs, noise):
        model = Model.of(inputs, propagation, density)
        session, reason = Session(*asked, model=model), None
        known = in_order(alpha, session.hyperparameters)
    else:
        surfaces = surfaces_alone(propagation, density)
        _require_resolved(inputs)
        known = in_order(alpha, Session(*asked).hyperparameters)
        way = _way(runner, surfaces, inputs, known[: inputs.size], len(conditions.ids))
        session, reason = Session(*asked, way.direct, surfaces), way.reason
    found = session.predict(conditions, AlphaDraws.at(known), quantiles, progress)
    if reason is not None:
        found.attrs["propagation_reason"] = reason
    return found


def _require_resolved(inputs: Inputs) -> None:
    """Raise InputsError for a law with a covariate formula that no table of experiments resolved.

    A formula is resolved when the levels and ranges of its covariates are taken from a table.
    """
    if inputs.regressed and inputs.covariate_model is None:
        raise InputsError(
            f"the law follows {', '.join(inputs.covariates)}, by a formula that the experiments "
            "resolved which it was identified from",
            "ask the identification: found.predict(...), or aleator.load(...).predict(...)",
        )


def _way(
    runner: Runner, choice: ResponseSurface, inputs: Inputs, alpha: Array, experiments: int
) -> Way:
    middle = np.zeros((experiments, len(inputs.classes), inputs.scattering))
    x = inputs.individual(alpha, middle, slice(0, experiments)).x[0, 0]
    return way_of(runner, choice, x, region_of(inputs, [alpha], experiments, REGIONS.far))
