"""The normal density that stands in where a density of the nodes cannot be had."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.densities.interface import FAILED_SOLVE_PENALTY, FARTHEST, SMALLEST_SD
from aleator.types import Array

BEYOND = 40.0
"""Logarithm by which the continuation lies under a density: the last node of a grid of variates
has a density e^-33 or more, so that only where there are no nodes the continuation is above."""

NOTHING = 1e-17
"""Share of the continuation below which it changes no digit of a derivative."""


@dataclass(frozen=True)
class NodeNormal:
    """Mean and standard deviation of the outcome: y (N, J), weights (J,).

    mean = sum_j w_j y_j, sd^2 = sum_j w_j (y_j - mean)^2.

    >>> n = NodeNormal(np.array([[1.0, 3.0]]), np.array([0.5, 0.5]))
    >>> n.mean.tolist(), n.sd.round(9).tolist()
    ([2.0], [1.0])
    """

    y: Array
    weights: Array

    @cached_property
    def mean(self) -> Array:
        """(N,)"""
        return np.asarray(self.y @ self.weights)

    @cached_property
    def sd(self) -> Array:
        """(N,); SMALLEST_SD where there is no scatter but that of rounding."""
        scatter = np.sqrt((self.y - self.mean[:, None]) ** 2 @ self.weights)
        scatter = np.where(scatter > 1e-14 * np.abs(self.y).max(axis=1), scatter, 0.0)
        return np.maximum(scatter, SMALLEST_SD)

    def chain(self, by_mean: Array, by_sd: Array) -> tuple[Array, Array]:
        """Partials by y (N, J) and weights (N, J) of what has these by mean and sd."""
        centered = self.y - self.mean[:, None]
        by_variance = (0.5 * by_sd / self.sd)[:, None]
        d_y = self.weights * (by_mean[:, None] + 2.0 * by_variance * centered)
        d_weights = by_mean[:, None] * self.y + by_variance * centered**2
        return d_y, d_weights

    def sensitivity(self, outcome: Array) -> tuple[Array, Array, Array]:
        """Log-density (N,) at the outcome (N,) less FAILED_SOLVE_PENALTY, with its partials."""
        u = np.clip((outcome - self.mean) / self.sd, -FARTHEST, FARTHEST)
        value = -0.5 * u**2 - np.log(self.sd) - 0.5 * np.log(2.0 * np.pi) - FAILED_SOLVE_PENALTY
        return value, *self.chain(u / self.sd, (u**2 - 1.0) / self.sd)

    def beyond(self, outcome: Array) -> tuple[Array, Array]:
        """What a search sees where the nodes end: -BEYOND - log sd - u^2/18, (N, G), with its u.

        u = (outcome - mean)/sd for outcomes (N, G).
        """
        sd = self.sd[:, None]
        with np.errstate(over="ignore"):
            u = np.clip((outcome - self.mean[:, None]) / sd, -FARTHEST, FARTHEST)
        return -BEYOND - np.log(sd) - (u / 3.0) ** 2 / 2.0, u

    def lifted(self, outcome: Array, value: Array, d_y: Array) -> tuple[Array, Array]:
        """log(exp(value) + exp(beyond)) (N,) at the outcome (N,), and its partials (N, J) by y."""
        far, u = (found[:, 0] for found in self.beyond(outcome[:, None]))
        total = np.logaddexp(value, far)
        share = np.exp(far - total)
        seen = np.flatnonzero(share > NOTHING)
        if not seen.size:
            return total, d_y
        few = NodeNormal(self.y[seen], self.weights)
        by_mean = share * u / (9.0 * self.sd)
        by_sd = share * (u**2 / 9.0 - 1.0) / self.sd
        moved = few.chain(by_mean[seen], by_sd[seen])[0]
        d_y[seen] = np.exp(value - total)[seen, None] * d_y[seen] + moved
        return total, d_y
