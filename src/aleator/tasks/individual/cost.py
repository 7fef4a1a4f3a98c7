"""Whether a simulator is so cheap that surfaces of it would only cost time."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from aleator.laws.inputs import Inputs
from aleator.simulators import Runner
from aleator.surrogates.responses import moving_parameters
from aleator.types import Array, Indices

SLOW = 2e-3
"""Seconds of a run from where on a simulator is not cheap, however few runs are needed."""
AGAIN = 0.5
"""Seconds of a first run below which it is made again: it may have loaded what others use."""
LONGEST = 4.0
"""Seconds that the simulator may take in an identification without surfaces, for each parameter
that scatters: surfaces of more take more."""
EVALUATIONS = 400
"""Evaluations of the likelihood that an identification takes, about."""
NODES = 9
"""Nodes a variate that an identification comes to, about; of more than three variates fewer."""
SAMPLE = 8
"""Runs of every unit by which a run is timed, at least."""
MANY, BRIEF = 2000, 0.1
"""Runs of all units, at least, and seconds that they may take by what the first run took: of few
runs at once the time is that of a call."""
TIMES = 3
"""Times that a simulator which seems not to be cheap is timed."""
COMPUTES = 0.2
"""Share of a run's time on the processor from where on it is said to compute, not to wait."""


@dataclass(frozen=True)
class Timed:
    """Whether a simulator is cheap by its timed runs, and the `reason` in words; none untimed."""

    cheap: bool
    reason: str = ""

    def __bool__(self) -> bool:
        """Whether it is cheap."""
        return self.cheap


def cheap(runner: Runner, inputs: Inputs, x: Array, region: Array) -> Timed:
    """Whether all evaluations on the simulator itself would take less than LONGEST seconds.

    `region` (n, 2) is where its laws may be. Judged by a run of the first unit at x (n,), and
    where that is fast by eight or more runs of every unit at once. The least of three times
    decides: what else the machine does makes single ones longer. A study near the border may go
    either way.
    """
    first = np.zeros(1, dtype=np.intp)
    seconds = _timed(runner, first, x)
    if SLOW < seconds < AGAIN:
        seconds = min(_timed(runner, first, x) for _ in range(2))
    if seconds > SLOW:
        return Timed(False, f"a timed run takes more than {SLOW} s")
    runner.takes_arrays(region)
    together = min(MANY, BRIEF / max(seconds, 1e-9))
    sample = max(SAMPLE, int(together / runner.units))
    every = np.repeat(np.arange(runner.units), sample)
    evaluations = runs_each(inputs)
    longest = LONGEST * max(inputs.scattering, 1)
    total = np.inf
    for _ in range(TIMES):
        total = min(total, _timed(runner, every, x) / sample * evaluations)
        if total < longest:
            break
    verb = "less" if total < longest else "more"
    reason = f"by timed runs those of an identification would take {verb} than {longest:g} s"
    return Timed(total < longest, reason)


def runs_each(inputs: Inputs) -> int:
    """Runs of each unit that an identification without surfaces takes, about."""
    moving = int(moving_parameters(inputs.box).size)
    return int(NODES ** min(inputs.scattering, 3)) * (2 * moving + 1) * EVALUATIONS


def _timed(runner: Runner, units: Indices, x: Array) -> float:
    """Seconds of the processor where runs compute, by the clock where they mostly wait.

    A processor shared with others makes a computation last, but does not make it dearer.
    """
    points = np.tile(x, (len(units), 1))
    clock, processor = time.perf_counter(), time.thread_time()
    runner.straight(units, points)
    clock, processor = time.perf_counter() - clock, time.thread_time() - processor
    return min(clock, processor) if processor > COMPUTES * clock else clock
