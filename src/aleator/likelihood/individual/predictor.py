"""Simulated values of the observations, each experiment at parameters of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aleator.types import Array, Indices

STEP = 1e-6
"""Step of differences over the size of a parameter."""
SMALLEST_STEP = 1e-10
"""The same over the width of its box, where the parameter is near zero."""


class Evaluator(Protocol):
    """What gives simulated values: a runner (see `Runner`)."""

    @property
    def unit(self) -> Indices:
        """Which unit makes each observation, (M,)."""

    @property
    def column(self) -> Indices:
        """Which of the values of its unit it is, (M,)."""

    def straight(self, unit: Indices, x: Array) -> Array:
        """Values (R, W) of units (R,) at parameters x (R, n)."""


class Predictor(Protocol):
    """What answers for the simulator: itself, or its surfaces."""

    def values(self, experiments: slice, x: Array) -> Array:
        """eta (m, J) of the m observations of B experiments at their parameters x (B, J, n).

        NaN where there is no value. Observations are sorted by experiment.
        """

    def with_slopes(self, experiments: slice, x: Array) -> tuple[Array, Array]:
        """eta (m, J), and its derivatives (n, m, J); zero by a parameter that is known."""


@dataclass(frozen=True, eq=False)
class Direct:
    """The simulator itself, for functions that cost less than a surface; central differences.

    `experiment` (M,) is that of each observation, sorted; `moving` are the parameters whose
    derivatives are asked for; steps stay in the box (n, 2).
    """

    runner: Evaluator
    experiment: Indices
    moving: Indices
    box: Array

    def values(self, experiments: slice, x: Array) -> Array:
        """One evaluation an observation and node, those of one unit together."""
        rows = rows_of(self.experiment, experiments)
        unit, column = self.runner.unit[rows], self.runner.column[rows]
        units, place = np.unique(unit, return_inverse=True)
        owner = np.empty(units.size, dtype=np.intp)
        owner[place] = self.experiment[rows] - experiments.start
        nodes = x.shape[1]
        points = x[owner].reshape(-1, x.shape[2])
        found = self.runner.straight(np.repeat(units, nodes), points)
        return np.asarray(found.reshape(units.size, nodes, -1)[place, :, column])

    def with_slopes(self, experiments: slice, x: Array) -> tuple[Array, Array]:
        """2 n + 1 evaluations an observation and node."""
        value = self.values(experiments, x)
        slopes = np.zeros((x.shape[2], *value.shape))
        width = self.box[:, 1] - self.box[:, 0]
        size = np.sqrt(np.mean(x**2, axis=(0, 1)))
        for i in self.moving:
            step = max(STEP * size[i], SMALLEST_STEP * width[i])
            ends = []
            for sign in (1.0, -1.0):
                moved = x.copy()
                low = np.minimum(x[..., i], self.box[i, 0])
                high = np.maximum(x[..., i], self.box[i, 1])
                moved[..., i] = np.clip(x[..., i] + sign * step, low, high)
                ends.append((moved[..., i], self.values(experiments, moved)))
            rows = self.experiment[rows_of(self.experiment, experiments)] - experiments.start
            slopes[i] = (ends[0][1] - ends[1][1]) / (ends[0][0] - ends[1][0])[rows]
        return value, slopes


def rows_of(experiment: Indices, experiments: slice) -> slice:
    """Where the observations of some experiments lie; `experiment` (M,) is sorted."""
    first, last = np.searchsorted(experiment, [experiments.start, experiments.stop])
    return slice(int(first), int(last))
