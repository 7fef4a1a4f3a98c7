"""The wet clutch as the paper uses it: 108 experiments, two parameters in a box, measurements.

The measurements are synthetic, those of the example `examples/wet_clutch`: the authors' are not
public.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import pandas as pd

from aleator.core.types import Array, Indices
from aleator.laws import Free, TruncatedNormal
from aleator.laws.inputs import Inputs
from aleator.observations.experiments import Experiments
from examples.wet_clutch.bench import BOX, measure
from examples.wet_clutch.course import trajectories
from examples.wet_clutch.model import shifting_time

PARAMETERS = ("c2_scale", "zp_scale")
CONDITIONS = ("pulse_duration", "hold_current", "pulse_current", "motor_speed", "brake_torque")
OUTCOME = "shifting_time"

SHOWN = 16
"""Number of the experiment that the paper looks at closely."""

GIVEN = np.array([1.0, 0.07, 1.0, 0.02])
"""The paper's alpha = (1, 1, 0.07, 0.02) in our order: mean and sd of x_1, mean and sd of x_2."""

BENCH_SEED = 1  # of the example's measurements
SD_LIMITS = Free(0.002, 0.4)  # of the example's study


@dataclass(frozen=True)
class ClutchStudy:
    """Experiments, measurements, simulator and law of the benchmark.

    >>> len(ClutchStudy().outcomes)
    108
    """

    @cached_property
    def table(self) -> pd.DataFrame:
        """The 108 experiments with their synthetic measurements."""
        return measure(seed=BENCH_SEED)

    @cached_property
    def outcomes(self) -> Array:
        """Measured shifting times (108,) [s]."""
        return self.table[OUTCOME].to_numpy(dtype=np.float64)

    @cached_property
    def experiments(self) -> Experiments:
        """The 108 experiments as an identification takes them."""
        return Experiments.from_frame(self.table[[*CONDITIONS, OUTCOME]], outcome=OUTCOME)

    @property
    def box(self) -> Array:
        """The feasible box (2, 2) of (x_1, x_2)."""
        return np.array(BOX)

    def law(self, polynomials: Literal["own", "hermite"] = "own") -> Inputs:
        """Truncated normal laws of both scales; "hermite" is the paper's clip."""
        laws = {
            name: TruncatedNormal(box, sd=SD_LIMITS, polynomials=polynomials)
            for name, box in zip(PARAMETERS, BOX, strict=True)
        }
        return Inputs(laws)

    def run(self, index: Indices, x: Array) -> Array:
        """Shifting times (R,) [s] of experiments `index` (R,), from 0, at x (R, 2)."""
        conditions = {name: self.table[name].to_numpy()[index] for name in CONDITIONS}
        return shifting_time(**conditions, c2_scale=x[:, 0], zp_scale=x[:, 1])

    def course(self, until: float = 2.0, **changed: float) -> pd.DataFrame:
        """The course of the experiment that the paper shows, with x = (1, 1) or what is given."""
        return trajectories(**{**self._conditions(SHOWN - 1), **changed}, until=until)

    def courses(self, step: int = 1) -> Iterator[pd.DataFrame]:
        """The courses of the experiments, or of every `step`-th of them, with x = (1, 1)."""
        for l in range(0, len(self.table), step):
            yield trajectories(**self._conditions(l))

    def _conditions(self, index: int) -> dict[str, float]:
        return {name: float(self.table[name].iloc[index]) for name in CONDITIONS}
