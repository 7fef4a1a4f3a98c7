"""Where a maximum may lie: laws and errors as the individual parameters have them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from aleator.types import Array

if TYPE_CHECKING:
    from aleator.laws.inputs import Inputs
    from aleator.likelihood.individual.likelihood import IndividualLikelihood
    from aleator.observations.errors import MeasurementErrors

LARGER, SMALLER = 2.0, 0.1
"""What a step may at most make of an sd of the errors: laws must have time to explain more."""


def toward(likelihood: IndividualLikelihood, alpha: Array) -> tuple[float, Array]:
    """log L at alpha, where the nodes are adapted, and where it may be larger: alpha (K,).

    A step of expectation and maximization (Dempster, Laird and Rubin, 1977): every law gets the
    mean of the individual parameters x, given the observations, and their mean square about the
    mean that it had, so that one far from its experiments grows wide first. An sd of errors gets
    the mean square of what they are,

        sd'^2 = sd^2 (1 + sd/M d log L/d sd).

    For normal laws and errors its end is the maximum, for others near one. Constants, correlations,
    shapes and laws without a mean and an sd stay; limits are not kept. Cost: an evaluation without
    a score.
    """
    inputs, errors = likelihood.inputs, likelihood.errors
    mean, square = (np.full((likelihood.count, len(inputs.names)), np.nan) for _ in range(2))
    slope, count = np.zeros(len(errors.hyperparameters)), np.zeros(len(errors.hyperparameters))
    value = 0.0
    for block in likelihood.blocks:
        part = block.experiments
        each, share, individual, terms = likelihood.weighed(alpha, block)
        value += float(each.sum())
        located = _means(inputs, alpha, part)
        mean[part] = np.einsum("bj,bjn->bn", share, individual.x)
        square[part] = np.einsum("bj,bjn->bn", share, (individual.x - located) ** 2)
        for p, (rows, derivative) in enumerate(terms.d_values):
            slope[p] += np.sum(share[block.owner[rows]] * derivative)
            count[p] += len(rows)
    counted = ~np.isnan(mean[:, 0])
    found = alpha.copy()
    if not np.isfinite(value) or not np.all(np.isfinite(mean[counted])):
        return value, found
    _place(inputs, found, mean, np.sqrt(np.mean(square[counted], axis=0)), counted)
    _place_errors(errors, found[inputs.size :], slope / np.maximum(count, 1.0))
    return value, found


def _known(inputs: Inputs) -> list[int]:
    """The parameters whose laws have a mean and an sd."""
    names = [[h.name for h in law.hyperparameters] for law in inputs.laws.values()]
    return [i for i in inputs.scattered if names[i] == ["mean", "sd"]]


def _means(inputs: Inputs, alpha: Array, part: slice) -> Array:
    """The means (B or 1, 1, n) of these laws in some experiments."""
    values = inputs.values(alpha[: inputs.size], part)
    found = np.zeros((part.stop - part.start, 1, len(values)))
    for i in _known(inputs):
        found[..., i] = np.reshape(values[i][0], (-1, 1))
    return found


def _place(inputs: Inputs, alpha: Array, mean: Array, sd: Array, counted: Array) -> None:
    """Set the means of the individual parameters (N, n) and their sds (n,) in alpha."""
    model = inputs.covariate_model
    for i in _known(inputs):
        at = inputs.parts[i].start
        if model is None:
            alpha[at : at + 2] = np.mean(mean[counted, i]), sd[i]
            continue
        for entry, own in zip(model.entries[at : at + 2], (mean[counted, i], sd[i]), strict=True):
            if entry.design is None:
                alpha[entry.places] = np.mean(own)
            elif np.ndim(own):
                alpha[entry.places] = np.linalg.lstsq(entry.design.matrix[counted], own)[0]


def _place_errors(errors: MeasurementErrors, values: Array, slope: Array) -> None:
    """Set the sds of the errors, by the slope (P,) of the log-likelihood an observation."""
    for p, h in enumerate(errors.hyperparameters):
        if h.free and h.name.endswith(".sd"):
            ratio = np.sqrt(np.maximum(1.0 + values[p] * slope[p], 0.0))
            values[p] *= np.clip(ratio, SMALLER, LARGER)
