"""What a fit leaves: a normal score for each observation, and the scores of each experiment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from aleator.inference.fit import Fit
from aleator.types import Array, Flags

NEAREST = 1e-15
"""Probabilities stay so far from zero and one: normal scores stay below eight."""
VALUES, FEWEST, POINTS = 200_000, 64, 256
"""Simulated values by which all probabilities are computed; points of each, fewest and most."""
MORE, TIMES = 4, 3
"""So many times as many points, so often, where too few probabilities are known."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Of M observations the normal scores (M,), of N experiments the scores (N, K) by alpha.

    w = Phi^-1(P(below what was measured | earlier ones of the same experiment)): independent and
    standard normal under the right model. `known` (M,) tells where the probability is one; w is
    zero elsewhere. `scores` are those of the hyperparameters that were identified; zero where an
    experiment has none. `means` (N, s) and `products` (N, s, s) are those of the variates of the
    individual parameters; s is zero where there is no noise. Experiments of which nothing was
    observed are left out.
    """

    normal: Array
    known: Flags
    scores: Array
    means: Array
    products: Array


def points_of(fit: Fit, enough: float) -> int:
    """The points of each experiment by which this share of the probabilities is known, or most."""
    points = int(np.clip(VALUES // len(fit.table.observations), FEWEST, POINTS))
    for _ in range(TIMES):
        if np.mean(np.isfinite(fit.probabilities(points))) >= enough:
            break
        points *= MORE
    return points


def residuals_of(fit: Fit, points: int) -> Residuals:
    """The residuals of a fit; one evaluation of its probabilities and one of its scores."""
    u = fit.probabilities(points)
    known = np.isfinite(u)
    inside = np.clip(np.where(known, u, 0.5), NEAREST, 1.0 - NEAREST)
    scores = fit.scored().scores
    assert scores is not None
    observed = np.unique(fit.table.observations.experiment)
    scores = scores[np.ix_(observed, fit.inference.free)]
    means, products = fit.likelihood.variates() or (
        np.zeros((fit.count, 0)),
        np.zeros((fit.count, 0, 0)),
    )
    return Residuals(
        special.ndtri(inside),
        known,
        np.where(np.isfinite(scores), scores, 0.0),
        means[observed],
        products[observed],
    )
