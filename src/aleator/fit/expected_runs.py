"""How many runs the rounds of Gaussian processes are expected to take, from the errors told so far.

The told errors fall like a power of the number of runs. Only the last ones count: the number of
runs is multiplied until the errors are as small as they are to be, and a few rounds confirm that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ExpectedRunsSettings:
    """Settings of the number of runs that is expected of the rounds."""

    power: float = 4.0
    """The told errors fall like the number of runs to minus this power. Of 2, 2.5, 3, 3.5, 4, 5 and
    6 it forecast the studies of `python -m benchmarks.forecasts` best; straight lines through the
    logarithms of all rounds did no better."""
    goals: tuple[float, ...] = (0.2, 0.1)
    """The errors of the estimates, in standard errors, for which the number of runs is told."""


EXPECTED_RUNS = ExpectedRunsSettings()


@dataclass(frozen=True)
class RoundsAhead:
    """What follows until errors are small: rounds of `size` runs, the last `confirmed` of them.

    `change` is the error of the log-likelihood at which the rounds may end. `calm` rounds in
    succession have had small errors, the last one among them.
    """

    size: int
    confirmed: int
    change: float
    calm: int = 0

    def expected(
        self,
        runs: int,
        alpha: float,
        log_likelihood: float,
        goal: float,
        settings: ExpectedRunsSettings = EXPECTED_RUNS,
    ) -> float:
        """The number of all runs when the rounds end, after `runs` that left these errors.

        The error `alpha` of the estimates is to be `goal`, both in standard errors. Infinite where
        an error is.

        >>> ahead = RoundsAhead(size=30, confirmed=2, change=0.3)
        >>> ahead.expected(180, 0.05, 0.1, 0.2), ahead.expected(180, 3.2, 1.0, 0.2)
        (240.0, 390.0)
        """
        short = max(alpha / goal, log_likelihood / self.change, 1.0)
        if math.isinf(short):
            return math.inf
        rounds = math.ceil(runs * (short ** (1.0 / settings.power) - 1.0) / self.size)
        left = rounds + self.confirmed - 1 if rounds else max(self.confirmed - self.calm, 0)
        return float(runs + self.size * left)
