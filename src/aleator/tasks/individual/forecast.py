"""The distribution of new observations: of a new experiment, or of one that was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.densities.inversion import invert
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import IndividualLikelihood, Layout, Predictor
from aleator.likelihood.individual.likelihood import mean_of
from aleator.observations.errors import MeasurementErrors
from aleator.tasks.individual.proposal import proposed, standard_points
from aleator.types import Array

POINTS = 4096
"""Points that stand for the law of an experiment."""
LOST = 1e-3
"""Share of the law whose runs may fail before a prediction is one of what is left."""
STEP = 1e-4
"""Step in scales of the difference that a density is taken by."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Points x (B, J, n) of the parameters of B experiments, of weights (B, J) that sum to one."""

    x: Array
    weights: Array

    @classmethod
    def new(cls, inputs: Inputs, alpha: Array, experiments: int) -> Draws:
        """Of experiments that nothing is known of but their law."""
        points = standard_points(POINTS, inputs.scattering)
        xi = np.tile(points, (experiments, len(inputs.classes), 1))
        found = inputs.individual(alpha[: inputs.size], xi, slice(0, experiments))
        weights = np.exp(found.log_weight) / len(points)
        return cls(found.x, np.broadcast_to(weights, found.x.shape[:2]))

    @classmethod
    def old(cls, likelihood: IndividualLikelihood, alpha: Array, which: int) -> Draws:
        """Of one experiment of a likelihood that is adapted to alpha, given its observations."""
        block, nodes = likelihood.layout.alone(which), likelihood.nodes
        part = block.experiments
        xi, log_weight = proposed(nodes.mode[part], nodes.information[part], POINTS)
        with np.errstate(all="ignore"):
            share = mean_of(likelihood.sums(alpha, block, xi) + log_weight)[1]
        inputs = likelihood.inputs
        return cls(inputs.individual(alpha[: inputs.size], xi, part).x, share)

    @classmethod
    def joined(cls, parts: Sequence[Draws]) -> Draws:
        """Those of all experiments, one after the other."""
        return cls(
            np.concatenate([part.x for part in parts]),
            np.concatenate([part.weights for part in parts]),
        )


@dataclass(frozen=True, eq=False)
class Forecast:
    """Mean, sd (M,) and quantiles (M, P) of M values; `lost` (M,) is the share that failed."""

    mean: Array
    sd: Array
    quantiles: Array
    lost: Array


def forecast(
    draws: Draws,
    predictor: Predictor,
    layout: Layout,
    errors: MeasurementErrors | None,
    of_errors: Array,
    probabilities: Array,
) -> Forecast:
    """The mixture over the draws of what is measured, or without errors of what is simulated.

    F(y) = sum_j w_j F(y | eta_j, scale_j), exact but for the draws, inverted. Points whose runs
    fail are left out. Cost: a run for each point and unit.
    """
    size = layout.experiment.size
    found = Forecast(
        np.empty(size), np.empty(size), np.empty((size, len(probabilities))), np.empty(size)
    )
    for block in layout.blocks(draws.x.shape[1]):
        rows = block.rows
        with np.errstate(all="ignore"):
            eta = predictor.values(block, draws.x[block.experiments])
        known = np.isfinite(eta)
        weights = np.where(known, draws.weights[block.experiments][block.owner], 0.0)
        whole = weights.sum(axis=1, keepdims=True)
        found.lost[rows] = 1.0 - whole[:, 0]
        with np.errstate(all="ignore"):
            weights, eta = weights / whole, np.where(known, eta, 0.0)
        mean, variance = (
            (eta, np.zeros(eta.shape)) if errors is None else errors.moments(of_errors, eta, rows)
        )
        found.mean[rows] = np.sum(weights * mean, axis=1)
        spread = (mean - found.mean[rows][:, None]) ** 2
        found.sd[rows] = np.sqrt(np.sum(weights * (spread + variance), axis=1))
        found.quantiles[rows] = (
            _weighted(eta, weights, probabilities)
            if errors is None
            else _inverted(errors, of_errors, eta, weights, rows, probabilities)
        )
    return found


def _weighted(eta: Array, weights: Array, probabilities: Array) -> Array:
    """Quantiles (m, P) of values (m, J) with weights; each stands in the middle of its weight."""
    order = np.argsort(eta, axis=1)
    value, share = (np.take_along_axis(array, order, axis=1) for array in (eta, weights))
    reached = np.cumsum(share, axis=1) - 0.5 * share
    pairs = zip(reached, value, share, strict=True)
    return np.array([np.interp(probabilities, at[w > 0.0], y[w > 0.0]) for at, y, w in pairs])


def _inverted(
    errors: MeasurementErrors,
    of_errors: Array,
    eta: Array,
    weights: Array,
    rows: slice,
    probabilities: Array,
) -> Array:
    """Quantiles (m, P) of the mixture, which lie between those of its parts."""
    scale = np.broadcast_to(errors.scale(of_errors, eta, rows), eta.shape)
    step = STEP * np.sum(weights * scale, axis=1, keepdims=True)
    counted = weights > 0.0

    def cdf(y: Array) -> Array:
        columns = [errors.cdf(of_errors, column[:, None], eta, rows) for column in y.T]
        return np.stack([np.sum(weights * column, axis=1) for column in columns], axis=1)

    def pdf(y: Array) -> Array:
        return np.asarray((cdf(y + step) - cdf(y - step)) / (2.0 * step))

    ends = [errors.quantile(of_errors, np.full((len(eta), 1), p), eta, rows) for p in probabilities]
    low = np.stack([np.min(np.where(counted, end, np.inf), axis=1) for end in ends], axis=1)
    high = np.stack([np.max(np.where(counted, end, -np.inf), axis=1) for end in ends], axis=1)
    lost = ~np.isfinite(low) | ~np.isfinite(high)
    low, high = np.where(lost, 0.0, low), np.where(lost, 1.0, high)
    wanted = np.broadcast_to(probabilities, low.shape)
    return np.where(lost, np.nan, invert(cdf, pdf, wanted, low, high))
