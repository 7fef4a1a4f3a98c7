"""Virtual observations: what would be measured of new experiments under a law that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aleator.laws.individual import drawn
from aleator.laws.inputs import Inputs
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Experiments
from aleator.observations.responses import Observations
from aleator.simulators import Runner
from aleator.types import Array


def virtual_observations(
    runner: Runner,
    table: Experiments,
    inputs: Inputs,
    errors: MeasurementErrors,
    alpha: Array,
    rng: np.random.Generator,
) -> Observations:
    """Observations at the conditions of a table under the law and the noise of alpha (K,).

    One run a unit. Bounds are made as those of the table: see `censored_alike`. Values whose runs
    fail are NaN: they are not measured.
    """
    seen = table.observations
    x = drawn(inputs, alpha[: inputs.size], len(table.ids), rng)
    units, place = np.unique(runner.unit, return_inverse=True)
    values = runner.values(units, x[runner.experiment[units]])
    eta = values[place, runner.column][:, None]
    uniform = rng.random(eta.shape)
    with np.errstate(invalid="ignore"):
        y = errors.quantile(alpha[inputs.size :], uniform, eta, slice(0, len(seen)))[:, 0]
    return censored_alike(seen, y, rng)


def censored_alike(seen: Observations, y: Array, rng: np.random.Generator) -> Observations:
    """Values y (M,) with bounds like those of the observations that were seen.

    Where all right-censored values of a response have one bound, that is a limit of the test: every
    value above it is censored. Where their bounds differ, only those values are censored that were,
    if they lie above their own bound again. Left-censored values alike. An interval is one of the
    same width, thrown about the value.
    """
    lower, upper = y.copy(), y.copy()
    for right in (True, False):
        known, other = (seen.lower, seen.upper) if right else (seen.upper, seen.lower)
        censored = np.isinf(other) & np.isfinite(known)
        bound = np.where(censored, known, np.nan)
        for k in range(len(seen.responses)):
            own = seen.response == k
            bounds = np.unique(bound[own & censored])
            if bounds.size == 1:
                bound[own] = bounds[0]
        with np.errstate(invalid="ignore"):
            beyond = y > bound if right else y < bound
        lower[beyond] = bound[beyond] if right else -np.inf
        upper[beyond] = np.inf if right else bound[beyond]
    between = np.isfinite(seen.lower) & np.isfinite(seen.upper) & ~seen.measured
    width = np.where(between, seen.upper - seen.lower, 0.0)
    below = width * rng.random(len(y))
    lower[between] = (y - below)[between]
    upper[between] = (y - below + width)[between]
    return replace(seen, lower=lower, upper=upper)
