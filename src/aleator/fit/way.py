"""Whether a likelihood is integrated over the simulator itself, or over surfaces of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError
from aleator.fit.question import start_point
from aleator.laws.inputs import Inputs
from aleator.likelihood.level_sets import on_a_grid, searched
from aleator.likelihood.level_sets.lines import CROSSINGS
from aleator.likelihood.model import Model
from aleator.simulators import Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import ResponseSurface


@dataclass(frozen=True)
class WaySettings:
    """What the runs of a simulator without surfaces are told by, and where failures are looked for.

    - `evaluations`: evaluations of the likelihood that an identification takes, about.
    - `nodes`: nodes a variate that an identification comes to, about; of more than three variates
      fewer.
    - `line`: points of a line on which failures are looked for that lie alone.
    - `grids`: grids of level sets in an identification, fewest and most of the studies of
      `make judges`.
    - `tried`: points at which a run must give no value of an observation for that to be lost.
    """

    evaluations: int = 400
    nodes: int = 9
    line: int = 33
    tried: int = 128
    grids: tuple[int, int] = (100, 5000)


WAYS = WaySettings()


@dataclass(frozen=True)
class Way:
    """Whether the simulator itself is integrated over, and the `reason` in words."""

    direct: bool
    reason: str


def way_of(runner: Runner, choice: ResponseSurface, x: Array, region: Array) -> Way:
    """The way of a study: the simulator itself where it is vectorized, else surfaces.

    The choice says otherwise by `surfaces`. A tolerance and a budget of runs are for surfaces, and
    so is a simulator of which single runs fail between others that do not. `x` (n,) is a point of
    the `region` (n, 2) where the laws may be. No time is measured, so that the same study goes the
    same way on every machine. Cost: 33 runs a unit and parameter of a vectorized simulator.
    """
    if choice.surfaces == "none":
        runner.takes_arrays(region)
        return Way(True, 'surfaces = "none"')
    if choice.surfaces is not None:
        return Way(False, f'surfaces = "{choice.surfaces}"')
    if choice.tolerance is not None:
        return Way(False, "surfaces have a tolerance")
    if runner.account.budget.runs is not None:
        return Way(False, "runs have a budget")
    if not runner.vectorized:
        return Way(False, "the simulator makes one run at a time")
    if fails_here_and_there(runner, x, region):
        return Way(False, "the simulator takes arrays, but runs fail here and there")
    return Way(True, "the simulator takes arrays")


def way_of_outcomes(runner: Runner, model: Model) -> Way:
    """The way of a study with one exact outcome an experiment; no reason where it has no choice.

    The simulator itself serves where the likelihood is that of level sets, and the user chose no
    tolerance. Raises InputsError where it is asked for elsewhere.
    """
    choice, inputs = model.surfaces, model.inputs
    if choice is None:
        return Way(False, "")
    if model.density is None and model.follows:
        start = np.clip(start_point(inputs), *inputs.box.T)
        return way_of(runner, choice, start, inputs.box)
    if choice.surfaces == "none":
        raise InputsError(
            'surfaces = "none": densities of moments and a tolerance take surfaces',
            'leave out surfaces, or take method = "collocation"',
        )
    return Way(False, "")


def grids_each(inputs: Inputs, conditions: int) -> tuple[int, int]:
    """Runs of each condition that level sets of the simulator itself take, at least and at most."""
    few, s = searched(inputs, conditions), inputs.scattering
    points = few**s if on_a_grid(inputs) else few * (CROSSINGS.steps + 2 * s)
    return WAYS.grids[0] * points, WAYS.grids[1] * points


def runs_each(inputs: Inputs) -> int:
    """Runs of each unit that an identification without surfaces takes, about."""
    moving = int(moving_parameters(inputs.box).size)
    return int(WAYS.nodes ** min(inputs.scattering, 3)) * (2 * moving + 1) * WAYS.evaluations


def fails_here_and_there(runner: Runner, x: Array, region: Array) -> bool:
    """Whether single runs of a simulator fail between others that do not.

    On lines through x (n,) along each side of a region (n, 2). An integral over such a simulator
    itself is one over holes, of which each set of nodes meets others; a surface goes over them.
    """
    share = np.linspace(0.02, 0.98, WAYS.line)
    units = np.arange(runner.units)
    for k, (low, high) in enumerate(region):
        if not low < high:
            continue
        points = np.tile(x, (WAYS.line, 1))
        points[:, k] = low + share * (high - low)
        values = runner.straight(np.repeat(units, WAYS.line), np.tile(points, (units.size, 1)))
        failed = np.isnan(values).all(axis=1).reshape(units.size, WAYS.line)
        if np.any(failed[:, 1:-1] & ~failed[:, :-2] & ~failed[:, 2:]):
            return True
    return False


def failing_observations(runner: Runner, region: Array, unit: Indices, column: Indices) -> Flags:
    """Which observations (M,) a simulator gives no value of at 128 points of a region (n, 2).

    None where that is so of all: the simulator may work in a small part of the region only.
    """
    u = qmc.Sobol(len(region), rng=3).random_base2(int(np.log2(WAYS.tried)))
    lost = np.ones(len(unit), dtype=np.bool_)
    for x in region[:, 0] + u * (region[:, 1] - region[:, 0]):
        left = np.flatnonzero(lost)
        if not left.size:
            break
        units, place = np.unique(unit[left], return_inverse=True)
        found = runner.straight(units, np.tile(x, (units.size, 1)))
        lost[left] = np.isnan(found[place, column[left]])
    return lost & (not np.all(lost))
