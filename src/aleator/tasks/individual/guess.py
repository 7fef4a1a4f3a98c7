"""Where the search may begin: the one parameter point that fits all observations best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from aleator.laws.classes import apart
from aleator.laws.hyperparameter import limits_of
from aleator.likelihood.individual import IndividualLikelihood, individual_parameters
from aleator.surrogates.responses import moving_parameters
from aleator.types import Array

HUGE = 1e100
"""A residual whose square is still finite."""


@dataclass(frozen=True)
class PooledFit:
    """The point x (n,) that minimizes the sum of squared residuals, and their root mean square."""

    x: Array
    rmse: float
    log_likelihood: float


def pooled_fit(likelihood: IndividualLikelihood, y: Array, start: Array) -> PooledFit:
    """Least squares over the box of the parameters, as if no parameter differed; y (M,).

    Parameters that are known stay. A local method. Cost: some tens of evaluations of all
    observations.
    """
    inputs = likelihood.inputs
    box = inputs.box
    moving = moving_parameters(box)
    width = box[moving, 1] - box[moving, 0]

    def placed(u: Array) -> Array:
        x = start.copy()
        x[moving] = np.clip(box[moving, 0] + u * width, box[moving, 0], box[moving, 1])
        return x

    def at(u: Array) -> tuple[Array, Array]:
        residual, jacobian = np.empty(y.size), np.empty((y.size, moving.size))
        for block in likelihood.blocks:
            points = np.tile(placed(u), (len(block), 1, 1))
            with np.errstate(all="ignore"):
                eta, slopes = likelihood.predictor.with_slopes(block, points)
            residual[block.rows] = eta[:, 0] - y[block.rows]
            jacobian[block.rows] = slopes[moving, :, 0].T * width
        return np.clip(np.nan_to_num(residual, nan=HUGE), -HUGE, HUGE), np.clip(
            np.nan_to_num(jacobian), -HUGE, HUGE
        )

    # just off the ends: a box may be much wider than where the law lies
    u = np.clip((start[moving] - box[moving, 0]) / width, 1e-6, 1.0 - 1e-6)
    if moving.size:
        fit = optimize.least_squares(
            lambda v: at(v)[0], u, jac=lambda v: at(v)[1], bounds=(0.0, 1.0), x_scale="jac"
        )
        u = fit.x
    variance = float(np.mean(at(u)[0] ** 2))
    value = -0.5 * y.size * (np.log(2.0 * np.pi * max(variance, 1e-300)) + 1.0)
    return PooledFit(placed(u), variance**0.5, float(value))


def guesses(likelihood: IndividualLikelihood, fit: PooledFit) -> list[Array]:
    """Laws about the pooled fit with their sds at the start, noise and all, and much narrower.

    Where laws are mixtures, also components about groups of the experiments' own parameters.
    """
    hyperparameters = likelihood.hyperparameters
    around = np.array([h.start for h in hyperparameters])
    inputs = likelihood.inputs
    around[: inputs.size] = inputs.about(fit.x)
    lower, upper = limits_of(hyperparameters)
    for k in range(inputs.size, around.size):
        around[k] = np.clip(fit.rmse, lower[k], upper[k]) if hyperparameters[k].log else around[k]
    narrow = around.copy()
    for k, h in enumerate(hyperparameters[: inputs.size]):
        if h.log and h.free:
            narrow[k] = np.clip(0.1 * around[k], lower[k], upper[k])
    if len(inputs.classes) == 1:
        return [around, narrow]
    # wide laws leave each experiment's parameters to its observations
    wide = around.copy()
    scales = [k for k, h in enumerate(inputs.hyperparameters) if h.log]
    wide[scales] = upper[scales]
    x = individual_parameters(likelihood.adapted(wide), wide).mode
    groups = np.concatenate([apart(inputs, around[: inputs.size], x), around[inputs.size :]])
    return [groups, around, narrow]
