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
        nodes = x.shape[1]
        width = self.box[:, 1] - self.box[:, 0]
        size = np.sqrt(np.mean(x**2, axis=(0, 1)))
        points, gaps = [x], []
        for i in self.moving:
            step = max(STEP * size[i], SMALLEST_STEP * width[i])
            low = np.minimum(x[..., i], self.box[i, 0])
            high = np.maximum(x[..., i], self.box[i, 1])
            up, down = x.copy(), x.copy()
            np.clip(x[..., i] + step, low, high, out=up[..., i])
            np.clip(x[..., i] - step, low, high, out=down[..., i])
            gaps.append(up[..., i] - down[..., i])
            points += [up, down]
        found = self.values(block, np.concatenate(points, axis=1))
        parts = found.reshape(len(found), len(points), nodes)
        slopes = np.zeros((x.shape[2], len(found), nodes))
        for k, i in enumerate(self.moving):
            with np.errstate(invalid="ignore"):
                rise = parts[:, 1 + 2 * k] - parts[:, 2 + 2 * k]
            # an infinite value, such as a life without end, stays what it is
            slopes[i] = np.where(np.isfinite(rise), rise, 0.0) / gaps[k][block.owner]
        return parts[:, 0], slopes
