"""The first runs of a study: does the simulator reach the measured values, and at what cost?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from scipy import stats

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Flags, Indices
from aleator.errors import WORKING_BOX, SimulatorError, count
from aleator.fit.question import (
    grids_each,
    is_exact,
    runs_each,
    start_point,
    way_of,
    way_of_outcomes,
)
from aleator.fit.regions import widest_region
from aleator.fit.rounds import confirming, enlarged, usual
from aleator.inference.check import Check
from aleator.laws import Free
from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Conditions, Experiments, covariates
from aleator.observations.noise import Noise
from aleator.observations.responses import Transform
from aleator.simulators import Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import ResponseSurface
from aleator.surrogates.adaptive import first_runs, linear_runs
from aleator.surrogates.choice import by_process
from aleator.surrogates.processes import first_process_runs
from aleator.surrogates.samples import features

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


@dataclass(frozen=True, eq=False)
class SingleValues:
    """V single numbers among the outputs of the simulator's runs, each with a name in `ids`.

    `owner` has the experiment of each. `unit` (V,) is the index of the simulated conditions in the
    runner, and `column` (V,) the place among the outputs of such a run.
    """

    runner: Runner
    ids: tuple[str, ...]
    owner: tuple[str, ...]
    unit: Indices
    column: Indices

    def __call__(self, index: Indices, x: Array) -> Array:
        """The values (R,) with numbers `index` (R,) at parameters x (R, n).

        Raises SimulatorError if a run failed.
        """
        whole = self.runner.values(self.unit[index], x)
        found = np.asarray(whole[np.arange(len(whole)), self.column[index]])
        lost = np.flatnonzero(np.isnan(found))
        if lost.size:
            why = self.runner.failures.failures
            reason = next(iter(why.values())).message if why else "no value"
            raise SimulatorError(
                f"a run failed for {self.ids[index[lost[0]]]}: {reason}",
                f"let {WORKING_BOX} find where every run works",
            )
        return found


def fixed_noise(
    table: Experiments, noise: Noise | Mapping[str, Noise] | None
) -> dict[str, dict[str, float]]:
    """The known numbers of the noise of each response, if each experiment has one value.

    One value an experiment hardly tells the noise from the law: the identified law rests on these.
    """
    seen = table.observations
    if noise is None or np.bincount(seen.experiment).max(initial=0) > 1:
        return {}
    each = dict.fromkeys(seen.names, noise) if isinstance(noise, Noise) else noise
    parts = {name: {"sd": one.sd, "relative": one.relative} for name, one in each.items()}
    free = any(isinstance(part, Free) for one in parts.values() for part in one.values())
    return {} if free else {
        name: {key: float(part) for key, part in one.items() if isinstance(part, float | int)}
        for name, one in parts.items()
        if not isinstance(one["sd"], str)
    }  # fmt: skip


def of_values(runner: Runner, table: Experiments | Conditions) -> SingleValues:
    """The simulated value of every observation of a table, named by experiment, row, response."""
    seen = table.observations
    several = np.bincount(table.experiment, minlength=len(table.ids)) > 1
    place = pd.Series(table.experiment).groupby(table.experiment).cumcount().to_numpy()
    names = []
    for l, row, k in zip(seen.experiment, seen.row, seen.response, strict=True):
        rows = [f"row {place[row] + 1}"] if several[l] else []
        response = [seen.responses[k].name] if len(seen.responses) > 1 else []
        names.append(", ".join([table.ids[l], *rows, *response]))
    owner = tuple(table.ids[l] for l in seen.experiment)
    return SingleValues(runner, tuple(names), owner, runner.unit, runner.column)


def one_each(runner: Runner) -> bool:
    """Whether each simulator run belongs to one experiment and gives one value."""
    return runner.units == len(runner.ids) and bool(
        np.array_equal(runner.unit, np.arange(runner.units))
    )


@dataclass(frozen=True)
class LookSettings:
    """Settings for the number of first runs and for their report; chosen by judgement."""

    levels: int = 3
    """The number of values of each parameter, while the others are in the middle of the region.
    What lies between them is looked for only where a measured value is out of reach. Five values
    took 78 runs in place of 54 for 24 beams under six conditions, with the same report."""
    corners: int = 4
    """The largest number of parameters for which every corner of the region is run. With more
    parameters as many corners are chosen at random."""
    runs: int = 500
    """The number of runs above which only some of the conditions are simulated."""
    fewest: int = 3
    """The least number of conditions that are simulated."""
    most_failed: float = 0.9
    """The share of failed runs above which an error is raised, if they are ten or more."""
    sure: float = 3.0
    """The number of standard deviations of the noise by which a measured value may lie outside the
    range of simulated values."""
    tiny: float = 1e-300
    """The least size of an outcome in the test whether a parameter has any influence."""
    nothing: float = 1e-6
    """The share of an outcome's whole range below which a parameter's effect counts as zero."""
    near: int = 20
    """The largest number of values out of reach near which more runs are made: the nearest ones."""
    halvings: int = 5
    """How often the steps of these runs are halved: a maximum between two values of a parameter
    is then met within a 64th of its range."""
    chance: float = 1e-3
    """Probability, under the stated noise, of repeats that scatter so much: the noise is called too
    small below it. One right study in a thousand is then told so."""


LOOK = LookSettings()


@dataclass(frozen=True, eq=False)
class LookPlan:
    """The plan of the first runs: P parameter points x (P, n) of a region, and some conditions.

    Point 0 is the middle of the region. `moving` are the indices of the parameters that are not
    constant. `star[j]` are the points at which only parameter `moving[j]` differs from the middle.
    `edges[j]` (E, 2) are pairs of corners that differ in this parameter only. `cases` are the
    indices of the conditions to be run among the `count` different ones.
    """

    names: tuple[str, ...]
    region: Array
    moving: Indices
    x: Array
    star: Indices
    edges: tuple[Indices, ...]
    cases: Indices
    count: int

    @property
    def runs(self) -> int:
        """The number of runs of the plan."""
        return len(self.x) * len(self.cases)

    def more(self, settings: LookSettings = LOOK) -> int:
        """The largest number of further runs near measured values that are out of reach."""
        return 2 * len(self.moving) * settings.near * settings.halvings


@dataclass(frozen=True, eq=False)
class Look:
    """The result of the first runs: simulated values of V observations at P points.

    `outcome` (V, P) are the simulated values, NaN where a run failed. `ids` (V,) are the names of
    the observations, `owner` (V,) their experiments and `response` (V,) their responses. `lower`
    and `upper` (V,) are the ends of the measured values, after the transform of the response.
    `margin` (V,) is how far three standard deviations of the noise, as known or at the start of its
    search, reach from the simulated values beyond their range, on the side of the measured value.
    `runs` is the number of runs, `failed` of which have no outcome; `seconds` is the time
    of one run, and `fault` the most frequent message of failures. `looked_at` is the number of
    conditions that were run. `lost` has the experiments of which no run works, each with its row,
    its conditions and the message of its failures. `transforms` (V,) are those of the responses;
    `untransformed` gives values in the unit of the outcome. `closest` (V, n) is the point of the
    run whose outcome comes closest to the measured value, and `closest_outcome` (V,) that outcome:
    runs near it were made for values out of reach. `failing` has for each parameter that tells
    failed runs from others the sign >= or <= and the value from which, or up to which, all runs
    failed.
    """

    plan: LookPlan
    ids: tuple[str, ...]
    owner: tuple[str, ...]
    response: tuple[str, ...]
    lower: Array
    upper: Array
    margin: Array
    outcome: Array
    seconds: float
    runs: int
    failed: int
    fault: str
    looked_at: int
    closest: Array
    closest_outcome: Array
    failing: Mapping[str, tuple[str, float]]
    lost: Mapping[str, str]
    transforms: tuple[Transform, ...]
    settings: LookSettings = LOOK

    def untransformed(self, values: Array) -> Array:
        """Values (V, ...) of the observations in the unit of the outcome, without the transform."""
        found = np.array(values, dtype=float)
        with np.errstate(over="ignore"):
            for transform in set(self.transforms):
                own = [one is transform for one in self.transforms]
                found[own] = transform.inverse(found[own])
        return found

    @property
    def reached(self) -> Array:
        """The least and the largest outcome (V, 2) of each observation over all points."""
        every = np.column_stack([self.outcome, self.closest_outcome])
        with np.errstate(all="ignore"):
            return np.stack([np.fmin.reduce(every, axis=1), np.fmax.reduce(every, axis=1)], axis=1)

    @property
    def beyond(self) -> Array:
        """The distance (V,) of each measured value from the range of simulated values.

        It is zero inside the range, positive above and negative below it. Of a censored value the
        nearest end counts. NaN if every run failed.
        """
        return _beyond(self.lower, self.upper, *self.reached.T)

    @property
    def out_of_reach(self) -> Indices:
        """The indices of observations beyond all simulated values and the noise, farthest first."""
        far = np.maximum(np.abs(self.beyond) - self.margin, 0.0)
        order = np.argsort(-np.nan_to_num(far), kind="stable")
        return order[far[order] > 0.0]

    @property
    def noises_beyond(self) -> float | None:
        """The median distance of values out of reach, in sds of the noise; None without noise."""
        far = self.out_of_reach
        if not far.size or not np.all(self.margin[far] > 0.0):
            return None
        sd = self.margin[far] / self.settings.sure
        return float(np.median(np.abs(self.beyond[far]) / sd))

    @property
    def swing(self) -> Array:
        """The range (V, n') of each outcome when only one of the n' parameters varies.

        It is in the unit of the outcome, without the transform of the response.
        """
        part = self.untransformed(self.outcome)[:, self.plan.star]
        with np.errstate(all="ignore"):
            return np.asarray(np.fmax.reduce(part, axis=2) - np.fmin.reduce(part, axis=2))

    @property
    def at_limit(self) -> tuple[str, str, float] | None:
        """A parameter and its lower or upper limit, at which all closest runs to values lie.

        These values are out of reach. None if there is no such parameter.
        """
        points = self.closest[self.out_of_reach]
        for i in self.plan.moving if len(points) else ():
            for side, end in zip(("lower", "upper"), self.plan.region[i].tolist(), strict=True):
                if np.all(points[:, i] == end):
                    return self.plan.names[i], side, end
        return None

    @property
    def without_influence(self) -> Flags:
        """Which of the n' varied parameters have no effect on any outcome, alone or at corners."""
        low, high = self.untransformed(self.reached).T
        size = self.settings.nothing * np.maximum(np.abs(high), self.settings.tiny)
        least = np.where(
            high > low, self.settings.nothing * high - self.settings.nothing * low, size
        )
        swing, own = self.swing, self.untransformed(self.outcome)
        with np.errstate(all="ignore"):
            for j, pairs in enumerate(self.plan.edges):
                apart = np.abs(np.diff(own[:, pairs], axis=2)[:, :, 0])
                swing[:, j] = np.fmax(swing[:, j], np.fmax.reduce(apart, axis=1, initial=0.0))
        return np.asarray(np.all(~(swing > least[:, None]), axis=0))


def planned_look(
    runner: Runner, table: Experiments, inputs: Inputs, settings: LookSettings = LOOK
) -> LookPlan:
    """The parameter points and conditions of the first runs of a study; nothing is run.

    Each parameter takes three values over the region, with the others in the middle. Then the
    corners of the region follow, sixteen at most. The region consists of the parameters' ranges; if
    these are not all finite, it is what the laws cover at the limits of their hyperparameters. All
    conditions are run if that makes at most 500 runs. Otherwise some are chosen evenly over the
    measured values, with the least and the largest.
    """
    if inputs.individual_laws:
        inputs = inputs.resolved(covariates(table, inputs.columns))
    region = widest_region(inputs, inputs.hyperparameters, len(table.ids))
    moving = moving_parameters(region)
    x, star, edges = _points(region, moving, settings)
    return LookPlan(
        inputs.names, region, moving, x, star, edges,
        _chosen(runner, table, settings.runs // len(x), settings), len(runner.cases),
    )  # fmt: skip


def first_look(
    runner: Runner,
    table: Experiments,
    plan: LookPlan,
    noise: Noise | Mapping[str, Noise] | None = None,
    progress: Progress | None = None,
    settings: LookSettings = LOOK,
) -> Look:
    """Make the first runs of a plan; a vectorized simulator is run under all conditions.

    Where a measured value is out of reach of these, more runs are made near the closest one, for
    the twenty nearest such values: steps up and down of each parameter, halved up to five times.
    Single failing runs are counted. Raises SimulatorError if all of these runs fail, or more than
    nine of ten of many.
    """
    progress = progress or Silent()
    cases = plan.cases
    values = _run(runner, cases, plan.x, progress, settings)
    rest = np.setdiff1d(np.arange(plan.count), cases)
    if rest.size and runner.vectorized:
        values |= _run(runner, rest, plan.x, progress, settings)
    runner.require_some_outcome()
    single, seen = of_values(runner, table), table.observations
    case = runner.cases.condition[single.unit]
    there = np.flatnonzero([int(c) in values for c in case])
    outcome = np.array([values[int(case[k])][:, single.column[k]] for k in there])
    lower, upper = seen.lower[there], seen.upper[there]
    with np.errstate(all="ignore"):
        ends = np.fmin.reduce(outcome, axis=1), np.fmax.reduce(outcome, axis=1)
        side = np.sign(_beyond(lower, upper, *ends))
    margin = np.zeros(len(there))
    if noise is not None:
        below, above = _margins(table, noise, there, outcome, settings)
        margin = np.where(side < 0.0, below, np.where(side > 0.0, above, np.fmin(below, above)))
    goals = _Goals(lower, upper, margin, np.asarray(there), side)
    closest, found = _approached(single, goals, plan, outcome, settings)
    fault = runner.failures.frequent_failure()
    names = table.observations.names
    return Look(
        plan,
        tuple(single.ids[k] for k in there),
        tuple(single.owner[k] for k in there),
        tuple(names[seen.response[k]] for k in there),
        lower,
        upper,
        margin,
        outcome,
        runner.seconds,
        len(runner.completed) + len(runner.failures),
        len(runner.failures),
        fault.message if fault else "",
        len(values),
        closest,
        found,
        _failing(runner, plan),
        _lost(runner, table, there, outcome),
        tuple(seen.responses[k].transform for k in seen.response[there]),
    )


def understated_noise(
    runner: Runner,
    table: Experiments,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise] | None,
    settings: LookSettings = LOOK,
) -> dict[str, dict[str, float]]:
    """The responses whose repeats scatter more than the noise explains: both sds, and df.

    Repeats are measured values under the same conditions in one experiment, or where no parameter
    scatters in all experiments with the same covariates. With the means m of their groups and the
    noise's sd s there, at its upper limit where it is identified, sum (y - m)^2/s^2 has the
    chi-squared law with df degrees of freedom for independent normal noise: other noise is left
    out. `repeats` is the pooled sd, and `noise` the root mean square of s. No runs are made.
    """
    if noise is None:
        return {}
    seen, errors = table.observations, MeasurementErrors.of(noise, table)
    alone = seen.experiment
    if not inputs.scattering:
        laws = [*map(tuple, covariates(table, inputs.covariates).to_numpy(dtype=object))]
        place = {law: k for k, law in enumerate(laws)}
        alone = np.array([place[law] for law in laws])[alone]
    case = runner.cases.condition[runner.unit]
    keys = np.stack([alone, case, runner.column, seen.response], axis=1)[seen.measured]
    group = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    y, response = seen.lower[seen.measured], seen.response[seen.measured]
    mean = (np.bincount(group, y) / np.bincount(group))[group]
    eta = np.zeros((len(seen), 1))
    eta[seen.measured, 0] = mean
    widest = np.array([h.upper for h in errors.hyperparameters])
    with np.errstate(all="ignore"):
        sd = errors.scale(widest, eta, slice(0, len(eta)))[seen.measured, 0]
    found = {}
    for k, (name, part) in enumerate(zip(seen.names, errors.parts, strict=True)):
        if not part.noise.normal or part.noise.correlation is not None:
            continue
        own = (response == k) & (np.bincount(group)[group] > 1)
        df = int(own.sum()) - np.unique(group[own]).size
        total = float(np.sum(((y[own] - mean[own]) / sd[own]) ** 2))
        if df and stats.chi2.sf(total, df) < settings.chance:
            pooled = float(np.sqrt(np.sum((y[own] - mean[own]) ** 2) / df))
            stated = float(np.sqrt(np.mean(sd[own] ** 2)))
            found[name] = {"repeats": pooled, "noise": stated, "df": df}
    return found


def _lost(runner: Runner, table: Experiments, there: Indices, outcome: Array) -> dict[str, str]:
    """The experiments with an observation of which no run works: row, conditions and message.

    `outcome` (V, P) are the outcomes of the observations with numbers `there`.
    """
    failures, seen, found = runner.failures, table.observations, dict[str, str]()
    case = runner.cases.condition[runner.unit[there]]
    for k in np.flatnonzero(np.all(np.isnan(outcome), axis=1)).tolist():
        row, own = int(seen.row[there[k]]), np.flatnonzero(failures.case == case[k])
        cells = table.conditions.iloc[row].items()
        at = ", ".join(f"{n} = {v:g}" if isinstance(v, float) else f"{n} = {v}" for n, v in cells)
        why = failures.failures[int(own[0])].message if own.size else ""
        name = table.ids[seen.experiment[there[k]]]
        found.setdefault(name, ": ".join(filter(None, [table.places[row], at, why])))
    return found


def _beyond(lower: Array, upper: Array, low: Array, high: Array) -> Array:
    """The distance of measured values within [lower, upper] from outcomes within [low, high]."""
    above = np.maximum(lower - high, 0.0)
    return np.asarray(np.where(above > 0.0, above, np.minimum(upper - low, 0.0)))


@dataclass(frozen=True, eq=False)
class _Goals:
    """The measured values (V,) that runs should reach within margins, and their numbers `index`.

    `side` is 1 for a value above all outcomes so far, -1 for one below, and 0 for one within.
    """

    lower: Array
    upper: Array
    margin: Array
    index: Indices
    side: Array

    def missed(self, outcome: Array, of: Indices | slice = slice(None)) -> Array:
        """By how much outcomes (V,) do not come to goals `of`; infinite where a run failed."""
        above = self.lower[of] - self.margin[of] - outcome
        below = outcome - self.upper[of] - self.margin[of]
        with np.errstate(invalid="ignore"):
            gap = np.where(self.side[of] > 0.0, above, np.where(self.side[of] < 0.0, below, 0.0))
        return np.where(np.isnan(outcome), np.inf, np.maximum(gap, 0.0))


def _approached(
    single: SingleValues, goals: _Goals, plan: LookPlan, outcome: Array, settings: LookSettings
) -> tuple[Array, Array]:
    """The closest points (V, n) to the measured values and their outcomes (V,).

    Of values that no outcome (V, P) reaches, the nearest ones are approached by more runs, until
    these come to the value, or lead to a corner of the region from which no step comes nearer.
    """
    gaps = np.stack([goals.missed(column) for column in outcome.T], axis=1)
    best, every = np.argmin(gaps, axis=1), np.arange(len(gaps))
    closest, found, gap = plan.x[best].copy(), outcome[every, best].copy(), gaps[every, best]
    width = np.diff(plan.region, axis=1)[:, 0] / (settings.levels - 1)
    part = outcome[:, plan.star]
    with np.errstate(all="ignore"):
        swing = np.fmax.reduce(part, axis=2) - np.fmin.reduce(part, axis=2)
    moved = plan.moving[np.any(swing > 0.0, axis=0)]
    left = np.argsort(gap, kind="stable")
    left = left[(gap[left] > 0.0) & np.isfinite(gap[left])][: settings.near]
    for halved in range(1, settings.halvings + 1):
        of, i = np.repeat(left, 2 * len(moved)), np.tile(np.repeat(moved, 2), len(left))
        side, row = np.tile([-1.0, 1.0], len(of) // 2), np.arange(len(of))
        x = closest[of]
        x[row, i] += 0.5**halved * side * width[i]
        inside = (x[row, i] >= plan.region[i, 0]) & (x[row, i] <= plan.region[i, 1])
        of, x, number = of[inside], x[inside], goals.index[of[inside]]
        if not of.size:
            break
        whole = single.runner.values(single.unit[number], x, settings.most_failed)
        value, before = whole[np.arange(len(of)), single.column[number]], gap.copy()
        for k, miss, point, one in zip(of, goals.missed(value, of), x, value, strict=True):
            if miss < gap[k]:
                gap[k], closest[k], found[k] = miss, point, one
        near = closest[:, moved]
        ends = np.all((near == plan.region[moved, 0]) | (near == plan.region[moved, 1]), axis=1)
        left = np.array([k for k in left if gap[k] > 0.0 and (gap[k] < before[k] or not ends[k])])
        left = left.astype(np.intp)
    return closest, found


def _failing(runner: Runner, plan: LookPlan) -> dict[str, tuple[str, float]]:
    """The parameters that tell failed runs from others: all failed above, or below, a value."""
    lost, worked = runner.failures.x, runner.completed.x
    found: dict[str, tuple[str, float]] = {}
    for i in plan.moving if len(lost) and len(worked) else ():
        if lost[:, i].min() > worked[:, i].max():
            found[plan.names[i]] = (">=", float(lost[:, i].min()))
        elif lost[:, i].max() < worked[:, i].min():
            found[plan.names[i]] = ("<=", float(lost[:, i].max()))
    return found


def _margins(
    table: Experiments,
    noise: Noise | Mapping[str, Noise],
    there: Indices,
    outcome: Array,
    settings: LookSettings,
) -> tuple[Array, Array]:
    """How far the noise reaches below and above (V,) the range of outcomes (V, P).

    From each outcome it reaches three standard deviations, as known or at the start of its search.
    One that grows with the outcome is small at the least of them: the largest standard deviation
    says nothing of a value below the range. Zero where every run failed.
    """
    errors = MeasurementErrors.of(noise, table)
    values = np.array([h.start for h in errors.hyperparameters])
    eta = np.zeros((len(table.observations), outcome.shape[1]))
    eta[there] = np.nan_to_num(outcome)
    with np.errstate(all="ignore"):
        reach = settings.sure * errors.scale(values, eta, slice(0, len(eta)))[there]
        below = np.fmin.reduce(outcome, axis=1) - np.fmin.reduce(outcome - reach, axis=1)
        above = np.fmax.reduce(outcome + reach, axis=1) - np.fmax.reduce(outcome, axis=1)
    return np.nan_to_num(below), np.nan_to_num(above)


def _points(
    region: Array, moving: Indices, settings: LookSettings
) -> tuple[Array, Indices, tuple[Indices, ...]]:
    """The points (P, n) of a plan, those that vary one parameter each, and pairs of corners."""
    middle = region.mean(axis=1)
    shares = np.linspace(0.0, 1.0, settings.levels)
    points, star = [middle], np.zeros((len(moving), settings.levels), dtype=np.intp)
    for j, i in enumerate(moving):
        for k, share in enumerate(shares.tolist()):
            if share != 0.5:
                star[j, k] = len(points)
                points.append(middle.copy())
                points[-1][i] = region[i, 0] + share * (region[i, 1] - region[i, 0])
    corners = _corners(len(moving), settings) if len(moving) > 1 else []
    at = {tuple(corner.tolist()): len(points) + k for k, corner in enumerate(corners)}
    for corner in corners:
        points.append(middle.copy())
        points[-1][moving] = region[moving, corner]
    edges = [
        [(place, other) for corner, place in at.items() if corner[j] == 0
         and (other := at.get((*corner[:j], 1, *corner[j + 1 :]))) is not None]
        for j in range(len(moving))
    ]  # fmt: skip
    pairs = (np.array(one, dtype=np.intp).reshape(-1, 2) for one in edges)
    return np.array(points), star, tuple(pairs)


def _corners(n: int, settings: LookSettings) -> list[Indices]:
    """The corners of the region, each with 0 (lower) or 1 (upper) for n parameters; 16 at most."""
    if n <= settings.corners:
        return [np.array(ends) for ends in product((0, 1), repeat=n)]
    some = np.random.default_rng(0).integers(0, 2, (2 ** (settings.corners - 1), n))
    return [*some, *(1 - some)]


def _chosen(runner: Runner, table: Experiments, most: int, settings: LookSettings) -> Indices:
    """The indices of at most `most` conditions, chosen evenly over the measured values."""
    count, seen = len(runner.cases), table.observations
    if count <= most:
        return np.arange(count)
    measured = np.where(np.isfinite(seen.lower), seen.lower, seen.upper)
    value = np.full(count, np.nan)
    value[runner.cases.condition[runner.unit]] = measured
    order = np.argsort(value, kind="stable")
    some = np.linspace(0, count - 1, max(most, settings.fewest)).round().astype(np.intp)
    return np.sort(order[np.unique(some)])


def _run(
    runner: Runner, cases: Indices, x: Array, progress: Progress, settings: LookSettings
) -> dict[int, Array]:
    progress.update(f"{count(len(cases) * len(x), 'run')} under {count(len(cases), 'condition')}")
    units = np.repeat(runner.cases.first[cases], len(x))
    found = runner.values(units, np.tile(x, (len(cases), 1)), settings.most_failed)
    return dict(zip(cases.tolist(), found.reshape(len(cases), len(x), -1), strict=True))


@dataclass(frozen=True)
class CostSettings:
    """Settings for predicting the number of simulator runs of an identification.

    `growth` is the least and largest ratio of all runs of response surfaces to the runs of their
    first round. It was measured in the examples and in trials with one and two parameters: 4.1 for
    the wet clutch, 4.7 for an oscillating outcome with small noise. The largest number of checking
    runs is that of `Check`. `process` is the largest ratio of all runs of Gaussian processes to the
    fewest that they can take: 1.0 to 3.8 in the studies of `python -m benchmarks.forecasts`.
    """

    growth: tuple[float, float] = (1.0, 5.0)
    process: float = 4.0


COST = CostSettings()


@dataclass(frozen=True)
class Cost:
    """The expected number of simulator runs of an identification, from `least` to `most`.

    `direct` is true if the simulator itself is run at every quadrature node, without response
    surfaces. Such runs are not stored. `reused` is true if there is a store and the identification
    begins with its runs, those of the first look among them.
    """

    least: int
    most: int
    direct: bool
    reused: bool = False


def expected_cost(
    runner: Runner,
    table: Experiments,
    inputs: Inputs,
    noise: Noise | Mapping[str, Noise] | None,
    propagation: ResponseSurface | Collocation,
    density: Density | None,
    verification: Check,
    plan: LookPlan,
    settings: CostSettings = COST,
) -> Cost | None:
    """The expected number of simulator runs of `identify`; None with collocation.

    Processes take at least their first runs, two rounds, and a run that is made twice. The other
    ratios were measured in studies (docs/evidence.md). An outcome that is strongly nonlinear within
    the law takes more runs. Runs that are stored already count among them.
    """
    if not isinstance(propagation, ResponseSurface):
        return None
    alone = not is_exact(table, inputs, noise)
    at = plan.x[0]
    if alone and not inputs.regressed:
        at = start_point(inputs).clip(*inputs.box.T)
    if alone and way_of(runner, propagation, at, plan.region).direct:
        low, high = runs_each(inputs)
        return Cost(low * runner.units, high * runner.units, True)
    if not alone and way_of_outcomes(runner, Model.of(inputs, propagation, density)).direct:
        low, high = grids_each(inputs, len(runner.cases), table.exact_each or 1)
        return Cost(low * len(runner.cases), high * len(runner.cases), True)
    moving = len(plan.moving)
    if by_process(propagation, density is not None):
        cases = len(runner.cases)
        known = features(runner.cases.columns, cases).shape[1]
        together = enlarged(runner, propagation)
        each = first_process_runs(cases, known + moving, together, moving * runner.sloped)
        low = each * cases + confirming(runner.sloped) * max(together, usual(cases)) + 1
        high, most = int(settings.process * low), propagation.max_runs * cases
        return Cost(min(low, most), min(high, most), False, reused=runner.cache is not None)
    few = linear_runs(moving, propagation, plan.count)
    begun = few, first_runs(moving, propagation)
    given = verification.samples
    check = (0, verification.most if given is None else given)
    least, most = (
        plan.count * min(int(growth * first), propagation.max_runs) + runs * runner.units
        for growth, first, runs in zip(settings.growth, begun, check, strict=True)
    )
    return Cost(least, most, False)
