"""The forward problem (the distribution of outcomes) and the inverse problem (their likelihood)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from aleator.core.progress import Progress
from aleator.core.types import Array, Flags, Indices
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.level_sets import LevelLikelihood, searched, traceable
from aleator.likelihood.level_sets.predicted import PointPredictor as PointPredictor
from aleator.likelihood.model import Model
from aleator.search import Objective
from aleator.search.interface import LogLikelihood
from aleator.simulators import NoOutcome, Runner
from aleator.simulators.response_functions import (
    Confined,
    DirectResponse,
    Divisible,
    OutcomeDistribution,
    ResponseFunction,
    by_calls,
    moving_parameters,
    straight,
)
from aleator.surrogates import ResponseSurface, Surface, build_surface
from aleator.surrogates.samples import Sites

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.likelihood import Likelihood, Predictive


class OutcomePredictor(Protocol):
    """The interface that gives the distributions of N outcomes under a law alpha (K,)."""

    @property
    def lower(self) -> Array:
        """The smallest possible outcome (N,) of each experiment, or minus infinity."""

    @property
    def upper(self) -> Array:
        """The largest possible outcome (N,) of each experiment, or infinity."""

    def under(self, alpha: Array) -> OutcomeDistribution:
        """The distributions of the N outcomes under the law alpha (K,)."""


@dataclass(frozen=True)
class Forward:
    """The forward problem: from the law to the distribution of outcomes.

    Each of the experiments has `each` outcomes; there are M altogether, experiment by experiment.
    `condition` (M,) is the number of each outcome among the U distinct simulated values.
    `region` (n, 2) is the region of parameters in which the response is known: their full ranges,
    or the part where the law has its probability. `surface` has the response surfaces as functions
    of the parameters that are not fixed, or is None.
    """

    model: Model
    predictor: OutcomePredictor
    response: ResponseFunction
    surface: Surface | None
    region: Array
    condition: Indices
    each: int

    @property
    def moving(self) -> Indices:
        """The indices of the parameters that are not fixed, in the order of the surfaces."""
        return moving_parameters(self.region)

    @property
    def name(self) -> str:
        """The name of the propagation method in reports."""
        return self.model.name

    def with_outcomes(self, outcomes: Array, bounds: Array | None = None) -> Problem:
        """The inverse problem for measured outcomes (M,), some of which may be censored.

        `bounds` (2, M) are then the bounds of all outcomes; see `LevelLikelihood`.
        """
        own = (self.model, self.predictor, self.response, self.surface, self.region)
        made = _likelihood(self, outcomes, bounds)
        return Problem(*own, self.condition, self.each, outcomes, bounds, made)


@dataclass(frozen=True)
class Problem(Forward):
    """The inverse problem: the forward problem and the measured outcomes (M,).

    With censored outcomes, `bounds` (2, M) are the lower and upper bounds of all, equal where an
    outcome is exact, and `outcomes` has a finite bound of each censored one. The `likelihood` is
    computed by level sets, or by a density fitted to moments if one was chosen.
    """

    outcomes: Array
    bounds: Array | None
    likelihood: Likelihood | LevelLikelihood

    @property
    def ends(self) -> Array:
        """The lower and upper bounds (2, M) of the outcomes, which are equal for exact ones."""
        return np.stack([self.outcomes] * 2) if self.bounds is None else self.bounds

    @property
    def inputs(self) -> Inputs:
        """The laws of the parameters."""
        return self.model.inputs

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha."""
        return self.model.hyperparameters

    @property
    def count(self) -> int:
        """The number N of experiments."""
        return self.outcomes.size // self.each

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood and scores (N, K) at alpha (K,).

        Both are finite even where the density of an outcome is zero.
        """
        return self.continued(alpha)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood and scores at alpha (K,): the named form of calling this object."""
        return self.continued(alpha)

    def adapted(self, alpha: Array) -> Problem:  # noqa: ARG002  one interface
        """This problem itself, because it has no nodes that depend on alpha."""
        return self

    def at_point(self, x: Array) -> tuple[Array, Array]:
        """Simulated outcomes (M,) at one point x (n,), with slopes (M, n)."""
        value, slope = self.response.evaluate_with_gradient(x[None, :])
        return value[self.condition, 0], slope[self.condition, 0]

    def sampled(self, size: int) -> Likelihood | LevelLikelihood:
        """The likelihood of `size` of the experiments, spread evenly over all."""
        return self.likelihood.take(np.linspace(0, self.count - 1, size).astype(np.intp))

    def fine(self) -> Problem:
        """This problem with level sets as fine as reported results need."""
        return self if self.levels is None else replace(self, likelihood=self.levels.fine())

    @property
    def levels(self) -> LevelLikelihood | None:
        """The likelihood by level sets, or None where a density fitted to moments was chosen."""
        return self.likelihood if isinstance(self.likelihood, LevelLikelihood) else None

    def coarse(self) -> Problem:
        """This problem on the coarsest acceptable grids, for the analysis of many data sets."""
        if self.levels is None:
            return self
        assert isinstance(self.predictor, PointPredictor)
        return replace(self, predictor=self.predictor.coarse(), likelihood=self.levels.coarsest())

    @property
    def free(self) -> bool:
        """Whether there are surfaces or level sets, so that no collocation runs are needed."""
        return self.surface is not None or self.levels is not None

    @property
    def unreached(self) -> Flags:
        """Flags (N,) of the experiments whose outcomes the response does not reach in the region.

        None is flagged where the likelihood is computed from moments.
        """
        return self._none if self.levels is None else self.levels.unreached

    def unreached_at(self, alpha: Array) -> Flags:
        """Flags (N,) of the experiments without a level set under the law alpha (K,)."""
        return self._none if self.levels is None else self.levels.sets(alpha).empty

    @property
    def _none(self) -> Flags:
        return np.zeros(self.count, dtype=np.bool_)

    def nodes(self, alpha: Array) -> Array:
        """The collocation nodes x (J, n) of the law alpha (K,)."""
        from aleator.moments.likelihood import Predictive

        assert isinstance(self.predictor, Predictive)
        return self.predictor.nodes(alpha)

    def gap(self, alpha: Array) -> float:
        """The change of a log-likelihood by moments with more nodes of the law; 0 by level sets."""
        if self.surface is None or isinstance(self.likelihood, LevelLikelihood):
            return 0.0
        return self.likelihood.gap(alpha)

    @property
    def exactly(self) -> LevelLikelihood | None:
        """The likelihood by level sets; None where it would need runs besides collocation."""
        if self.levels is not None:
            return self.levels
        known = self.surface is not None and traceable(self.model.inputs)
        return level_sets(self, self.outcomes, self.bounds).fine() if known else None

    @property
    def continued(self) -> Objective:
        """The objective of a search: the likelihood, extended to where no density exists."""
        return self.likelihood.continued

    @property
    def followed(self) -> Objective:
        """The objective for derivatives by alpha, which is that of the search."""
        return self.continued

    def with_outcomes(self, outcomes: Array, bounds: Array | None = None) -> Problem:
        """This problem with other outcomes (M,) and bounds (2, M)."""
        levels = self.levels
        made = (
            self.likelihood.with_outcomes(outcomes)
            if levels is None
            else levels.with_outcomes(outcomes, bounds)
        )
        return replace(self, outcomes=outcomes, bounds=bounds, likelihood=made)


def forward(
    runner: Runner,
    model: Model,
    region: Array,
    progress: Progress | None = None,
    surface: Surface | None = None,
) -> Forward:
    """Build the forward problem; first the response surfaces on the region (n, 2), if needed.

    `surface` has surfaces built before, as functions of the parameters that vary over the region;
    with None they are built here. Outcomes under equal conditions share their runs and surfaces,
    so that M outcomes have U surfaces. Surfaces use the runs that worked, while collocation
    needs every run. Raises NoOutcome where too few runs of an experiment worked, which it names,
    and where too many runs failed altogether.
    """
    sites = Sites.seen(runner, runner.unit, runner.column)
    condition, count, inputs = sites.of, len(sites), model.inputs
    each = condition.size // len(runner.ids)
    response: ResponseFunction
    lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
    if model.surfaces is not None:
        if surface is None:
            surface = build_surface(
                sites.attempts(runner, region), region[moving_parameters(region)], count,
                model.surfaces, surface_progress(progress),
            )  # fmt: skip
        _require_surfaces(surface, runner, condition)
        # The margin keeps the error of a surface from excluding an outcome that is possible.
        margin = 3.0 * surface.error
        lower, upper = surface.lower - margin, surface.upper + margin
        response = Confined(surface, region)
    elif isinstance(model.propagation, ResponseSurface):
        # A life without end may agree with a bound; several outcomes are never censored.
        run = straight(runner, sites.unit, sites.column, infinite=each == 1)
        response = DirectResponse(run, count, inputs.box)
    else:
        step = model.propagation.difference_step
        response = DirectResponse(by_calls(runner), count, inputs.box, step)
    ends = lower[condition], upper[condition]
    if model.density is None:
        predictor: OutcomePredictor = PointPredictor(inputs, response, condition, *ends)
    else:
        predictor = _by_moments(model, model.density, response, condition, ends, region)
    return Forward(model, predictor, response, surface, region, condition, each)


def prepare(
    runner: Runner,
    outcomes: Array,
    model: Model,
    region: Array,
    progress: Progress | None = None,
    surface: Surface | None = None,
    bounds: Array | None = None,
) -> Problem:
    """The inverse problem for outcomes (M,), with the forward problem built by `forward`.

    `bounds` (2, M) are the bounds of the outcomes if some are censored.
    """
    return forward(runner, model, region, progress, surface).with_outcomes(outcomes, bounds)


def level_sets(problem: Forward, outcomes: Array, bounds: Array | None = None) -> LevelLikelihood:
    """The likelihood of outcomes (M,) by level sets that are as fine as a search needs."""
    inputs, response, condition = problem.model.inputs, problem.response, problem.condition
    assert isinstance(response, Divisible)
    region = inputs.box if problem.surface is None else problem.region
    few = searched(inputs, int(condition.max()) + 1, problem.each)
    if problem.each > 1:
        condition = condition.reshape(-1, problem.each)
        outcomes = outcomes.reshape(-1, problem.each)
    return LevelLikelihood(
        inputs, response, region, condition, outcomes, few, bounds=bounds
    )  # fmt: skip


def _by_moments(
    model: Model,
    density: Density,
    response: ResponseFunction,
    condition: Indices,
    ends: tuple[Array, Array],
    region: Array,
) -> Predictive:
    """The paper's method: moments of the outcome, and a density that is fitted to them."""
    from aleator.moments.likelihood import Predictive
    from aleator.moments.propagation import collocated, on_surfaces

    order, inputs, choice = max(density.order, 4), model.inputs, model.propagation
    way = (
        on_surfaces(inputs, choice.nodes, order, response, region)
        if isinstance(choice, ResponseSurface)
        else collocated(inputs, choice, order, response)
    )
    return Predictive(way, density, condition, *ends, model.hyperparameters)


def _likelihood(
    forward: Forward, outcomes: Array, bounds: Array | None
) -> Likelihood | LevelLikelihood:
    """The likelihood by level sets, or by a density fitted to moments if one was chosen."""
    if forward.model.density is None:
        return level_sets(forward, outcomes, bounds)
    from aleator.moments.likelihood import Likelihood, Predictive

    assert isinstance(forward.predictor, Predictive)
    return Likelihood(forward.predictor, outcomes)


def _require_surfaces(surface: Surface, runner: Runner, condition: Indices) -> None:
    """Raise NoOutcome where an experiment has no surface because too few of its runs worked."""
    lost = np.flatnonzero(np.isinf(surface.error)[condition])
    if not lost.size:
        return
    failures, unit = runner.failures, runner.unit[lost[0]]
    failed = failures.case == runner.cases.condition[unit]
    name = runner.ids[runner.experiment[unit]]
    raise NoOutcome(
        f"experiment '{name}': {surface.failed[condition[lost[0]]]} of its "
        f"{surface.runs[condition[lost[0]]]} runs failed, too many for a response surface"
        + (f"; so it is with {lost.size - 1} more of {len(runner.ids)}" if lost.size > 1 else ""),
        "see why they failed, check the conditions of the experiment, or narrow the box or the "
        f"bounds of {' or '.join(runner.parameters)}; or leave the experiment out",
        failures.x[failed],
        runner.cases.first[failures.case[failed]],
    )


def surface_progress(progress: Progress | None) -> Callable[[int, int, int], None] | None:
    """A function that reports the number of converged surfaces; None if `progress` is None."""
    if progress is None:
        return None
    listener = progress

    def tell(runs: int, converged: int, total: int) -> None:
        text = f"{runs} runs, {converged} of {total} surfaces converged"
        listener.update(text, converged, total)

    return tell
