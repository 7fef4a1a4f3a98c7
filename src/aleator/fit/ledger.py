"""The runs and seconds of each stage of an identification, and the user's budget of runs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from aleator.core.progress import Progress
from aleator.errors import InputsError
from aleator.laws.inputs import Inputs
from aleator.simulators import Budget, Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.surrogates import ResponseSurface
from aleator.surrogates.adaptive import ROUNDS, first_runs
from aleator.surrogates.choice import by_process
from aleator.surrogates.processes import PROCESSES

if TYPE_CHECKING:
    from aleator.moments.propagation import Collocation

SURFACE, SEARCH = "response surface", "search"
"""The names of two stages in the account of runs and seconds."""


class Ledger:
    """An account of the seconds and simulator runs of each stage, with a progress display."""

    def __init__(self, runner: Runner, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self.runs: dict[str, int] = {}
        self.progress = progress
        self._runner = runner
        self._last = ""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage of the work and count its seconds and runs; a stage may be repeated."""
        if name != self._last:
            self.progress.stage(name)
        self._last = name
        began, before = time.perf_counter(), self._runner.runs
        try:
            yield
        finally:
            seconds, runs = time.perf_counter() - began, self._runner.runs - before
            self.seconds[name] = self.seconds.get(name, 0.0) + seconds
            self.runs[name] = self.runs.get(name, 0) + runs


def spend(
    budget: Budget,
    runner: Runner,
    inputs: Inputs,
    propagation: ResponseSurface | Collocation,
    moments: bool,
) -> None:
    """Count the runs of an identification against a budget from now on.

    Raises InputsError if the budget, with the runs in the store, is less than the first surfaces
    and the smallest check take. Raises it also for collocation, whose number of runs is fixed.
    """
    runner.allow(budget)
    if budget == Budget():
        return
    if not isinstance(propagation, ResponseSurface):
        raise InputsError(
            f"a budget of {budget} for collocation, which takes the runs that it takes",
            "leave the budget out, or choose response surfaces",
        )
    first = first_runs(moving_parameters(inputs.box).size, propagation) + ROUNDS.reserved
    least = (PROCESSES.first if by_process(propagation, moments) else first) * len(runner.cases)
    known = 0 if runner.cache is None else runner.cache.at_start.runs
    if budget.runs is not None and budget.runs + known < least:
        raise InputsError(
            f"the budget of {budget} does not suffice: the first surfaces of {len(runner.cases)} "
            f"different experiments, and their check, take {least:,} runs",
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
