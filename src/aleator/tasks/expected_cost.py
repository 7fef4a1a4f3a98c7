"""What an identification will cost: how many runs of the simulator, before it is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from aleator.fit.question import is_exact, start_point
from aleator.fit.way import grids_each, runs_each, way_of, way_of_outcomes
from aleator.inference.check import Check
from aleator.laws.inputs import Inputs
from aleator.likelihood.model import Model
from aleator.observations.errors import Noise
from aleator.observations.experiments import Experiments
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface
from aleator.surrogates.adaptive import first_runs, linear_runs
from aleator.tasks.first_look import LookPlan

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


@dataclass(frozen=True)
class CostSettings:
    """How runs are foreseen.

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
    """How many runs `identify` will make; None where it says nothing beforehand (collocation).

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
