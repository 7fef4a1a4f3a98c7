"""The user's budget of runs: what it must allow at least, and what is left for a check."""

from __future__ import annotations

from typing import TYPE_CHECKING

from aleator.errors import InputsError
from aleator.fit.rounds import EMULATION
from aleator.laws.inputs import Inputs
from aleator.simulators import Budget, Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import ResponseSurface
from aleator.surrogates.adaptive import ROUNDS, first_runs
from aleator.surrogates.choice import by_process
from aleator.surrogates.processes import least_first_runs

if TYPE_CHECKING:
    from aleator.moments.propagation import Collocation


def spend(
    budget: Budget,
    runner: Runner,
    inputs: Inputs,
    propagation: ResponseSurface | Collocation,
    moments: bool,
) -> None:
    """Count the runs of an identification against a budget from now on.

    Raises InputsError if the budget, with the runs in the store, is less than the first runs and
    their smallest test take: with Gaussian processes three runs of each condition, six where they
    matter, and one that is made twice. Raises it also for collocation, whose number of runs is
    fixed.
    """
    runner.allow(budget)
    if budget == Budget():
        return
    if not isinstance(propagation, ResponseSurface):
        raise InputsError(
            f"a budget of {budget} for collocation, which takes the runs that it takes",
            "leave the budget out, or choose response surfaces",
        )
    if by_process(propagation, moments):
        each = least_first_runs(runner.sloped * moving_parameters(inputs.box).size)
        least = each * len(runner.cases) + EMULATION.fewest + (3 if runner.sloped else 1)
    else:
        first = first_runs(moving_parameters(inputs.box).size, propagation)
        least = (first + ROUNDS.reserved) * len(runner.cases)
    known = 0 if runner.cache is None else runner.cache.at_start.runs
    if budget.runs is not None and budget.runs + known < least:
        raise InputsError(
            f"the budget of {budget} does not suffice: the first runs of {len(runner.cases)} "
            f"different experiments, and their smallest test, take {least:,}",
            f"allow at least {least - known:,}, or identify from fewer experiments first",
        )


def affordable(runner: Runner, runs: int) -> int | None:
    """How many of `runs` runs of each simulated unit the budget allows; None if it allows all.

    The number is 0 where the budget allows fewer than the smallest check takes.
    """
    given = runner.account.granted(runs * runner.units)
    if given == runs * runner.units:
        return None
    each = given // runner.units
    return each if each >= ROUNDS.reserved else 0
