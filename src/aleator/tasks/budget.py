"""Whether a budget suffices for an answer at all: asked before the first run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from aleator.errors import InputsError
from aleator.laws.inputs import Inputs
from aleator.simulators import Budget, Runner
from aleator.surrogates import ResponseSurface
from aleator.surrogates.adaptive import first_runs
from aleator.surrogates.afforded import RESERVED
from aleator.surrogates.responses import moving_parameters

if TYPE_CHECKING:
    from aleator.moments.propagation import Collocation


def spend(
    budget: Budget, runner: Runner, inputs: Inputs, propagation: ResponseSurface | Collocation
) -> None:
    """Count the runs of an identification against a budget from now on.

    Raises InputsError where it is less than the first surfaces and the least check take, and the
    store of the runner does not have the rest; or where there are no surfaces to save runs at.
    """
    runner.allow(budget)
    if budget == Budget():
        return
    if not isinstance(propagation, ResponseSurface):
        raise InputsError(
            f"a budget of {budget} for collocation, which takes the runs that it takes",
            "leave the budget out, or choose response surfaces",
        )
    first = first_runs(moving_parameters(inputs.box).size, propagation) + RESERVED
    least = first * len(runner.cases)
    known = 0 if runner.cache is None else runner.cache.at_start.runs
    if budget.runs is not None and budget.runs + known < least:
        raise InputsError(
            f"the budget of {budget} does not suffice: the first surfaces of {len(runner.cases)} "
            f"different experiments, and their check, take {least:,} runs",
            f"allow at least {least - known:,}, or identify from fewer experiments first",
        )


def affordable(runner: Runner, runs: int) -> int | None:
    """Of so many runs of each unit how many the budget has; None if it has them all.

    None at all, 0, where they are fewer than the least check takes.
    """
    given = runner.account.given(runs * runner.units)
    if given == runs * runner.units:
        return None
    each = given // runner.units
    return each if each >= RESERVED else 0
