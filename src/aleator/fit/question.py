"""What is to be answered: experiments, laws, noise and a simulator, and the choices by which to.

`Choices` is a study without its runs, `Question` one with them. `way_of` says whether the
likelihood is integrated over the simulator itself or over surfaces of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import qmc

from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import (
    GaussHermite,
    IndividualLikelihood,
    Layout,
    Predictor,
)
from aleator.likelihood.level_sets import on_a_grid, searched
from aleator.likelihood.level_sets.lines import CROSSINGS
from aleator.likelihood.model import Model
from aleator.observations.errors import MeasurementErrors, Noise
from aleator.observations.experiments import Conditions, Experiments, covariates
from aleator.observations.responses import Observations
from aleator.search import GradientMultistart, Search
from aleator.simulators import Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import ResponseSurface

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


Noises = Noise | Mapping[str, Noise]
"""The noise of the only response, or of each by name."""
DEFAULT_PROPAGATION = ResponseSurface()
DEFAULT_SEARCH = GradientMultistart()

FIRST = (GaussHermite(1), GaussHermite(5), GaussHermite(3), GaussHermite(3))
"""The nodes that a search begins with, by the number of variates."""
FEWEST = GaussHermite(3, 1)
"""... for more variates than that."""


def is_exact(table: Experiments | Conditions, inputs: Inputs, noise: Noises | None) -> bool:
    """Whether outcomes have a density of their own, without an integral over parameters.

    It is so for one exact outcome an experiment, under one law for all experiments that is no
    mixture. Everything else is integrated over the parameters of each experiment.
    """
    return noise is None and table.simple and not inputs.regressed and len(inputs.classes) == 1


@dataclass(frozen=True, eq=False)
class Choices:
    """A study without its runs: the table, the laws, the noise, and how to compute and search."""

    table: Experiments
    inputs: Inputs
    noise: Noises | None
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION
    density: Density | None = None
    search: Search = DEFAULT_SEARCH

    @classmethod
    def of(
        cls,
        table: Experiments,
        inputs: Inputs,
        noise: Noises | None,
        propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
        density: Density | None = None,
        search: Search = DEFAULT_SEARCH,
    ) -> Choices:
        """Checked choices, in which laws that follow covariates are resolved by the table.

        Raises InputsError for what does not go together: a density, collocation or nodes of the
        law with noise, several observations without it, and nothing that scatters.
        """
        made = cls(table, inputs, noise, propagation, density, search)
        if not is_exact(table, inputs, noise):
            surfaces_alone(propagation, density)
            _require_noise(table, inputs, noise)
        if inputs.regressed:
            return replace(made, inputs=inputs.resolved(covariates(table, inputs.covariates)))
        if made.exact:
            Model.of(inputs, propagation, density)
        return made

    @property
    def exact(self) -> bool:
        """Whether the outcomes have a density of their own (see `is_exact`)."""
        return is_exact(self.table, self.inputs, self.noise)

    @cached_property
    def model(self) -> Model:
        """How the density of an exact outcome is computed."""
        return Model.of(self.inputs, self.propagation, self.density)

    @cached_property
    def errors(self) -> MeasurementErrors:
        """The measurement errors of the table's observations."""
        assert self.noise is not None
        return MeasurementErrors.of(self.noise, self.table)

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters of the laws, then those of the errors."""
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
        """The question for these observations at the places of the table; NaN is no observation."""
        kept = ~np.isnan(seen.lower)
        table = self.table.with_observations(seen.only(kept))
        return Question(replace(self, table=table), runner, seed, kept)


@dataclass(frozen=True, eq=False)
class Question:
    """The choices of a study, and what makes its runs.

    Of the observations that the runner gives values of the table has those that are `kept`.
    """

    choices: Choices
    runner: Runner
    seed: int
    kept: Flags

    def without(self, lost: Flags) -> Question:
        """The question without some of the observations (M,), of which no run gives a value."""
        kept = self.kept.copy()
        kept[kept] = ~lost
        table = self.choices.table.only(~lost)
        return replace(self, choices=replace(self.choices, table=table), kept=kept)

    @property
    def table(self) -> Experiments:
        """The experiments."""
        return self.choices.table

    @property
    def inputs(self) -> Inputs:
        """The laws of the parameters."""
        return self.choices.inputs

    @property
    def exact(self) -> bool:
        """Whether the outcomes have a density of their own (see `is_exact`)."""
        return self.choices.exact

    @property
    def ids(self) -> Sequence[str]:
        """The names of the experiments."""
        return self.table.ids

    @property
    def unit(self) -> Indices:
        """The unit (M,) whose run gives each observation."""
        return self.runner.unit[self.kept]

    @property
    def column(self) -> Indices:
        """The place (M,) of each observation among the values of its run."""
        return self.runner.column[self.kept]

    @cached_property
    def layout(self) -> Layout:
        """The run that gives each observation, and its experiment."""
        experiment = self.table.observations.experiment
        return Layout(len(self.ids), experiment, self.unit, self.column)

    @cached_property
    def measured(self) -> Array:
        """The observations (M,) as numbers; of a censored one the bound."""
        seen = self.table.observations
        return np.where(np.isfinite(seen.lower), seen.lower, seen.upper)

    def integral(self, predictor: Predictor) -> IndividualLikelihood:
        """The integral over individual parameters, with few nodes, for a search."""
        variates = self.inputs.scattering
        rule = FIRST[variates] if variates < len(FIRST) else FEWEST
        errors = self.choices.errors
        return IndividualLikelihood.of(self.inputs, errors, predictor, self.layout, rule)


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
    """Those of the simulator's conditions that vary within an experiment."""
    first = np.unique(table.experiment, return_index=True)[1]
    return [
        name
        for name in requested
        if np.any((cells := table.conditions[name].to_numpy()) != cells[first][table.experiment])
    ]


def _require_noise(table: Experiments, inputs: Inputs, noise: Noises | None) -> None:
    if noise is not None:
        return
    if table.simple and not inputs.regressed:
        raise InputsError(
            "the likelihood of a mixture is known with measurement noise only",
            "add noise: [noise] sd, or noise=Noise(...), which may be small",
        )
    raise InputsError(
        "several observations an experiment, censored ones and covariates need measurement "
        "noise: without it no parameters explain all observations exactly",
        "add noise: [noise] sd, or noise=Noise(...)",
    )


def surfaces_alone(
    propagation: ResponseSurface | Collocation, density: Density | None
) -> ResponseSurface:
    """The settings of surfaces, for a likelihood over individual parameters.

    Raises InputsError for what only the density of an exact outcome has: the density itself,
    collocation, a surface of all experiments, and nodes of the law.
    """
    if density is not None:
        raise _of_exact_outcomes(f"the density ({density.name})", "[density]")
    if not isinstance(propagation, ResponseSurface):
        raise _of_exact_outcomes('method = "collocation"', "[propagation] method")
    if propagation.surfaces == "shared":
        raise _of_exact_outcomes('surfaces = "shared"', "[propagation] surfaces")
    if propagation.nodes is not None:
        raise _of_exact_outcomes("`nodes` of the law", "[propagation] nodes")
    return propagation


def _of_exact_outcomes(what: str, key: str) -> InputsError:
    return InputsError(
        f"{what} is for one exact outcome an experiment, without measurement noise",
        f"leave {key} out: with noise the likelihood is an integral over each experiment's own "
        "parameters",
    )


@dataclass(frozen=True)
class WaySettings:
    """How runs without surfaces are counted beforehand, and where failures are looked for."""

    evaluations: int = 400
    """Evaluations of the likelihood that an identification takes, about."""
    nodes: int = 9
    """Nodes a variate that an identification comes to, about; of more than three variates fewer."""
    line: int = 33
    """Points of a line on which failures are looked for that lie alone."""
    tried: int = 128
    """Points at which a run must give no value of an observation for that to be lost."""
    grids: tuple[int, int] = (100, 5000)
    """Grids of level sets in an identification, fewest and most of the studies of `make judges`."""


WAYS = WaySettings()


@dataclass(frozen=True)
class Way:
    """Whether the simulator itself is integrated over, or else surfaces; the `reason` in words."""

    direct: bool
    reason: str


def way_of(runner: Runner, choice: ResponseSurface, x: Array, region: Array) -> Way:
    """The simulator itself where it is vectorized, else surfaces.

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
    """The same choice for exact outcomes, one an experiment; without choice no reason.

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
    """The least and most runs of each condition for level sets of the simulator itself."""
    few, s = searched(inputs, conditions), inputs.scattering
    points = few**s if on_a_grid(inputs) else few * (CROSSINGS.steps + 2 * s)
    return WAYS.grids[0] * points, WAYS.grids[1] * points


def runs_each(inputs: Inputs) -> int:
    """About how many runs of each unit an identification without surfaces takes."""
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
