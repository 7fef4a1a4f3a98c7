"""The predictive distribution with the uncertainty of alpha: a mixture over plausible laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.inference.decisions.weighted import moments, quantiles
from aleator.likelihood.individual import Predictor
from aleator.tasks.decide.forecast import Forecast
from aleator.tasks.decide.ground import Ground
from aleator.tasks.decide.points import POINTS, Parameters, Points, measured, parameters, simulated
from aleator.types import Array

LEVEL = np.array([0.025, 0.975])
"""Ends of the interval of each quantile."""


def widened(
    ground: Ground,
    predictor: Predictor,
    draws: AlphaDraws,
    probabilities: Array,
    found: Forecast,
) -> tuple[Forecast, Array]:
    """The forecast of the mixture, and 95 % intervals (M, P, 2) of its quantiles.

    `found` is that at the estimate. Added to it are differences that are taken by the same points
    of the law for every alpha: what the points miss is the same under all. Cost: an evaluation of
    the predictor for each draw, each of the 512 points and value.
    """
    size = len(ground.seen)
    moments_of, quantiles_of = np.empty((4, size)), np.empty((size, len(probabilities)))
    ends = np.empty((size, len(probabilities), 2))
    points = Points.standard(POINTS, ground.inputs.scattering)
    alphas = np.concatenate([draws.estimate[None], draws.alpha])
    known: Parameters | None = None
    for l in range(ground.count):
        if known is None or ground.inputs.regressed or ground.measured is not None:
            known = parameters(ground, alphas, l, points)
        block = ground.layout.alone(l)
        eta = simulated(predictor.values, block, known.x)
        y = measured(ground, alphas, eta, known.score, block.rows)
        for k, own in enumerate(y, block.rows.start):
            values = _Values.of(own, known.weights, draws, probabilities)
            at = np.array([found.mean[k], found.sd[k], found.skewness[k], found.kurtosis[k]])
            moments_of[:, k] = np.where(np.isnan(at), np.nan, _moved(at, *values.moments))
            quantiles_of[k] = _moved(found.quantiles[k], *values.quantiles)
            ends[k] = values.ends(found.quantiles[k])
    mean, sd, skewness, kurtosis = moments_of
    return Forecast(mean, sd, skewness, kurtosis, quantiles_of, found.lost), ends


@dataclass(frozen=True, eq=False)
class _Values:
    """Moments (4,) and quantiles (P,) by points, each of the mixture and of the estimate.

    `each` (A, P) are the quantiles of each draw, with `weights` (A,).
    """

    moments: tuple[Array, Array]
    quantiles: tuple[Array, Array]
    each: Array
    weights: Array

    @classmethod
    def of(cls, y: Array, weights: Array, draws: AlphaDraws, probabilities: Array) -> _Values:
        """Of values y (1 + A, J) with weights; the first row is the estimate's."""
        each = quantiles(y, weights, probabilities)
        whole = (draws.weights[:, None] * weights[1:]).ravel()
        mixed = y[1:].ravel()
        return cls(
            (np.array(moments(mixed, whole)), np.array(moments(y[0], weights[0]))),
            (quantiles(mixed, whole, probabilities), each[0]),
            each[1:],
            draws.weights,
        )

    def ends(self, at: Array) -> Array:
        """The intervals (P, 2) of quantiles whose estimates are `at` (P,)."""
        own = self.quantiles[1]
        finite = np.isfinite(self.each).all(axis=0) & np.isfinite(own) & np.isfinite(at)
        shift = np.where(finite, at, 0.0) - np.where(finite, own, 0.0)
        return np.asarray(quantiles(self.each.T, self.weights, LEVEL) + shift[:, None])


def _moved(at: Array, mixed: Array, own: Array) -> Array:
    """`at` moved by the difference of the other two; where one is not finite, `mixed` itself."""
    finite = np.isfinite(at) & np.isfinite(mixed) & np.isfinite(own)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(finite, at + (mixed - own), mixed))
