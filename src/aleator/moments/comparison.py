"""How far densities that are fitted to moments are from the exact one of the outcome."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aleator.moments.densities import Density, Gaussian, GaussianMixture, MaximumEntropy
from aleator.moments.densities.distances import distance_on_grid
from aleator.moments.likelihood import Likelihood
from aleator.results.values import DensityDistance
from aleator.status import Status
from aleator.surrogates.responses import Predicted
from aleator.types import Array

COMPARED: tuple[Density, ...] = (
    Gaussian(),
    MaximumEntropy(order=4),
    MaximumEntropy(order=6),
    GaussianMixture(),
)
MOST = 25
"""Experiments whose distances are averaged; more would say the same and take longer."""
REACH = 8.0
POINTS = 401
"""Points over 16 standard deviations: the distance is then good to a thousandth of one."""


def density_distances(
    likelihood: Likelihood, alpha: Array, exact: float, outcomes: Predicted
) -> tuple[DensityDistance, ...]:
    """Each density by moments at alpha against the exact one, all from the same surfaces.

    `exact` is the log-likelihood of the density of the outcome itself, and `outcomes` are its
    distributions. Cost: a fit of each density, and the distances of at most 25 experiments.
    """
    chosen = np.unique(np.linspace(0, likelihood.outcomes.size - 1, MOST).astype(np.intp))
    steps = np.linspace(-REACH, REACH, POINTS)
    grid = outcomes.mean[:, None] + outcomes.sd[:, None] * steps
    y, truth = grid[chosen], outcomes.cdf(grid)[chosen]
    rows = []
    for density in COMPARED:
        other = replace(likelihood, predictive=replace(likelihood.predictive, density=density))
        fitted = other.take(chosen).predictive.under(alpha).fitted
        distance, value = distance_on_grid(fitted.cdf(y), truth, steps), other.evaluate(alpha)
        rows.append(
            DensityDistance(
                density.name,
                value.total - exact,
                float(np.mean(distance)),
                float(np.max(distance)),
                int(np.sum(value.status != Status.SOLVED)),
            )
        )
    return tuple(rows)
