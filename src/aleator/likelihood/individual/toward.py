"""Where a maximum may lie: laws and errors as the individual parameters show them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from aleator.laws.hyperparameter import log_prior
from aleator.types import Array, Flags

if TYPE_CHECKING:
    from aleator.laws.inputs import Inputs
    from aleator.likelihood.individual.likelihood import IndividualLikelihood
    from aleator.observations.errors import MeasurementErrors

LEAST_TOLD = 0.05
"""Share of a law's information that observations tell, at least: no step becomes too long."""
STRETCH = 10.0
"""How many times larger or smaller a step may make the sd of a law."""
LARGER, SMALLER = 2.0, 0.1
"""... and that of errors: laws must have time to explain more."""


def toward(likelihood: IndividualLikelihood, alpha: Array) -> tuple[float, Array]:
    """log L at alpha, where the nodes are adapted, and where it may be larger: alpha (K,).

    A step of expectation and maximization (Dempster, Laird and Rubin, 1977), made longer where
    observations tell less (Louis, 1982). With m_l and V_l the mean and the variance of x in
    experiment l given its observations, and mu and v those of the law,

        mu' = mu + sum_l (m_l - mu) / sum_l w_l,                 w_l = 1 - V_l/v,
        v'  = v + sum_l ((m_l - mu)^2 + V_l - v) / sum_l w_l^2,
        sd'^2 = sd^2 (1 + sd/M d log L/d sd)                     of the errors of M observations.

    For normal laws and errors its end is the maximum, for others near one. Constants, correlations,
    shapes and laws without a mean and an sd stay; limits are not kept. Cost: an evaluation without
    a score.
    """
    inputs, errors = likelihood.inputs, likelihood.errors
    center, spread = _laws(inputs, alpha, likelihood.count)
    mean, square = np.full(center.shape, np.nan), np.full(center.shape, np.nan)
    slope, count = np.zeros(len(errors.hyperparameters)), np.zeros(len(errors.hyperparameters))
    value = log_prior(likelihood.hyperparameters, alpha)
    for block in likelihood.blocks:
        part = block.experiments
        each, share, individual, terms = likelihood.weighed(alpha, block)
        value += float(each.sum())
        mean[part] = np.einsum("bj,bjn->bn", share, individual.x)
        away = individual.x - center[part, None]
        square[part] = np.einsum("bj,bjn->bn", share, away**2)
        for p, (rows, derivative) in enumerate(terms.d_values):
            slope[p] += np.sum(share[block.owner[rows]] * derivative)
            count[p] += len(rows)
    found, counted = alpha.copy(), ~np.isnan(mean[:, 0])
    if not np.isfinite(value) or not np.all(np.isfinite(square[counted])):
        return value, found
    for i in _known(inputs):
        own = (mean[counted, i] - center[counted, i], square[counted, i], spread[counted, i])
        _place(inputs, i, found, *own, counted)
    _place_errors(errors, found[inputs.size :], slope / np.maximum(count, 1.0))
    return value, found


def _known(inputs: Inputs) -> list[int]:
    """The parameters whose laws have a mean and an sd."""
    names = [[h.name for h in law.hyperparameters] for law in inputs.laws.values()]
    return [i for i in inputs.scattered if names[i] == ["mean", "sd"]]


def _laws(inputs: Inputs, alpha: Array, count: int) -> tuple[Array, Array]:
    """The means and variances (N, n) of these laws in all experiments; of others zero and one."""
    values = inputs.values(alpha[: inputs.size], slice(0, count))
    center, spread = np.zeros((count, len(values))), np.ones((count, len(values)))
    for i in _known(inputs):
        center[:, i], spread[:, i] = values[i][0].ravel(), values[i][1].ravel() ** 2
    return center, spread


def _place(
    inputs: Inputs,
    i: int,
    alpha: Array,
    shift: Array,
    square: Array,
    spread: Array,
    counted: Flags,
) -> None:
    """Set the law of parameter i in alpha, by m_l - mu, its mean square and v of experiments."""
    at, model = inputs.parts[i].start, inputs.covariate_model
    mean, sd = slice(at, at + 1), slice(at + 1, at + 2)
    columns = np.ones((len(shift), 1))
    if model is not None:
        of_mean, of_sd = model.entries[at], model.entries[at + 1]
        mean, sd = of_mean.places, of_sd.places
        columns = columns if of_mean.design is None else of_mean.design.matrix[counted]
    told = np.clip(1.0 - (square - shift**2) / spread, LEAST_TOLD, 1.0)
    alpha[mean] += np.linalg.lstsq((columns.T * told) @ columns, columns.T @ shift)[0]
    if model is None or of_sd.design is None:
        grown = 1.0 + np.mean(square / spread - 1.0) / np.mean(told**2)
        alpha[sd] *= np.sqrt(np.clip(grown, STRETCH**-2.0, STRETCH**2.0))


def _place_errors(errors: MeasurementErrors, values: Array, slope: Array) -> None:
    """Set the sds of the errors, by the slope (P,) of the log-likelihood an observation."""
    for p, h in enumerate(errors.hyperparameters):
        if h.free and h.name.endswith(".sd"):
            ratio = np.sqrt(np.maximum(1.0 + values[p] * slope[p], 0.0))
            values[p] *= np.clip(ratio, SMALLER, LARGER)
