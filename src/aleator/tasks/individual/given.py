"""Predictions under a law that is given, and was not identified here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.errors import InputsError
from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.laws.inputs import Inputs
from aleator.observations.errors import Noise, noise_hyperparameters
from aleator.observations.experiments import Conditions
from aleator.progress import Progress
from aleator.results.values import Estimate, in_order
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.tasks.asked import surfaces_alone
from aleator.tasks.direct import Way, way_of
from aleator.tasks.individual.population import FAR, held_region
from aleator.tasks.individual.session import IndividualSession
from aleator.types import Array

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


def predicted(
    runner: Runner,
    conditions: Conditions,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise] | None,
    propagation: ResponseSurface | Collocation,
    density: Density | None,
    values: Mapping[str, float | Estimate],
    quantiles: tuple[float, ...],
    progress: Progress | None,
) -> pd.DataFrame:
    """A row for each row of the conditions and response, by the simulator itself or surfaces of it.

    Its `attrs["propagation_reason"]` says which of these two, and why.
    Raises InputsError for a law that follows covariates by a formula that no table has resolved,
    and as `surfaces_alone`.
    """
    surfaces = surfaces_alone(propagation, density)
    if inputs.regressed and inputs.covariate_model is None:
        raise InputsError(
            f"the law follows {', '.join(inputs.covariates)}, by a formula that the experiments "
            "resolved which it was identified from",
            "ask the identification: found.predict(...), or aleator.load(...).predict(...)",
        )
    names = conditions.observations.names
    known = (*inputs.hyperparameters, *noise_hyperparameters(noise, names))
    alpha = in_order(values, known)[: inputs.size]
    way = _way(runner, surfaces, inputs, alpha, len(conditions.ids))
    session = IndividualSession(
        inputs, noise, conditions.responses, None, lambda _: runner, None, way.direct, surfaces,
    )  # fmt: skip
    at = AlphaDraws.at(in_order(values, known))
    found = session.predict(conditions, at, conditions.transform, quantiles, progress)
    found.attrs["propagation_reason"] = way.reason
    return found


def _way(
    runner: Runner, choice: ResponseSurface, inputs: Inputs, alpha: Array, experiments: int
) -> Way:
    middle = np.zeros((experiments, len(inputs.classes), inputs.scattering))
    x = inputs.individual(alpha, middle, slice(0, experiments)).x[0, 0]
    return way_of(runner, choice, x, held_region(inputs, [alpha], experiments, FAR))
