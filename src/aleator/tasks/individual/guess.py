"""Where the search may begin: the one parameter point that fits all observations best."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from aleator.laws.hyperparameter import limits_of
from aleator.laws.mixture import apart, undivided
from aleator.likelihood.individual import (
    GaussHermite,
    IndividualLikelihood,
    individual_parameters,
)
from aleator.surrogates.responses import moving_parameters
from aleator.types import Array

HUGE = 1e100
"""A residual whose square is still finite."""
GROUPED = 20
"""Groups that a mixture is guessed by, for all starts of a search that has to go on: of five
components 3 to 4 of 7 lead to the best of two maxima that differ by 0.08."""


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


def guesses(likelihood: IndividualLikelihood, fit: PooledFit, y: Array, seed: int) -> list[Array]:
    """Laws about the pooled fit with their sds at the start, noise and all, and much narrower.

    Where laws are mixtures, also components about groups of the experiments' own parameters, by
    their observations y (M,).
    """
    inputs = likelihood.inputs
    around = _with_noise(likelihood, inputs.about(fit.x), fit.rmse)
    narrow = around.copy()
    lower, upper = limits_of(inputs.hyperparameters)
    for k, h in enumerate(inputs.hyperparameters):
        if h.log and h.free:
            narrow[k] = np.clip(0.1 * around[k], lower[k], upper[k])
    if len(inputs.classes) == 1 or inputs.covariate_model is not None:
        return [around, narrow]
    first, *others = _grouped(likelihood, fit, y, seed)
    return [first, around, narrow, *others]


def _grouped(
    likelihood: IndividualLikelihood, fit: PooledFit, y: Array, seed: int
) -> Iterator[Array]:
    """Components about random groups, and the noise that the centers of the groups leave."""
    # wide laws leave each experiment's parameters to its observations
    inputs, alone = likelihood.inputs, undivided(likelihood.inputs)
    wide = alone.about(fit.x)
    for k, h in enumerate(alone.hyperparameters):
        wide[k] = h.upper if h.log else wide[k]
    wide = _with_noise(likelihood, wide, fit.rmse)
    one = IndividualLikelihood.of(
        alone, likelihood.errors, likelihood.predictor, likelihood.layout, GaussHermite(1)
    )
    x = individual_parameters(one.adapted(wide), wide).mode
    for rng in np.random.default_rng(seed).spawn(GROUPED):
        alpha, centers = apart(inputs, inputs.about(fit.x), x, rng)
        residual = np.empty(y.size)
        for block in one.blocks:
            eta = one.predictor.values(block, centers[block.experiments, None])
            residual[block.rows] = eta[:, 0] - y[block.rows]
        yield _with_noise(likelihood, alpha, float(np.sqrt(np.nanmean(residual**2))))


def _with_noise(likelihood: IndividualLikelihood, of_laws: Array, rmse: float) -> Array:
    """The alpha (K,) of laws with errors of this size."""
    errors = likelihood.errors.hyperparameters
    sizes = [float(np.clip(rmse, h.lower, h.upper)) if h.log else h.start for h in errors]
    return np.concatenate([of_laws, sizes])
