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
LINE = 33
"""Points of a line on which failures are looked for that lie alone."""


def lost_observations(runner: Runner, region: Array, unit: Indices, column: Indices) -> Flags:
    """Which observations (M,) a fast simulator gives no value of at 128 points of a region (n, 2).

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


def fails_here_and_there(runner: Runner, x: Array, region: Array) -> bool:
    """Whether single runs of a fast simulator fail between others that do not.

    On lines through x (n,) along each side of a region (n, 2). An integral over such a simulator
    itself is one over holes, of which each set of nodes meets others; a surface goes over them.
    Cost: 33 runs a unit and parameter.
    """
    share = np.linspace(0.02, 0.98, LINE)
    units = np.arange(runner.units)
    for k, (low, high) in enumerate(region):
        if not low < high:
            continue
        points = np.tile(x, (LINE, 1))
        points[:, k] = low + share * (high - low)
        values = runner.straight(np.repeat(units, LINE), np.tile(points, (units.size, 1)))
        failed = np.isnan(values).all(axis=1).reshape(units.size, LINE)
        if np.any(failed[:, 1:-1] & ~failed[:, :-2] & ~failed[:, 2:]):
            return True
    return False


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
