"""How far each density fitted to moments is from the exact one, where nodes make it known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aleator.densities import (
    Convolution,
    Density,
    Gaussian,
    GaussianMixture,
    MaximumEntropy,
    Status,
)
from aleator.densities.distances import distance_on_grid
from aleator.likelihood.likelihood import Likelihood
from aleator.likelihood.model import MOST_ON_LATTICE
from aleator.likelihood.problem import Problem
from aleator.likelihood.propagation import QuadraturePropagation, default_cubature
from aleator.likelihood.scoring import scoring_step
from aleator.results.values import DensityDistance
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


def density_distances(problem: Problem, alpha: Array) -> tuple[DensityDistance, ...]:
    """Each moment density against the convolution at alpha, all from the same surfaces.

    Empty without surfaces, without a lattice of nodes, or where the nodes cannot resolve the
    density or do not reach an outcome. Cost: a fit of each density, and the distances
    of at most 25 experiments.
    """
    exact = _exact(problem)
    if exact is None:
        return ()
    reference = exact.evaluate(alpha)
    if np.any(reference.status != Status.SOLVED) or not np.isfinite(reference.total):
        return ()
    chosen = np.unique(np.linspace(0, exact.outcomes.size - 1, MOST).astype(np.intp))
    few = exact.take(chosen)
    moments = few.predictive.moments(alpha)
    steps = np.linspace(-REACH, REACH, POINTS)
    y = moments.mean[:, None] + moments.sd[:, None] * steps
    truth = few.predictive.fitted(alpha).cdf(y)
    rows = []
    for density in COMPARED:
        other = replace(exact, predictive=exact.predictive.by(density))
        distance = distance_on_grid(
            other.take(chosen).predictive.fitted(alpha).cdf(y), truth, steps
        )
        value = other.evaluate(alpha)
        rows.append(
            DensityDistance(
                density.name,
                value.total - reference.total,
                float(np.mean(distance)),
                float(np.max(distance)),
                int(np.sum(value.status != Status.SOLVED)),
            )
        )
    return tuple(rows)


def exact_movement(problem: Problem, alpha: Array) -> float:
    """Standard errors by which an estimate would move, at most, if the density were exact.

    One step of Fisher scoring with the convolution. Infinite where an outcome has no density at
    alpha; zero where the convolution is not to be had, its nodes are too coarse or nothing is
    identified. Cost: one log-likelihood with its score.
    """
    exact = _exact(problem)
    if exact is None:
        return 0.0
    found = exact(alpha)
    if np.any(found.status != Status.SOLVED):
        return 0.0
    if not np.isfinite(found.total):
        return float("inf")
    assert found.scores is not None
    inside = [h.free and h.lower < a < h.upper
              for h, a in zip(exact.hyperparameters, alpha, strict=True)]  # fmt: skip
    prior = None if found.prior_score is None else found.prior_score[inside]
    step = scoring_step(found.scores[:, inside], prior)
    return 0.0 if step is None else float(np.max(np.abs(step.in_standard_errors)))


def _exact(problem: Problem) -> Likelihood | None:
    """The likelihood of the convolution on the same surfaces, where there is one."""
    model, inputs = problem.model, problem.model.inputs
    on_lattice = 1 <= inputs.scattering <= MOST_ON_LATTICE
    if model.surfaces is None or not on_lattice:
        return None
    cubature = default_cubature(inputs, Convolution(), runs=False)
    grid = QuadraturePropagation(inputs, problem.response, cubature)
    return replace(problem.by_densities, predictive=problem.predictive.by(Convolution(), grid))
