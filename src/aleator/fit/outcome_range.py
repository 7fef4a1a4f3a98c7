"""Whether the simulator can give every measured outcome, for a likelihood without noise.

A measured outcome has no density if the simulator gives it at no admissible parameters. It counts
as out of range only if an optimizer, started from several points of the laws' support, does not
find parameters with this outcome. A surface that misses it by its own error gets more runs there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize
from scipy.stats import qmc

from aleator.core.progress import Progress
from aleator.core.types import Array, Indices
from aleator.fit.question import Question
from aleator.fit.regions import hull, within
from aleator.inference import surface_diagnostics
from aleator.laws.hyperparameter import limits_of
from aleator.laws.inputs import Inputs, law_region
from aleator.likelihood.problem import Problem, prepare
from aleator.simulators.response_functions import (
    Run,
    moving_parameters,
    straight,
)
from aleator.surrogates import AdaptiveSurfaces
from aleator.surrogates.samples import Sites
from aleator.surrogates.surface import Axes, logarithms


@dataclass(frozen=True)
class OutcomeSearch:
    """Settings of the search for parameters that give an outcome; measured by `benchmarks folds`.

    The first local search begins at the point that the surface says is nearest. Others begin at
    the best `starts` of `looks` points of the laws' support. Each takes at most `steps` runs for
    each parameter. An outcome missed by less than the share `near` of the range of all simulated
    outcomes counts as reached. Surfaces get new runs up to `rounds` times, at points chosen among
    the `draws` nearest of `candidates` points of the region.
    """

    looks: int = 32
    starts: int = 3
    steps: int = 60
    near: float = 1e-4
    rounds: int = 5
    candidates: int = 4096
    draws: int = 512

    def most(self, parameters: int) -> int:
        """The largest number of runs in the search for one outcome, for so many `parameters`."""
        return self.looks + (1 + self.starts) * self.steps * parameters


OUTCOME_SEARCH = OutcomeSearch()


def on_surfaces(
    question: Question, surfaces: AdaptiveSurfaces, region: Array, progress: Progress
) -> Problem:
    """The likelihood without noise on surfaces, whose region is widened to reach all outcomes.

    An outcome that a surface still misses by its own error is left to later rounds. If the budget
    does not allow the runs to search for one outcome, all are left. Raises ExperimentsError for an
    outcome that the simulator itself does not give anywhere.
    """
    runner, model, outcomes = question.runner, question.choices.model, question.measured
    for _ in range(OUTCOME_SEARCH.rounds):
        problem = prepare(runner, outcomes, model, region, progress, surfaces.surface())
        found = reached(question, problem, region)
        if found is None:
            return problem
        wider, lost = found[2], np.flatnonzero(surface_diagnostics.shortfalls(problem))
        if not np.array_equal(wider, region):
            region = wider
            surfaces.move(region[moving_parameters(region)])
        elif not _sharpened(surfaces, problem.condition[lost], outcomes[lost]):
            return problem
    return prepare(runner, outcomes, model, region, progress, surfaces.surface())


def reached(question: Question, problem: Problem, region: Array) -> tuple[int, Array, Array] | None:
    """Parameters at which the simulator gives the outcome that surfaces miss most.

    Returns the number of its simulated value, the parameters (moving,), and the region (n, 2)
    widened to contain them. None if no outcome is missed, or the budget does not allow the search.
    Raises ExperimentsError for an outcome that the simulator itself does not give anywhere.
    """
    runner, inputs = question.runner, question.inputs
    short, moving = surface_diagnostics.shortfalls(problem), moving_parameters(region)
    most = OUTCOME_SEARCH.most(moving.size)
    if not short.any() or runner.account.granted(most) < most:
        return None
    farthest = int(np.argmax(np.abs(short)))
    condition, side = int(problem.condition[farthest]), float(np.sign(short[farthest]))
    bound = float(problem.ends[0 if side > 0.0 else 1, farthest])
    assert problem.surface is not None
    points = _spread(region[moving])
    values = problem.surface.take(np.array([condition])).evaluate(points)[0]
    sites = Sites.seen(runner, runner.unit, runner.column)
    x = _reached(
        sites.attempts(runner, region), points[np.argmax(side * values)], condition,
        bound, side, _support(inputs)[moving],
    )  # fmt: skip
    if x is None:
        raise surface_diagnostics.unreachable(problem, _owners(question))
    return condition, x, _holding(region, x, inputs.box)


def on_simulator(question: Question, progress: Progress) -> Problem:
    """The likelihood without noise on the simulator itself, if it can give every outcome.

    If no cell of the grid of parameters contains an outcome, an optimizer searches for parameters
    that give it. Raises ExperimentsError if the simulator does not give it anywhere. An outcome in
    the gap of a jump, between simulated outcomes, is left to the diagnostics. Raises NoOutcome for
    an experiment all of whose runs fail.
    """
    runner, inputs, y = question.runner, question.inputs, question.measured
    model = question.choices.model
    if model.surfaces is not None:
        model = model.directly()
    problem = prepare(runner, y, model, inputs.box, progress, bounds=question.bounds)
    sites = Sites.seen(runner, runner.unit, runner.column)
    moves = moving_parameters(inputs.box)
    straightly = straight(runner, sites.unit, sites.column)
    whole = _support(inputs)[moves]
    points = _spread(whole)

    def full(x: Array) -> Array:
        every = np.tile(inputs.box[:, 0], (len(x), 1))
        every[:, moves] = x
        return every

    def run(index: Indices, x: Array) -> Array:
        return straightly(index, full(x))

    low, high, missed = np.full(y.size, -np.inf), np.full(y.size, np.inf), list[int]()
    for row in np.flatnonzero(np.repeat(problem.unreached, problem.each)).tolist():
        condition = int(problem.condition[row])
        values = run(np.full(len(points), condition), points)
        if np.isnan(values).all():
            runner(sites.unit[[condition]], full(points[:1]))
        low[row], high[row] = np.nanmin(values), np.nanmax(values)
        lower, upper = problem.ends[:, row]
        if low[row] <= upper and lower <= high[row]:
            continue
        side, bound = (1.0, lower) if lower > high[row] else (-1.0, upper)
        start = points[np.nanargmax(side * values)]
        if _reached(run, start, condition, bound, side, whole) is None:
            missed.append(row)
    if missed:
        raise surface_diagnostics.out_of_reach(np.array(missed), y, (low, high), _owners(question))
    return problem


def _owners(question: Question) -> list[str]:
    """The name of the experiment of each observation (M,)."""
    return [question.ids[l] for l in question.table.observations.experiment.tolist()]


def _support(inputs: Inputs) -> Array:
    """The range (n, 2) of parameters covered by the laws for all admissible hyperparameters."""
    lower, upper = (end[: inputs.size] for end in limits_of(inputs.hyperparameters))
    u = qmc.Sobol(max(inputs.size, 1), rng=0).random(OUTCOME_SEARCH.looks)[:, : inputs.size]
    return within(inputs.box, law_region(inputs, [*(lower + u * (upper - lower)), lower, upper]))


def _reached(
    run: Run, start: Array, condition: int, outcome: float, side: float, whole: Array
) -> Array | None:
    """Parameters (n,) at which the simulator reaches the outcome or exceeds it; None if none.

    To exceed it is to be above it if `side` is 1, and below it if `side` is -1. The search begins
    at `start` (n,). `whole` (n, 2) is the support of the n parameters that are not constant, and
    `condition` the index of the simulated experiment.
    """
    axes = Axes(whole, logarithms(whole))
    first = np.clip(axes.inward(start), -1.0, 1.0)
    best, farthest, seen = first, -np.inf, [outcome]

    def short(z: Array) -> float:
        """How much the simulated outcome at z falls short of the measured one; negative beyond."""
        nonlocal best, farthest
        inside = np.clip(z, -1.0, 1.0)
        y = float(run(np.array([condition]), axes.outward(inside[None]))[0])
        if not np.isfinite(y):
            return np.inf
        seen.append(y)
        if side * (y - outcome) > farthest:
            best, farthest = inside, side * (y - outcome)
        return -side * (y - outcome)

    def ended(*_: object) -> None:
        if farthest >= 0.0:
            raise StopIteration

    def ascend(z: Array) -> None:
        simplex = np.clip(z + np.vstack([np.zeros(z.size), 0.1 * np.eye(z.size)]), -1.0, 1.0)
        simplex[1:][np.all(simplex[1:] == z, axis=1)] -= 0.1
        optimize.minimize(
            short, z, method="Nelder-Mead", callback=ended,
            options={"initial_simplex": simplex, "maxfev": OUTCOME_SEARCH.steps * z.size,
                     "xatol": 1e-5, "fatol": 1e-9 * max(np.ptp(seen), 1e-300)},
        )  # fmt: skip

    ascend(first)
    if farthest < 0.0:
        looks = 2.0 * qmc.Sobol(len(whole), rng=0).random(OUTCOME_SEARCH.looks) - 1.0
        for z in looks[np.argsort([short(z) for z in looks])[: OUTCOME_SEARCH.starts]]:
            if farthest < 0.0:
                ascend(z)
    missed = farthest < -OUTCOME_SEARCH.near * np.ptp(seen)
    return None if missed else np.asarray(axes.outward(best[None])[0])


def _sharpened(surfaces: AdaptiveSurfaces, lost: Indices, outcomes: Array) -> bool:
    """Make runs near the `outcomes` that surfaces miss; False if the budget allows no run.

    `lost` are the indices of these surfaces.
    """
    members = np.isin(np.arange(surfaces.good.size), lost)
    granted = np.flatnonzero(surfaces.granted(members))
    for condition in granted.tolist():
        points, values = _by_surface(surfaces, condition)
        away = np.abs(values - outcomes[lost == condition][:, None]).min(axis=0)
        surfaces.sharpen(
            np.arange(members.size) == condition, points[np.argsort(away)[: OUTCOME_SEARCH.draws]]
        )
    return bool(granted.size)


def _holding(region: Array, x: Array, box: Array) -> Array:
    """The region (n, 2), widened to contain the point x of its non-constant parameters."""
    moving = moving_parameters(region)
    wide = region.copy()
    inside = np.clip(x, *region[moving].T)
    wide[moving] = hull(region[moving], np.repeat((x + 0.5 * (x - inside))[:, None], 2, axis=1))
    return within(box, wide)


def _spread(box: Array) -> Array:
    """Quasi-random points (4096, n) that fill the parameters' ranges `box` (n, 2)."""
    axes = Axes(box, logarithms(box))
    return np.asarray(
        axes.outward(2.0 * qmc.Sobol(len(box), rng=0).random(OUTCOME_SEARCH.candidates) - 1.0)
    )


def _by_surface(surfaces: AdaptiveSurfaces, condition: int) -> tuple[Array, Array]:
    """Points (4096, n) that fill the surfaces' region, and one surface's outcomes there (4096,)."""
    points = _spread(surfaces.box)
    return points, surfaces.surface().take(np.array([condition])).evaluate(points)[0]
