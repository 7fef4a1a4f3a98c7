"""The forward and the inverse problem: a simulator, the user's choices, and experiments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from aleator.likelihood.level_sets import LevelLikelihood, searched, traceable
from aleator.likelihood.likelihood import Continued, Likelihood
from aleator.likelihood.model import Model
from aleator.likelihood.nodes import propagated
from aleator.likelihood.predictive import Predictive, predictive
from aleator.progress import Progress
from aleator.simulators import NoOutcome, Runner
from aleator.surrogates import Surface, build_surface
from aleator.surrogates.responses import (
    Confined,
    DirectResponse,
    Divisible,
    Response,
    attempts,
    by_calls,
    moving_parameters,
    straight,
)
from aleator.types import Array, Flags, Indices


@dataclass(frozen=True)
class Forward:
    """The forward problem: from the law to the distribution of N outcomes.

    `condition` (N,) says which of the U distinct conditions each experiment has. `region` (n, 2) is
    where the response is known: the box, or the part of it where the law has its mass. `surface`
    are the response surfaces of the parameters that are not known, or None for collocation.
    """

    model: Model
    predictive: Predictive
    response: Response
    surface: Surface | None
    region: Array
    condition: Indices

    @property
    def moving(self) -> Indices:
        """The parameters that are not known, in the order of the surfaces' columns."""
        return moving_parameters(self.region)

    @property
    def name(self) -> str:
        """How reports name the propagation."""
        return self.model.propagation.name

    def given(self, outcomes: Array) -> Problem:
        """The inverse problem that measured outcomes (N,) make of it."""
        own = (self.model, self.predictive, self.response, self.surface, self.region)
        none = np.zeros(len(outcomes), dtype=np.bool_)
        return Problem(*own, self.condition, outcomes, unreached=none)

    def by(self, model: Model) -> Forward:
        """The same response under other choices of density."""
        way = propagated(model, self.response, self.region)
        return replace(self, model=model, predictive=self.predictive.by(model.density, way))


@dataclass(frozen=True)
class Problem(Forward):
    """The inverse problem: the forward problem and the measured outcomes (N,).

    With `levels` the likelihood is that of the level sets, and the densities serve for what is
    asked of outcomes that were not measured. There are none where outcomes are `unreached` (N,).
    """

    outcomes: Array
    levels: LevelLikelihood | None = None
    unreached: Flags = field(kw_only=True)

    @property
    def by_densities(self) -> Likelihood:
        """The honest likelihood by the densities."""
        return Likelihood(self.predictive, self.outcomes)

    @property
    def exactly(self) -> LevelLikelihood | None:
        """The likelihood by level sets; None with collocation, where they would take more runs."""
        if self.levels is not None:
            return self.levels
        known = self.surface is not None and traceable(self.model.inputs)
        return _levels(self).fine() if known else None

    @property
    def likelihood(self) -> Likelihood | LevelLikelihood:
        """The honest likelihood: by the densities, or by level sets of the simulator itself."""
        return self.levels or self.by_densities

    @property
    def objective(self) -> Continued | LevelLikelihood:
        """What a search climbs: the likelihood, continued where there is none."""
        return self.likelihood.continued

    def given(self, outcomes: Array) -> Problem:
        """The same with other outcomes (N,)."""
        levels = self.levels and self.levels.given(outcomes)
        return replace(self, outcomes=outcomes, levels=levels)


def forward(
    runner: Runner,
    model: Model,
    region: Array,
    progress: Progress | None = None,
    surface: Surface | None = None,
) -> Forward:
    """Build the predictive distribution; response surfaces on the region (n, 2) first.

    `surface` are surfaces built before, in the parameters that vary over the region; None builds
    them.

    Experiments under equal conditions are one to the simulator: U surfaces for N experiments.
    Surfaces go through the runs that worked; collocation needs every run. Raises NoOutcome that
    names the experiments in which hardly a run worked, and where too many runs failed altogether.
    """
    first, condition = runner.cases.first, runner.cases.condition
    count, inputs = first.size, model.inputs
    response: Response
    if model.surfaces is not None:
        if surface is None:
            surface = build_surface(
                attempts(runner, region), region[moving_parameters(region)], count, model.surfaces,
                told(progress),
            )  # fmt: skip
        _require_surfaces(surface, runner, condition)
        # the surface's own error must not shut an outcome out of the reachable range
        margin = 3.0 * surface.error
        lower, upper = surface.lower - margin, surface.upper + margin
        response = Confined(surface, region)
    else:
        assert model.collocation is not None
        step = model.collocation.difference_step
        run = straight(runner) if model.collocation.fast else by_calls(runner)
        response = DirectResponse(run, count, inputs.box, step)
        lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
    distribution = predictive(
        propagated(model, response, region), model.density, condition, lower[condition],
        upper[condition], model.hyperparameters,
    )  # fmt: skip
    return Forward(model, distribution, response, surface, region, condition)


def prepare(
    runner: Runner,
    outcomes: Array,
    model: Model,
    region: Array,
    progress: Progress | None = None,
    surface: Surface | None = None,
) -> Problem:
    """The inverse problem of outcomes (N,), as `forward` builds it."""
    problem = forward(runner, model, region, progress, surface).given(outcomes)
    if not model.traced:
        return problem
    levels = _levels(problem)
    if levels.unreached.any():
        return replace(problem, unreached=levels.unreached)
    return replace(problem, levels=levels)


def _levels(problem: Problem) -> LevelLikelihood:
    """Level sets for a search."""
    inputs, response = problem.model.inputs, problem.response
    assert isinstance(response, Divisible)
    region = inputs.box if problem.surface is None else problem.region
    few = searched(inputs, int(problem.condition.max()) + 1)
    return LevelLikelihood(inputs, response, region, problem.condition, problem.outcomes, few)


def _require_surfaces(surface: Surface, runner: Runner, condition: Indices) -> None:
    """Raise NoOutcome for experiments with so few runs that worked that they have no surface."""
    lost = np.flatnonzero(np.isinf(surface.error)[condition])
    if not lost.size:
        return
    failures = runner.failures
    failed = failures.case == condition[lost[0]]
    raise NoOutcome(
        f"experiment '{runner.ids[lost[0]]}': {surface.failed[condition[lost[0]]]} of its "
        f"{surface.runs[condition[lost[0]]]} runs failed, too many for a response surface"
        + (f"; so it is with {lost.size - 1} more of {len(runner.ids)}" if lost.size > 1 else ""),
        "see why they failed, check the conditions of the experiment, or narrow the box or the "
        f"bounds of {' or '.join(runner.parameters)}; or leave the experiment out",
        failures.x[failed],
        runner.cases.first[failures.case[failed]],
    )


def told(progress: Progress | None) -> Callable[[int, int, int], None] | None:
    """A listener to surfaces that become exact."""
    if progress is None:
        return None
    listener = progress

    def tell(runs: int, converged: int, total: int) -> None:
        text = f"{runs} runs, {converged} of {total} surfaces converged"
        listener.update(text, converged, total)

    return tell
