"""What an identification needs: experiments, laws, noise, a simulator, and settings.

`Choices` holds everything but the simulator, `Question` adds it. `way_of` decides whether the
likelihood is integrated over the simulator itself or over response surfaces of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import qmc

from aleator.core.types import Array, Flags, Indices
from aleator.errors import NOISE, InputsError, setting
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import (
    GaussHermite,
    IndividualLikelihood,
    Layout,
    LevelRule,
    Predictor,
)
from aleator.likelihood.level_sets import on_a_grid, searched, traceable
from aleator.likelihood.level_sets.curves import CURVES
from aleator.likelihood.level_sets.lines import CROSSINGS
from aleator.likelihood.model import Model
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Conditions, Experiments, covariates
from aleator.observations.noise import Noise
from aleator.observations.responses import Observations
from aleator.search import GradientMultistart, Search
from aleator.simulators import Runner, Runs
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import ResponseSurface
from aleator.surrogates.choice import by_process

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


Noises = Noise | Mapping[str, Noise]
"""The measurement noise: of the only response, or of each response by name."""
DEFAULT_PROPAGATION = ResponseSurface()
DEFAULT_SEARCH = GradientMultistart()

FIRST = (GaussHermite(1), GaussHermite(5), GaussHermite(3), GaussHermite(3))
"""The quadrature rule that a search begins with, for 0, 1, 2 and 3 scattering parameters."""
FEWEST = GaussHermite(3, 1)
"""The quadrature rule that a search begins with, for four or more scattering parameters."""


def is_exact(table: Experiments | Conditions, inputs: Inputs, noise: Noises | None) -> bool:
    """Whether the likelihood is the density of the outcomes, without measurement noise.

    This requires as many outcomes of each experiment as of any other, not more than parameters that
    scatter, and the same law for all experiments, without levels. If there are several outcomes of
    an experiment, none may be censored; of a single one the probability is computed. Otherwise the
    likelihood is an integral over each experiment's parameters. For conditions without outcomes
    it says whether they are predicted from the density of one outcome.
    """
    if noise is not None:
        return False
    if isinstance(table, Conditions):
        return table.simple and not inputs.levels and traceable(inputs)
    return _without_density(table, inputs) is None


@dataclass(frozen=True)
class NoiseSettings:
    """Settings of the noise with which the likelihood is computed."""

    least: float = 1e-7
    """Least sd as a share of the range of the measured values. The information about two parameters
    from one value has a ratio of eigenvalues of range^2/sd^2, which double precision holds up to
    1e16; with 1e-9 the matrix of the sum of two normal parameters was singular, with 1e-7 its
    log-likelihood was exact to 2e-9."""


NOISES = NoiseSettings()


@dataclass(frozen=True, eq=False)
class Choices:
    """A study without its simulator: table, laws, noise, and the settings of all computations."""

    table: Experiments
    inputs: Inputs
    noise: Noises | None
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION
    density: Density | None = None
    search: Search = DEFAULT_SEARCH
    restricted: bool = False
    small_sample: bool = False

    @classmethod
    def of(
        cls,
        table: Experiments,
        inputs: Inputs,
        noise: Noises | None,
        propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
        density: Density | None = None,
        search: Search = DEFAULT_SEARCH,
        *,
        restricted: bool = False,
        small_sample: bool = False,
    ) -> Choices:
        """Checked choices; laws that depend on covariates get the covariates of the table.

        Raises InputsError for combinations that have no likelihood: a density method, collocation
        or nodes of the law together with noise, several observations of an experiment without
        noise, the restricted likelihood without noise, and no scattering parameter. Raises it also
        for intervals for few experiments with the restricted likelihood, or with a prior.
        """
        made = cls(table, inputs, noise, propagation, density, search, restricted, small_sample)
        if restricted and noise is None:
            raise InputsError(
                "the restricted likelihood is known with measurement noise only",
                "add noise, or leave `restricted` out",
            )
        reason = None if noise is not None else _without_density(table, inputs)
        if reason is not None:
            raise InputsError(reason, f"add {NOISE}; it may be small")
        if noise is not None:
            _require_computable(table, inputs, noise)
        if not made.exact:
            _require_common_surfaces(inputs, surfaces_alone(propagation, density))
        elif not table.simple or len(inputs.classes) > 1:
            _require_processes(propagation, density)
        if inputs.individual_laws:
            made = replace(made, inputs=inputs.resolved(covariates(table, inputs.columns)))
        elif made.exact:
            Model.of(inputs, propagation, density)
        if small_sample:
            _require_likelihood_alone(made)
        return made

    @property
    def exact(self) -> bool:
        """Whether the likelihood is the density of outcomes without noise (see `is_exact`)."""
        return is_exact(self.table, self.inputs, self.noise)

    @cached_property
    def model(self) -> Model:
        """The model by which the density of an outcome without noise is computed."""
        return Model.of(self.inputs, self.propagation, self.density)

    @cached_property
    def errors(self) -> MeasurementErrors:
        """The measurement errors of the table's observations."""
        assert self.noise is not None
        return MeasurementErrors.of(self.noise, self.table)

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters of the laws, then those of the measurement errors."""
        if self.exact:
            return self.model.hyperparameters
        return (*self.inputs.hyperparameters, *self.errors.hyperparameters)

    @property
    def surfaces(self) -> ResponseSurface | None:
        """The settings of response surfaces; None with collocation."""
        own = isinstance(self.propagation, ResponseSurface)
        return self.propagation if own else None  # type: ignore[return-value]

    def require_enough(self) -> None:
        """Raise InputsError where there are fewer observations than hyperparameters to identify."""
        free, count = sum(h.free for h in self.hyperparameters), len(self.table.observations)
        if count < free:
            raise InputsError(
                f"{count} observations of {len(self.table.ids)} experiments cannot identify {free} "
                "hyperparameters",
                "fix some hyperparameters, or add experiments (ten for each is a start)",
            )

    def question(self, runner: Runner, seen: Observations, seed: int) -> Question:
        """The question with other observations at the places of the table; NaN ones are left out.

        `seen` has a value for each observation of the table.
        """
        kept = ~np.isnan(seen.lower)
        table = self.table.with_observations(seen.only(kept))
        return Question(replace(self, table=table), runner, seed, kept)


@dataclass(frozen=True, eq=False)
class Question:
    """A study with the runner of its simulator.

    `kept` marks which of the observations that the runner simulates the table contains. `earlier`
    are the stored runs with which processes may begin.
    """

    choices: Choices
    runner: Runner
    seed: int
    kept: Flags
    earlier: Runs | None = None

    def without(self, lost: Flags) -> Question:
        """The question without the observations marked in `lost` (M,), whose runs all fail."""
        kept = self.kept.copy()
        kept[kept] = ~lost
        table = self.choices.table.only(~lost)
        return replace(self, choices=replace(self.choices, table=table), kept=kept)

    @property
    def table(self) -> Experiments:
        """The table of experiments."""
        return self.choices.table

    @property
    def inputs(self) -> Inputs:
        """The laws of the parameters."""
        return self.choices.inputs

    @property
    def exact(self) -> bool:
        """Whether the likelihood is the density of outcomes without noise (see `is_exact`)."""
        return self.choices.exact

    @property
    def ids(self) -> Sequence[str]:
        """The names of the experiments."""
        return self.table.ids

    @property
    def unit(self) -> Indices:
        """The index (M,) of the simulation, with its conditions, that gives each observation."""
        return self.runner.unit[self.kept]

    @property
    def column(self) -> Indices:
        """The index (M,) of each observation among the output values of its simulator run."""
        return self.runner.column[self.kept]

    @cached_property
    def layout(self) -> Layout:
        """The layout of the data: the simulator run and the experiment of each observation."""
        experiment = self.table.observations.experiment
        shared = self.inputs.grouping
        return Layout(len(self.ids), experiment, self.unit, self.column, grouping=shared)

    @cached_property
    def measured(self) -> Array:
        """The observations (M,) as numbers; for a censored one its finite bound."""
        return self.table.observations.numbers

    @property
    def bounds(self) -> Array | None:
        """The lower and upper bounds (2, M) of the observations; None if none is censored."""
        return self.table.observations.bounds

    def integral(self, predictor: Predictor) -> IndividualLikelihood:
        """The likelihood, with individual parameters integrated out by few nodes."""
        choices, rule = self.choices, first_rule(self.inputs)
        return IndividualLikelihood.of(
            self.inputs, choices.errors, predictor, self.layout, rule,
            restricted=choices.restricted,
        )  # fmt: skip


def first_rule(inputs: Inputs) -> GaussHermite | LevelRule:
    """The quadrature rule that a search begins with."""
    grouping, variates = inputs.grouping, inputs.scattering
    if grouping is not None:
        variates = int(np.sum(grouping.of == len(grouping.names)))
    rule = FIRST[variates] if variates < len(FIRST) else FEWEST
    return rule if grouping is None else LevelRule.first(grouping, rule)


def start_point(inputs: Inputs) -> Array:
    """The mean (n,) of every law at the start of the search.

    >>> from aleator.laws import Constant, Free, Normal
    >>> start_point(Inputs({"v": Normal(Free(0.0, 4.0), 1.0), "b": Constant(3.0)})).tolist()
    [2.0, 3.0]
    """
    starts = [np.array([h.start for h in law.hyperparameters]) for law in inputs.laws.values()]
    laws = zip(inputs.laws.values(), starts, strict=True)
    return np.array([law.mean_and_sd(values).mean for law, values in laws])


def varying_conditions(table: Experiments, requested: Sequence[str]) -> list[str]:
    """The names of the conditions, among those requested, that vary within an experiment."""
    first = np.unique(table.experiment, return_index=True)[1]
    return [
        name
        for name in requested
        if np.any((cells := table.conditions[name].to_numpy()) != cells[first][table.experiment])
    ]


def _require_computable(
    table: Experiments, inputs: Inputs, noise: Noises, settings: NoiseSettings = NOISES
) -> None:
    """Raise InputsError for a known sd that is tiny against the range of the measured values.

    That is so if an experiment has fewer values than parameters that scatter.
    """
    seen = table.observations
    if np.bincount(seen.experiment).min() >= inputs.scattering:
        return
    for k, response in enumerate(seen.responses):
        one = noise if isinstance(noise, Noise) else noise.get(response.name)
        if one is None or one.relative or not isinstance(one.sd, float | int):
            continue
        values = seen.lower[(seen.response == k) & np.isfinite(seen.lower)]
        least = settings.least * float(np.ptp(values)) if values.size else 0.0
        if 0.0 < one.sd < least:
            raise InputsError(
                f"noise: sd = {one.sd:g} is less than {settings.least:g} of the range of "
                f"{response.name}: the likelihood cannot be computed in double precision",
                f"take {least:.1g} or more: the law is hardly changed by an sd far below the "
                "scatter, such as that of rounding (the last digit / sqrt(12))",
            )


def _without_density(table: Experiments, inputs: Inputs) -> str | None:
    """Why the outcomes of the experiments have no density without noise; None if they have one."""
    each, scattering = table.exact_each, inputs.scattering
    if inputs.levels:
        return (
            "parameters of levels need measurement noise: the experiments of a group share a draw, "
            "so that their outcomes have no density by themselves"
        )
    if inputs.regressed:
        return "a law that follows covariates needs measurement noise"
    if scattering and not traceable(inputs):
        return (
            "a mixture with a component that is a constant needs measurement noise: without it the "
            "outcomes of a constant have no density"
        )
    counts = np.bincount(table.observations.experiment, minlength=len(table.ids))
    if np.any(table.observations.censored) and counts.max() > 1:
        return (
            "censored observations need measurement noise where experiments have several "
            "observations: without it their likelihood is known for one observation an experiment"
        )
    if each is None:
        return (
            "experiments with different numbers of observations need measurement noise: without it "
            "each experiment has as many outcomes as any other"
        )
    if scattering and each > scattering:
        return (
            f"{each} observations an experiment and {scattering} parameters that scatter need "
            "measurement noise: without it no parameters explain all observations exactly"
        )
    if each > 1 and scattering > CURVES.most:
        return (
            f"{each} observations an experiment and {scattering} parameters that scatter need "
            f"measurement noise: without it at most {CURVES.most} parameters may scatter"
        )
    return None


def _require_likelihood_alone(choices: Choices) -> None:
    """Raise InputsError where intervals for few experiments are asked of more than a likelihood."""
    if choices.restricted:
        raise InputsError(
            "`small_sample` adjusts the intervals of the likelihood, and `restricted` maximizes "
            "another one",
            "keep one of the two",
        )
    believed = [h.name for h in choices.hyperparameters if h.prior is not None]
    if believed:
        raise InputsError(
            f"`small_sample` is for intervals without priors, and {', '.join(believed)} has one",
            "leave the prior out, or `small_sample`",
        )


def _require_processes(propagation: ResponseSurface | Collocation, density: Density | None) -> None:
    """Raise InputsError for settings that neither several exact outcomes nor mixtures have.

    They are a density method, collocation, nodes of the law, and surfaces of each outcome's own.
    """
    choice = surfaces_alone(propagation, density)
    if choice.surfaces == "own" or choice.tolerance is not None:
        raise _of_exact_outcomes(
            "surfaces of each outcome's own (or a tolerance)",
            setting("[propagation] surfaces and tolerance", "ResponseSurface(surfaces, tolerance)"),
        )


def _require_common_surfaces(inputs: Inputs, surfaces: ResponseSurface) -> None:
    """Raise InputsError for polynomial surfaces of single experiments where some share parameters.

    The check of these surfaces on the simulator takes experiments as independent.
    """
    if inputs.levels and surfaces.surfaces != "none" and not by_process(surfaces, moments=False):
        raise InputsError(
            "surfaces of each experiment's own, or with a tolerance, are for independent "
            f"experiments, and some parameters belong to a level: {', '.join(inputs.levels)}",
            'leave `surfaces` and `tolerance` out, or take surfaces "process"',
        )


def surfaces_alone(
    propagation: ResponseSurface | Collocation, density: Density | None
) -> ResponseSurface:
    """The settings of response surfaces, for a likelihood that is not one of moments.

    Raises InputsError for settings that only a likelihood of moments has: a density method,
    collocation, and nodes of the law.
    """
    if density is not None:
        raise _of_exact_outcomes(f"the density ({density.name})", setting("[density]", "density="))
    if not isinstance(propagation, ResponseSurface):
        raise _of_exact_outcomes(
            "collocation",
            setting('[propagation] method = "collocation"', "propagation=Collocation(...)"),
        )
    if propagation.nodes is not None:
        raise _of_exact_outcomes(
            "`nodes` of the law", setting("[propagation] nodes", "ResponseSurface(nodes=...)")
        )
    return propagation


def _of_exact_outcomes(what: str, key: str) -> InputsError:
    return InputsError(
        f"{what} is for one exact outcome an experiment, without measurement noise, without "
        "censored values and without mixtures",
        f"leave {key} out: no other likelihood needs it",
    )


@dataclass(frozen=True)
class WaySettings:
    """Settings for counting runs without response surfaces, and for finding failing runs."""

    evaluations: tuple[int, int] = (500, 100_000)
    """The least and largest number of evaluations of the likelihood in an identification with
    noise, if each had `nodes`: 684 for five springs (`pytest tests/tasks/test_first_look.py`),
    1,160 in two of `benchmarks.random_studies` without the tests of consistency, 2,500 to 81,400
    with them in four studies of a valve. Most are made by these tests,
    by the best of all laws, and where two maxima or undetermined laws need fine nodes."""
    nodes: int = 9
    """The number of quadrature nodes for each of up to three parameters in this count."""
    line: int = 33
    """Points on each line through the region on which isolated failing runs are searched for."""
    tried: int = 128
    """Points of the region at which all runs must fail before an observation is left out."""
    grids: tuple[int, int] = (25, 5000)
    """The least and largest number of grids for level sets: 27 to 94 in five of
    `benchmarks.random_studies`, up to 5,000 in the studies of `make judges`."""


WAYS = WaySettings()


@dataclass(frozen=True)
class Way:
    """Whether the likelihood uses the simulator itself (`direct`) or response surfaces, and why.

    `reason` is shown in the report.
    """

    direct: bool
    reason: str


def way_of(runner: Runner, choice: ResponseSurface, x: Array, region: Array) -> Way:
    """Whether to use the simulator itself, if it takes arrays, or else response surfaces.

    The user's setting `surfaces` comes first. Surfaces are used where a tolerance or a budget of
    runs is set, and where single runs fail between others that succeed. A function of which
    `vectorized` is not stated is tried with arrays (see `Runner.takes_arrays`), unless there is a
    budget. `x` (n,) is a point of the `region` (n, 2) in which the laws may lie. No time is
    measured, so that the decision is the same on every machine. Cost: 33 runs for each simulated
    unit and parameter, if the simulator takes arrays.
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
    if not runner.vectorized and runner.account.budget.hours is not None:
        return Way(False, "runs have a budget, and the simulator is not stated to take arrays")
    if not runner.takes_arrays(region):
        return Way(False, "the simulator makes one run at a time")
    if fails_here_and_there(runner, x, region):
        return Way(False, "the simulator takes arrays, but runs fail here and there")
    if not runner.vectorized:
        return Way(True, "called with arrays, the function gives the same values")
    return Way(True, "the simulator takes arrays")


def way_of_outcomes(runner: Runner, model: Model) -> Way:
    """Whether to use the simulator itself or response surfaces, without measurement noise.

    The simulator itself is possible only where the likelihood is computed by level sets, the
    parameters that give just the measured outcome. Raises InputsError if the user requests it for
    another method. With collocation there is no choice, and the reason is empty.
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
            "leave out surfaces, or take collocation: "
            + setting('[propagation] method = "collocation"', "propagation=Collocation(...)"),
        )
    return Way(False, "")


def grids_each(inputs: Inputs, conditions: int, outcomes: int = 1) -> tuple[int, int]:
    """The least and largest number of runs of each condition, for level sets of the simulator."""
    few, s = searched(inputs, conditions, outcomes), inputs.scattering
    if outcomes > 1:
        points = outcomes * CURVES.points(s, few)
    else:
        points = few**s if on_a_grid(inputs) else few * (CROSSINGS.steps + 2 * s)
    return WAYS.grids[0] * points, WAYS.grids[1] * points


def runs_each(inputs: Inputs) -> tuple[int, int]:
    """The least and largest number of runs of each simulated unit without response surfaces."""
    moving = int(moving_parameters(inputs.box).size)
    once = int(WAYS.nodes ** min(inputs.scattering, 3)) * (2 * moving + 1)
    return WAYS.evaluations[0] * once, WAYS.evaluations[1] * once


def fails_here_and_there(runner: Runner, x: Array, region: Array) -> bool:
    """Whether single runs of a simulator fail between others that succeed.

    Runs are made on lines through x (n,) along each side of a region (n, 2). An integral over such
    a simulator depends on which nodes happen to fail. A response surface interpolates the failures.
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
    """Which observations (M,) have no simulated value at any of 128 points of a region (n, 2).

    No observation is marked if this is true of all, because the simulator may then succeed in a
    small part of the region only.
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
