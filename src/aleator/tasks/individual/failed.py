"""Runs that fail: observations without a value, and parameters that count as impossible."""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from aleator.likelihood.individual import IndividualLikelihood
from aleator.likelihood.individual.importance import standard_points
from aleator.simulators import Runner
from aleator.types import Array, Flags, Indices

TRIED = 128
"""Points at which a run must give no value of an observation for that to be lost."""
POINTS = 64
"""Points of each law at which runs are looked at."""


def lost_observations(runner: Runner, region: Array, unit: Indices, column: Indices) -> Flags:
    """Which observations (M,) a simulator gives no value of at 128 points of a region (n, 2).

    None where that is so of all: the simulator may work in a small part of the region only.
    """
    u = qmc.Sobol(len(region), rng=3).random_base2(int(np.log2(TRIED)))
    lost = np.ones(len(unit), dtype=np.bool_)
    for x in region[:, 0] + u * (region[:, 1] - region[:, 0]):
        left = np.flatnonzero(lost)
        if not left.size:
            break
        units, place = np.unique(unit[left], return_inverse=True)
        found = runner.straight(units, np.tile(x, (units.size, 1)))
        lost[left] = np.isnan(found[place, column[left]])
    return lost & (not np.all(lost))


def failing_share(likelihood: IndividualLikelihood, alpha: Array) -> Array:
    """The share (N,) of each experiment's law at whose parameters a run of it has no value."""
    inputs, found = likelihood.inputs, np.zeros(likelihood.count)
    points = standard_points(POINTS, inputs.scattering)
    for block in likelihood.layout.blocks(POINTS):
        xi = np.tile(points, (len(block), len(inputs.classes), 1))
        with np.errstate(all="ignore"):
            individual = inputs.individual(alpha[: inputs.size], xi, block.experiments)
            none = np.isnan(likelihood.predictor.values(block, individual.x))
        failed = block.summed(none.astype(float)) > 0.0
        weights = np.exp(individual.log_weight) / len(points)
        found[block.experiments] = np.sum(failed * weights, axis=1)
    return found
