"""The outcome near each node, approximated by a normal law from its local expansion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np

from aleator.quadrature import Lattice
from aleator.types import Array, Flags

_NO_SPREAD = 1e-10
"""Spread over outcome that is none but that of rounding."""


@dataclass(frozen=True)
class Linearized:
    """Normal components around J nodes, theta = u + tau zeta, that together have no spikes.

    u ~ Normal(0, (1 - tau^2) I) lies on the nodes, zeta ~ Normal(0, I) is integrated around each.
    With eta to second order the component's mean is eta_j + tau^2/2 sum_i H_ii and its variance
    tau^2 sum_i g_i^2 + tau^4/2 sum_ik H_ik^2, g and H being differences of the
    outcomes y (N, J) on the lattice: a Gaussian sum by local linearization (Alspach and Sorenson,
    1972) with the second-order terms. Exact for a linear outcome, and in both moments for a
    quadratic one; else the error is of order tau^4. tau is the lattice's width. A component of no
    spread is a point mass: it has no density, and its weight is zero. Cost O(N J n^2).

    >>> from aleator.quadrature import GermGrid
    >>> from aleator.laws.inputs import Inputs
    >>> from aleator.laws import Normal
    >>> grid = GermGrid(161).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([0.0, 1.0]))
    >>> around = Linearized(3.0 * grid.x.T, grid.weights, grid.lattice)
    >>> bool(np.allclose(around.variance, 9.0 * grid.lattice.width**2))
    True
    """

    y: Array
    weights: Array
    lattice: Lattice

    def take(self, rows: Flags) -> Linearized:
        """Of some of the experiments."""
        return replace(self, y=self.y[rows])

    @cached_property
    def mean(self) -> Array:
        """(N, J)"""
        return np.asarray(self.y + 0.5 * self._square * self._trace)

    @cached_property
    def variance(self) -> Array:
        """(N, J); 1 for a point mass."""
        return np.where(self.points, 1.0, self._spread)

    @cached_property
    def points(self) -> Flags:
        """(N, J) nodes around which the outcome does not move."""
        points: Flags = self._spread <= (_NO_SPREAD * self.y) ** 2
        return points

    @cached_property
    def log_core(self) -> Array:
        """Logarithms (N, J) of the components' weights."""
        if not self.points.any():
            return np.broadcast_to(self.log_core_all, self.y.shape)
        # without any scatter there is no density, and nothing to take away
        scattered = ~self.points.all(axis=1, keepdims=True)
        return np.where(self.points & scattered, -np.inf, self.log_core_all)

    @cached_property
    def log_core_all(self) -> Array:
        """The same (J,) of point masses too, one for all experiments."""
        core = 1.0 - self._square
        away = 0.5 * self.lattice.distance2 * (1.0 - 1.0 / core)
        with np.errstate(divide="ignore"):
            log_weights = np.log(self.weights)
        return np.asarray(log_weights + away - 0.5 * len(self.slopes) * np.log(core))

    @cached_property
    def bend(self) -> Array:
        """(N,) mean share of curvature in a component's standard deviation, between 0 and 1."""
        share = np.where(self.points, 0.0, self._curved / self.variance)
        return np.asarray(np.sqrt(share) @ self.weights)

    def chain(self, by_mean: Array, by_variance: Array) -> Array:
        """Partials by y (N, J) of what has these by mean and variance (N, J)."""
        lattice, square = self.lattice, self._square
        by_bend = square**2 * by_variance
        by_steepness = 2.0 * square * by_variance
        total = by_mean.copy()
        for second, bend in zip(lattice.second, self.bends, strict=True):
            total += (0.5 * square * by_mean + by_bend * bend) @ second
        for k, slope in enumerate(self.slopes):
            partial = by_steepness * slope
            for i in range(k):
                partial += (2.0 * by_bend * self._twists[i, k]) @ lattice.first[i]
            total += partial @ lattice.first[k]
        return total

    @property
    def _square(self) -> float:
        """tau^2."""
        return float(self.lattice.width**2)

    @cached_property
    def _steepness(self) -> Array:
        return reduce(np.add, (slope**2 for slope in self.slopes))

    @cached_property
    def _trace(self) -> Array:
        return reduce(np.add, self.bends)

    @cached_property
    def _curvature(self) -> Array:
        """sum_ik H_ik^2"""
        twice = (2.0 * twist**2 for twist in self._twists.values())
        return reduce(np.add, (*(bend**2 for bend in self.bends), *twice))

    @cached_property
    def _spread(self) -> Array:
        return np.asarray(self._square * self._steepness + self._curved)

    @cached_property
    def _curved(self) -> Array:
        return 0.5 * self._square**2 * self._curvature

    @cached_property
    def slopes(self) -> tuple[Array, ...]:
        """First differences (N, J) along each axis."""
        if self.line:
            return (np.gradient(self.y, self.lattice.step, axis=1),)
        return tuple(np.asarray(self.y @ first.T) for first in self.lattice.first)

    @cached_property
    def bends(self) -> tuple[Array, ...]:
        """Second differences (N, J) along each axis, zero at the border."""
        if self.line:
            bend, slope = np.zeros(self.y.shape), np.diff(self.y, axis=1)
            np.subtract(slope[:, 1:], slope[:, :-1], out=bend[:, 1:-1])
            bend /= self.lattice.step**2
            return (bend,)
        return tuple(np.asarray(self.y @ second.T) for second in self.lattice.second)

    @property
    def line(self) -> bool:
        """Whether one parameter scatters, so that neighbors are next to each other."""
        return len(self.lattice.first) == 1

    @cached_property
    def _twists(self) -> dict[tuple[int, int], Array]:
        """H_ik for i < k, the differences one after the other."""
        return {
            (i, k): np.asarray(slope @ self.lattice.first[i].T)
            for k, slope in enumerate(self.slopes)
            for i in range(k)
        }
