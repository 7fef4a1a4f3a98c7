"""Runs of the parameters that are not known, NaN where one fails."""

from __future__ import annotations

import numpy as np

from aleator.errors import InputsError
from aleator.simulators import Runner
from aleator.surrogates.responses import Run, moving_parameters
from aleator.types import Array, Indices


def attempts(runner: Runner, region: Array) -> Run:
    """`run(index (R,), x (R, moving)) -> (R,)` of the distinct conditions, NaN where it fails.

    Of the parameters whose region (n, 2) has a width; the others are known. Raises InputsError
    where all are.
    """
    moving = moving_parameters(region)
    if moving.size == 0:
        raise InputsError(
            "every parameter is known: there is nothing to identify but noise",
            "free a hyperparameter, or give a parameter a law",
        )
    first = runner.cases.first
    known = region[:, 0]

    def run(index: Indices, x: Array) -> Array:
        full = np.tile(known, (x.shape[0], 1))
        full[:, moving] = x
        return runner.attempt(first[index], full)

    return run
