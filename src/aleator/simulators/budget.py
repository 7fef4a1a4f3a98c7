"""A budget of runs and hours, and what is left of it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Protocol

from aleator.errors import SimulatorError

HOUR = 3600.0  # s


@dataclass(frozen=True)
class Budget:
    """The most that an identification may take: new runs of the simulator, and hours of the clock.

    Runs that a store knows cost nothing, so that the same identification with the same budget gets
    further each time. None is no limit. Raises SimulatorError for what is not positive.

    >>> Budget(runs=500)
    Budget(runs=500, hours=None)
    """

    runs: int | None = None
    hours: float | None = None

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        for name, value in (("runs", self.runs), ("hours", self.hours)):
            if value is not None and not 0.0 < value < math.inf:
                raise SimulatorError(f"budget: {name} {value}", "choose a positive number")

    def __str__(self) -> str:
        """As a message says it."""
        runs = [] if self.runs is None else [f"{self.runs:,} runs"]
        hours = [] if self.hours is None else [f"{self.hours:g} h"]
        return " and ".join(runs + hours)


class Counted(Protocol):
    """What makes runs and counts them: all that it `tried`, and the seconds that were `waited`."""

    tried: int
    waited: float


class Account:
    """What is left of a budget, counted from now on: runs are taken from it as `by` makes them.

    `refused` tells whether somebody was given less than was asked for.

    >>> from types import SimpleNamespace
    >>> made = SimpleNamespace(tried=0, waited=0.0)
    >>> account = Account(Budget(runs=500), made)
    >>> made.tried = 300
    >>> account.given(250, reserve=10), account.refused
    (190, True)
    """

    def __init__(self, budget: Budget, by: Counted) -> None:
        self.budget, self.refused = budget, False
        self._by, self._before = by, by.tried
        self._began = time.monotonic()

    def given(self, runs: int, reserve: int = 0) -> int:
        """How many of these runs there may be, with so many left for what comes after them."""
        given = int(max(0, min(runs, self._left() - reserve)))
        self.refused |= given < runs
        return given

    @property
    def made(self) -> int:
        """New runs so far."""
        return self._by.tried - self._before

    def _left(self) -> float:
        """Runs that are left; before the first one nobody knows what one takes."""
        left = math.inf if self.budget.runs is None else self.budget.runs - self.made
        if self.budget.hours is None or not self._by.tried:
            return left
        seconds = self.budget.hours * HOUR - (time.monotonic() - self._began)
        return min(left, seconds * self._by.tried / max(self._by.waited, 1e-9))
