"""Simulated values of the observations, each experiment at parameters of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aleator.likelihood.individual.layout import Block
from aleator.types import Array, Indices

STEP = 1e-6
"""Step of differences over the size of a parameter."""
SMALLEST_STEP = 1e-10
"""The same over the width of its box, where the parameter is near zero."""


class Evaluator(Protocol):
    """What gives simulated values: a runner (see `Runner`)."""

    def straight(self, unit: Indices, x: Array) -> Array:
        """Values (R, W) of units (R,) at parameters x (R, n)."""


class Predictor(Protocol):
    """What answers for the simulator: itself, or its surfaces."""

    def values(self, block: Block, x: Array) -> Array:
        """eta (m, J) of the m observations of a block at its experiments' parameters x (B, J, n).

        NaN where there is no value.
        """

    def with_slopes(self, block: Block, x: Array) -> tuple[Array, Array]:
        """eta (m, J), and its derivatives (n, m, J); zero by a parameter that is known."""


@dataclass(frozen=True, eq=False)
class Direct:
    """The simulator itself, for functions that cost less than a surface; central differences.

    `moving` are the parameters whose derivatives are asked for; steps stay in the box (n, 2).
    """

    runner: Evaluator
    moving: Indices
    box: Array

    def values(self, block: Block, x: Array) -> Array:
        """One evaluation a unit and node."""
        nodes = x.shape[1]
        points = x[block.unit_owner].reshape(-1, x.shape[2])
        found = self.runner.straight(np.repeat(block.units, nodes), points)
        whole = found.reshape(block.units.size, nodes, -1)
        return np.asarray(whole[block.place, :, block.column])

    def with_slopes(self, block: Block, x: Array) -> tuple[Array, Array]:
        """2 n + 1 evaluations a unit and node, in one call; slope 0 where one is not finite."""
        points, gaps = self._points(x)
        found = self.values(block, points.reshape(len(x), -1, x.shape[2]))
        parts = found.reshape(len(found), points.shape[1], -1)
        slopes = np.zeros((x.shape[2], len(found), x.shape[1]))
        for k, i in enumerate(self.moving):
            with np.errstate(invalid="ignore"):
                rise = parts[:, 1 + 2 * k] - parts[:, 2 + 2 * k]
            fine = np.isfinite(rise)
            # an infinite value, such as a life without end, stays what it is
            slopes[i] = (rise if np.all(fine) else np.where(fine, rise, 0.0)) / gaps[k][block.owner]
        return parts[:, 0], slopes

    def _points(self, x: Array) -> tuple[Array, list[Array]]:
        """x (B, J, n) and steps up and down from it (B, 2 n + 1, J, n), and how far they are apart.

        Steps stay in the box; where x is beyond it, on their side of x.
        """
        size = np.sqrt(np.mean(x**2, axis=(0, 1)))
        points = np.repeat(x[:, None], 1 + 2 * self.moving.size, axis=1)
        gaps = []
        for k, i in enumerate(self.moving):
            own, (low, high) = x[..., i], self.box[i]
            step = max(STEP * size[i], SMALLEST_STEP * (high - low))
            up, down = points[:, 1 + 2 * k, :, i], points[:, 2 + 2 * k, :, i]
            np.minimum(own + step, np.maximum(own, high), out=up)
            np.maximum(own - step, np.minimum(own, low), out=down)
            gaps.append(up - down)
        return points, gaps
