"""The first runs of a study, and its cost: does the simulator reach what was measured?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Flags, Indices
from aleator.errors import SimulatorError
from aleator.fit.question import (
    grids_each,
    is_exact,
    runs_each,
    start_point,
    way_of,
    way_of_outcomes,
)
from aleator.fit.regions import first_region
from aleator.inference.check import Check
from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.observations.errors import MeasurementErrors, Noise
from aleator.observations.experiments import Conditions, Experiments, covariates
from aleator.simulators import Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import ResponseSurface
from aleator.surrogates.adaptive import first_runs, linear_runs

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


@dataclass(frozen=True, eq=False)
class SingleValues:
    """Single values of the simulator's runs, each with a name; `owner` names its experiment.

    `unit`, `column` (V,) say which value of which unit of the runner each is.
    """

    runner: Runner
    ids: tuple[str, ...]
    owner: tuple[str, ...]
    unit: Indices
    column: Indices

    def __call__(self, index: Indices, x: Array) -> Array:
        """Values `index` (R,) at parameters x (R, n); raises SimulatorError where a run failed."""
        whole = self.runner.values(self.unit[index], x)
        found = np.asarray(whole[np.arange(len(whole)), self.column[index]])
        lost = np.flatnonzero(np.isnan(found))
        if lost.size:
            why = self.runner.failures.failures
            reason = next(iter(why.values())).message if why else "no value"
            raise SimulatorError(
                f"a run failed for {self.ids[index[lost[0]]]}: {reason}",
                "let `aleator box STUDY.toml` find where every run works",
            )
        return found


def of_values(runner: Runner, table: Experiments | Conditions) -> SingleValues:
    """Every observation of a table, named by experiment, row and response."""
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
    """Whether each run serves one experiment and gives one value."""
    return runner.units == len(runner.ids) and bool(
        np.array_equal(runner.unit, np.arange(runner.units))
    )


@dataclass(frozen=True)
class LookSettings:
    """How many first runs there are, and what is reported of them; by judgement."""

    levels: int = 5
    """Values of each parameter, the others in the middle of the region."""
    corners: int = 4
    """Parameters of which every corner of the region is run; of more as many corners, at random."""
    runs: int = 500
    """Runs that are made for some of the conditions where all would take more, or long."""
    fewest: int = 3
    """Conditions that are looked at, at least."""
    most_failed: float = 0.9
    """Share of failed runs at which there is nothing to look at."""
    sure: float = 3.0
    """Standard deviations of the noise by which a measured value may lie beyond what is reached."""
    tiny: float = 1e-300
    """An outcome below this is as large."""
    nothing: float = 1e-6
    """Share of all that an outcome moves below which a parameter has no influence."""


LOOK = LookSettings()


@dataclass(frozen=True, eq=False)
class LookPlan:
    """The plan of the first runs: P points x (P, n) of the region under some conditions.

    `moving` are the parameters whose region has a width; `star[j]` are the points at which only
    parameter `moving[j]` differs from the middle, which is point 0. `cases` are the places of these
    conditions among the `count` different ones.
    """

    names: tuple[str, ...]
    region: Array
    moving: Indices
    x: Array
    star: Indices
    cases: Indices
    count: int

    @property
    def runs(self) -> int:
        """The number of runs of the plan."""
        return len(self.x) * len(self.cases)


@dataclass(frozen=True, eq=False)
class Look:
    """V observations at the P points of a plan: `outcome` (V, P), NaN where a run failed.

    `ids` (V,) name them, `owner` (V,) their experiments, `response` (V,) their responses; `lower`
    and `upper` (V,) are what was measured, as the likelihood sees it, and `margin` (V,) is what
    noise explains: three of its standard deviations, known or where their search begins.
    `runs` were made in all, `failed` of them have no outcome, and one took `seconds`. `fault` is
    why the first of them failed.
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
    settings: LookSettings = LOOK

    @property
    def reached(self) -> Array:
        """The least and the largest outcome (V, 2) of each observation over all points."""
        with np.errstate(all="ignore"):
            low = np.fmin.reduce(self.outcome, axis=1)
            return np.stack([low, np.fmax.reduce(self.outcome, axis=1)], axis=1)

    @property
    def beyond(self) -> Array:
        """How far (V,) each measured value lies outside the reached range: 0 inside, > 0 above.

        Of a censored one the nearest end counts. NaN where every run failed.
        """
        low, high = self.reached.T
        above = np.maximum(self.lower - high, 0.0)
        return np.asarray(np.where(above > 0.0, above, np.minimum(self.upper - low, 0.0)))

    @property
    def out_of_reach(self) -> Indices:
        """Observations that no point reaches, noise included, the farthest first."""
        far = np.maximum(np.abs(self.beyond) - self.margin, 0.0)
        order = np.argsort(-np.nan_to_num(far), kind="stable")
        return order[far[order] > 0.0]

    @property
    def swing(self) -> Array:
        """How much (V, n') each moving parameter alone moves each outcome."""
        part = self.outcome[:, self.plan.star]
        with np.errstate(all="ignore"):
            return np.asarray(np.fmax.reduce(part, axis=2) - np.fmin.reduce(part, axis=2))

    @property
    def without_influence(self) -> Flags:
        """Which moving parameters (n',) move no outcome."""
        low, high = self.reached.T
        size = self.settings.nothing * np.maximum(np.abs(high), self.settings.tiny)
        least = np.where(
            high > low, self.settings.nothing * high - self.settings.nothing * low, size
        )
        return np.asarray(np.all(~(self.swing > least[:, None]), axis=0))


def planned_look(
    runner: Runner, table: Experiments, inputs: Inputs, settings: LookSettings = LOOK
) -> LookPlan:
    """The few points and conditions of the first runs of a study.

    One after the other each parameter takes five values over the region, the others in its middle;
    then the corners of the region follow, sixteen at most. The region is the box, or where a law
    has none what its limits span. All conditions are taken if that makes 500 runs at most, else as
    many as make 500, evenly over the measured values with both ends. Nothing is run.
    """
    if inputs.regressed:
        inputs = inputs.resolved(covariates(table, inputs.covariates))
    region = first_region(inputs, inputs.hyperparameters, len(table.ids))
    moving = moving_parameters(region)
    x, star = _points(region, moving, settings)
    return LookPlan(
        inputs.names, region, moving, x, star,
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
    """Make the first runs; of a vectorized simulator under all conditions.

    A run that fails stops nothing. Raises SimulatorError where nine of ten do.
    """
    progress = progress or Silent()
    cases = plan.cases
    values = _run(runner, cases, plan.x, progress, settings)
    rest = np.setdiff1d(np.arange(plan.count), cases)
    if rest.size and runner.vectorized:
        values |= _run(runner, rest, plan.x, progress, settings)
    single, seen = of_values(runner, table), table.observations
    case = runner.cases.condition[single.unit]
    there = np.flatnonzero([int(c) in values for c in case])
    outcome = np.array([values[int(case[k])][:, single.column[k]] for k in there])
    faults = runner.failures.failures
    names = table.observations.names
    return Look(
        plan,
        tuple(single.ids[k] for k in there),
        tuple(single.owner[k] for k in there),
        tuple(names[seen.response[k]] for k in there),
        seen.lower[there],
        seen.upper[there],
        np.zeros(len(there)) if noise is None else _margin(table, noise, there, outcome, settings),
        outcome,
        runner.seconds,
        len(runner.completed) + len(runner.failures),
        len(runner.failures),
        next(iter(faults.values())).message if faults else "",
        len(values),
    )


def _margin(
    table: Experiments,
    noise: Noise | Mapping[str, Noise],
    there: Indices,
    outcome: Array,
    settings: LookSettings,
) -> Array:
    """Three standard deviations of the noise, in the middle of its limits."""
    errors = MeasurementErrors.of(noise, table)
    values = np.array([h.start for h in errors.hyperparameters])
    eta = np.zeros((len(table.observations), 1))
    with np.errstate(all="ignore"):
        eta[there, 0] = np.nan_to_num(np.fmax.reduce(outcome, axis=1))
    return np.asarray(settings.sure * errors.scale(values, eta, slice(0, len(eta)))[there, 0])


def _points(region: Array, moving: Indices, settings: LookSettings) -> tuple[Array, Indices]:
    """The points (P, n) of a plan, the middle first, and the places of each parameter's own."""
    middle = region.mean(axis=1)
    shares = np.linspace(0.0, 1.0, settings.levels)
    points, star = [middle], np.zeros((len(moving), settings.levels), dtype=np.intp)
    for j, i in enumerate(moving):
        for k, share in enumerate(shares.tolist()):
            if share != 0.5:
                star[j, k] = len(points)
                points.append(middle.copy())
                points[-1][i] = region[i, 0] + share * (region[i, 1] - region[i, 0])
    if len(moving) > 1:
        for corner in _corners(len(moving), settings):
            points.append(middle.copy())
            points[-1][moving] = region[moving, corner]
    return np.array(points), star


def _corners(n: int, settings: LookSettings) -> list[Indices]:
    """The ends of n parameters at every corner of the region, or at sixteen corners."""
    if n <= settings.corners:
        return [np.array(ends) for ends in product((0, 1), repeat=n)]
    some = np.random.default_rng(0).integers(0, 2, (2 ** (settings.corners - 1), n))
    return [*some, *(1 - some)]


def _chosen(runner: Runner, table: Experiments, most: int, settings: LookSettings) -> Indices:
    """At most `most` conditions, evenly over the measured values."""
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
    progress.update(f"{len(cases) * len(x)} runs under {len(cases)} conditions")
    units = np.repeat(runner.cases.first[cases], len(x))
    found = runner.values(units, np.tile(x, (len(cases), 1)), settings.most_failed)
    return dict(zip(cases.tolist(), found.reshape(len(cases), len(x), -1), strict=True))


@dataclass(frozen=True)
class CostSettings:
    """How the number of runs is predicted.

    growth: runs that surfaces came to, over those of their first round, least and most, in the
    examples and in trials of one and two parameters: the wet clutch 4.1, an outcome that wiggles
    against a small noise 4.7. The most runs of each unit for the check are those of `Check`.
    """

    growth: tuple[float, float] = (1.0, 5.0)


COST = CostSettings()


@dataclass(frozen=True)
class Cost:
    """Runs that an identification takes, from `least` to `most`.

    `direct` says that the simulator itself is run at every node, without surfaces, and its runs
    are not kept.
    """

    least: int
    most: int
    direct: bool


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
    """The number of runs that `identify` will make; None with collocation.

    The numbers are those that studies took (docs/study.md); one whose outcome bends much within
    the law takes more.
    """
    if not isinstance(propagation, ResponseSurface):
        return None
    alone = not is_exact(table, inputs, noise)
    at = plan.x[0]
    if alone and not inputs.regressed:
        at = start_point(inputs).clip(*inputs.box.T)
    if alone and way_of(runner, propagation, at, plan.region).direct:
        each = runs_each(inputs)
        return Cost(each * runner.units, each * runner.units, True)
    if not alone and way_of_outcomes(runner, Model.of(inputs, propagation, density)).direct:
        low, high = grids_each(inputs, len(runner.cases))
        return Cost(low * len(runner.cases), high * len(runner.cases), True)
    moving = len(plan.moving)
    few = linear_runs(moving, propagation, plan.count)
    begun = few, first_runs(moving, propagation)
    given = verification.samples
    check = (0, verification.most if given is None else given)
    least, most = (
        plan.count * min(int(growth * first), propagation.max_runs) + runs * runner.units
        for growth, first, runs in zip(settings.growth, begun, check, strict=True)
    )
    return Cost(least, most, False)
