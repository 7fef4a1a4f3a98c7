"""Rounds of runs for Gaussian processes: how many runs each makes, and when they end.

They end when the error that the processes cause is small, and believed. How many runs they are
expected to take follows from the errors told so far, which fall like a power of the number of runs.
Only the last ones count: the number of runs is multiplied until the errors are as small as they are
to be, and a few rounds confirm that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array
from aleator.simulators import Runner
from aleator.surrogates import ResponseSurface


@dataclass(frozen=True)
class EmulationSettings:
    """Settings of the rounds of runs of Gaussian processes.

    Measured by `python -m benchmarks.emulators`, where no other reason is given.
    """

    enough: float = 0.2
    """The error of alpha caused by the processes, in standard errors and in the worst direction, at
    which the rounds end. It widens an interval by 2 %."""
    unknown: float = 0.5
    """The error of alpha from which a result is refused. By judgement: it widens an interval by
    12 %."""
    surprise: float = 2.0
    """The distance of the last new values from those expected, as a root mean square in standard
    deviations of the processes, up to which told errors are believed; not with slopes, whose first
    values are farther off (`tests/fit/test_jac.py`). Seven studies ended with 1.0 to 1.1, a valve
    with dry friction with 3.2: its mean was off by some twenty times what was told."""
    change: float = 0.3
    """The error of the log-likelihood caused by the processes at which the rounds end; with many
    experiments it is `each` for each of them."""
    each: float = 1e-3
    """The error of the log-likelihood that is admitted for each experiment."""
    part: float = 0.5
    """A round makes one run of each of this share of the conditions: those that cause most of the
    error."""
    fewest: int = 6
    """The least number of runs of a round."""
    each_worker: int = 2
    """The least number of runs of a round for each worker, so that a cluster is busy. By judgement:
    one is running, the other waits."""
    rounds: int = 2
    """The rounds end when the errors are so small after this number of rounds in succession."""
    sloped: int = 3
    """This number where runs give slopes. With two the errors of alpha of the wet clutch were 0.22
    and 0.26, with three 0.06 and 0.20."""
    seen: int = 30
    """The least number of new values whose distances from those expected are compared with the
    standard deviations of the processes."""
    search: float = 0.01
    """The error of alpha and of the log-likelihood that is left to the search."""
    searches: int = 6
    """The largest number of times that the rounds go on from a higher maximum, or because surfaces
    did not reach a measured value."""
    others: int = 3
    """The number of optima of the first search, besides the best, from which it is sought."""
    patience: int = 15
    """The rounds end when the error of alpha has not fallen below the least so far in this number
    of rounds, as with an outcome that jumps. By judgement."""
    waited: float = 0.5
    """The share of all rounds in which it must not have fallen either. Without it two of three
    series of two compartments were given up after some 40 rounds (`python -m
    benchmarks.emulators`)."""
    most: int = 60
    """The largest number of rounds."""
    draws: int = 2048
    """The number of draws of the law among which those are sought that agree with the measured
    values."""
    wide: float = 1.3
    """The factor by which these draws scatter more than the law."""
    near: int = 96
    """The number of these draws about each experiment."""
    missed: float = 0.25
    """The share of `enough` that is admitted for polynomials fitted to the processes. With a larger
    error, if it is half of the whole, they get twice as many terms."""
    fitted: int = 8
    """The number of them to which polynomials are fitted, besides draws of the laws."""
    candidates: int = 32
    """The number of them at which a run of a condition is considered."""
    shrink: float = 0.6
    """A region is narrowed only to less than this share of its volume."""
    nodes: tuple[int, ...] = (1, 5, 5, 3, 3)
    """The number of Gauss-Hermite nodes of the rounds, for 0, 1, 2, 3 and 4 parameters that
    scatter; with more there are points along a ridge."""
    points: int = 400
    """The number of importance points of the rounds, where an experiment has several modes."""
    largest: float = 1e20
    """The largest derivative of alpha by a value, and the largest information in units of the width
    of the limits; beyond them the error of alpha is unknown."""
    far: float = 20.0
    """Simulated values farther from the measured ones of their column than this many times the
    range of these are cut off."""
    narrower: float = 0.5
    """The share of the width of a parameter's first region below which the limits that led to it
    count as too wide, where the rounds are given up. By judgement."""
    lost: int = 2
    """The number of extra rounds for outputs all of whose runs failed."""


EMULATION = EmulationSettings()


@dataclass(frozen=True)
class EmulatorError:
    """What the processes leave unknown.

    `alpha` is the error of alpha in standard errors: the root mean square of sqrt(d' H d), where d
    is the change of alpha and H the information. `log_likelihood` is the error of the
    log-likelihood. `surprise` is the root mean square of the last new values' distances from those
    expected, in standard deviations, or one if that is less; both errors are multiplied by it.
    `shares` (C,) are the parts of the conditions in the squared error of alpha. `missed` is the
    part of `alpha` that is caused by polynomials in place of the processes. `sloped` says that the
    processes use derivatives of the simulator.
    """

    alpha: float
    log_likelihood: float
    surprise: float
    shares: Array
    missed: float = 0.0
    sloped: bool = False

    @property
    def doubted(self) -> bool:
        """Whether the last new values lie too far from those expected to believe the errors."""
        return self.surprise > EMULATION.surprise and not self.sloped

    @property
    def learned(self) -> float:
        """The part of the error of alpha that more runs would reduce."""
        return max(self.alpha**2 - self.missed**2, 0.0) ** 0.5 if self.alpha < np.inf else np.inf

    def enough(self, experiments: int, settings: EmulationSettings = EMULATION) -> bool:
        """Whether both errors are so small that the rounds may end, and may be believed."""
        small = self.log_likelihood <= admitted_change(experiments, settings)
        return self.alpha <= settings.enough and small and not self.doubted


@dataclass(frozen=True)
class EmulatorRound:
    """The errors after a number of runs: of alpha in standard errors, and of the log-likelihood."""

    runs: int
    alpha: float
    log_likelihood: float


def admitted_change(experiments: int, settings: EmulationSettings = EMULATION) -> float:
    """The error of the log-likelihood of a number of experiments at which the rounds may end.

    >>> admitted_change(40), admitted_change(2000)
    (0.3, 2.0)
    """
    return max(settings.change, settings.each * experiments)


def confirming(sloped: bool, settings: EmulationSettings = EMULATION) -> int:
    """The number of rounds in succession with small errors after which the rounds end."""
    return settings.sloped if sloped else settings.rounds


def usual(conditions: int, settings: EmulationSettings = EMULATION) -> int:
    """The number of runs of a round, for a number of distinct conditions and few workers.

    >>> usual(5), usual(108)
    (6, 54)
    """
    return int(max(settings.fewest, settings.part * conditions))


def enlarged(
    runner: Runner, choice: ResponseSurface | None, settings: EmulationSettings = EMULATION
) -> int:
    """The number of runs of a round where that is larger than usual for the sake of workers, or 0.

    The answer depends on the number of workers only through it.
    """
    stated = None if choice is None else choice.together
    together = stated or settings.each_worker * runner.workers
    return together if together > usual(len(runner.cases), settings) else 0


def stalled(
    told: Sequence[EmulatorRound], maxima: Sequence[float], settings: EmulationSettings = EMULATION
) -> bool:
    """Whether the least error of alpha lies back as many rounds as are waited for.

    The first error does not count: new values have not tested the processes before it, so that it
    may be far too small. Nor do errors count from before the last round whose maximum of the
    log-likelihood was the highest so far, by more than `change`: they are in the standard errors of
    another law, which may be much wider. `maxima` are those of the rounds.

    >>> def rounds(errors):
    ...     return [EmulatorRound(6 * k, error, 1.0) for k, error in enumerate(errors)]
    >>> def ended(errors, rise=0.0):
    ...     return stalled(rounds(errors), [rise * k for k in range(len(errors))])
    >>> ended([0.1, 3.0, 2.0] + 15 * [4.0]), ended(22 * [3.0] + 15 * [4.0])
    (True, True)
    >>> ended([5.0 - 0.1 * k for k in range(22)] + 15 * [4.0])
    False
    >>> ended([0.1, 3.0, 2.0] + 15 * [4.0], rise=100.0)
    False
    """
    highest = np.maximum.accumulate(maxima)
    risen = np.flatnonzero(highest[1:] > highest[:-1] + settings.change) + 1
    errors = [one.alpha for one in told[max([1, *risen.tolist()]) :]]
    since = len(errors) - 1 - int(np.argmin(errors)) if errors else 0
    return since >= max(settings.patience, settings.waited * (len(told) - 1))


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
