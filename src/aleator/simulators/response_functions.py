"""Outcomes of experiments as functions of the parameters, and their distributions under a law.

A `Run` computes outcomes for pairs of an experiment and a point of the parameters. A
`ResponseFunction` computes the outcomes of all experiments at the same points. The simulator itself
is one (`DirectResponse`), response surfaces are others, and both may be `Confined` to a region of
the parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.core.types import Array, Indices
from aleator.simulators.runner import Runner

Run = Callable[[Indices, Array], Array]
"""A function that returns outcomes (R,) of experiments index (R,), each at a point x (R, n)."""


class ResponseFunction(Protocol):
    """The outcomes of all N experiments as functions of the n parameters, at common points."""

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) of all N experiments at J points x (J, n)."""
        ...

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes (N, J) at points x (J, n), and their derivatives (N, J, n) by the parameters."""
        ...


@runtime_checkable
class Divisible(ResponseFunction, Protocol):
    """A response function that can also be evaluated for some of the experiments only.

    Each experiment may then have its own point of the parameters.
    """

    def take(self, rows: Indices) -> Divisible:
        """The response function of the experiments `rows` only, each at most once."""
        ...

    def at(self, index: Indices, x: Array) -> Array:
        """Outcomes (R,) of experiments index[r], each at its own point x[r], x (R, n)."""
        ...


class OutcomeDistribution(Protocol):
    """The distributions of the outcomes of N experiments under a law of the parameters."""

    @property
    def mean(self) -> Array:
        """The mean outcome of each experiment (N,)."""

    @property
    def sd(self) -> Array:
        """The standard deviation of the outcome of each experiment (N,)."""

    @property
    def standardized(self) -> Array:
        """Standardized moments (N, 5) of orders zero to four of each experiment's outcome."""

    @property
    def status(self) -> NDArray[np.int64]:
        """The `Status` code of the distribution of each experiment (N,)."""

    def cdf(self, y: Array) -> Array:
        """The probability of an outcome below y (N,) or (N, G), in the shape of y."""

    def quantile(self, p: ArrayLike) -> Array:
        """Quantiles (N, Q): outcomes that are not exceeded with probabilities p (Q,)."""


@dataclass(frozen=True)
class DirectResponse:
    """The simulator itself as a response function; gradients are central differences.

    `run(index (R,), x (R, n))` calls the simulator. The points of the differences stay inside `box`
    (n, 2), the range of each parameter. The step is `difference_step` times the standard deviation
    of the points. For a parameter that is constant over the points, the step is `difference_step`
    times `constant_spread` times the width of its range.
    """

    run: Run
    experiments: int
    box: Array
    difference_step: float = 1e-4
    constant_spread: float = 0.1

    def take(self, rows: Indices) -> DirectResponse:
        """The response function of the experiments `rows` only."""
        run = self.run
        return replace(self, run=lambda index, x: run(rows[index], x), experiments=rows.size)

    def at(self, index: Indices, x: Array) -> Array:
        """Outcomes (R,) of R runs, each of its own experiment and point."""
        return self.run(index, x)

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) of N experiments at J points, by N J runs."""
        index = np.repeat(np.arange(self.experiments), x.shape[0])
        outcome = self.run(index, np.tile(x, (self.experiments, 1)))
        return outcome.reshape(self.experiments, x.shape[0])

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes (N, J) at points x (J, n), and derivatives (N, J, n) by central differences.

        One call makes the N J (2 n + 1) runs. At the edge of the range of a parameter the step on
        that side is shorter.
        """
        count, n = x.shape
        # The spread of a constant is exactly zero here; np.std of equal numbers may not be.
        spread = np.where(np.ptp(x, axis=0) > 0.0, np.std(x, axis=0), 0.0)
        width = self.box[:, 1] - self.box[:, 0]
        step = self.difference_step * np.where(spread > 0.0, spread, self.constant_spread * width)
        moved = np.flatnonzero(step > 0.0)
        points, gaps = [x], []
        for i in moved:
            ends = []
            for sign in (1.0, -1.0):
                shifted = x.copy()
                # For a law without finite limits, a node may itself lie outside the box.
                low, high = np.minimum(x[:, i], self.box[i, 0]), np.maximum(x[:, i], self.box[i, 1])
                shifted[:, i] = np.clip(x[:, i] + sign * step[i], low, high)
                ends.append(shifted)
            gaps.append(ends[0][:, i] - ends[1][:, i])
            points += ends
        outcome = self.evaluate(np.concatenate(points))
        parts = outcome.reshape(self.experiments, 1 + 2 * len(moved), count)
        gradient = np.zeros((self.experiments, count, n))
        for k, i in enumerate(moved):
            gradient[:, :, i] = (parts[:, 1 + 2 * k] - parts[:, 2 + 2 * k]) / gaps[k]
        return parts[:, 0], gradient


def moving_parameters(region: Array) -> Indices:
    """Indices of the parameters whose range in `region` (n, 2) has a width; others are constant."""
    return np.flatnonzero(region[:, 1] > region[:, 0])


def completed(region: Array, x: Array) -> Array:
    """Points (R, n) of all parameters, from x (R, moving) of those that are not constant.

    A parameter is constant if its range in `region` (n, 2) has no width.
    """
    full = np.tile(region[:, 0], (len(x), 1))
    full[:, moving_parameters(region)] = x
    return full


@dataclass(frozen=True)
class Confined:
    """A response known only inside a region (n, 2); outside it has the value at the nearest point.

    A response surface is useless when extrapolated, and a search may begin far outside the region.
    An identified law is sound only if it stays inside. A parameter whose range has no width is
    constant: the inner response does not depend on it.
    """

    inner: Divisible
    region: Array

    def take(self, rows: Indices) -> Confined:
        """The confined response of the experiments `rows` only."""
        return Confined(self.inner.take(rows), self.region)

    @cached_property
    def moving(self) -> Indices:
        """The indices of the parameters on which the inner response depends."""
        return moving_parameters(self.region)

    def at(self, index: Indices, x: Array) -> Array:
        """Outcomes (R,) of experiments index[r] at points x[r], which are moved into the region."""
        return self.inner.at(index, self._inside(x)[:, self.moving])

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) at points x (J, n), which are moved into the region."""
        return self.inner.evaluate(self._inside(x)[:, self.moving])

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes (N, J) and derivatives (N, J, n) at points x (J, n), moved into the region.

        The derivative by a coordinate that had to be moved is zero.
        """
        inside = self._inside(x)
        value, slope = self.inner.evaluate_with_gradient(inside[:, self.moving])
        if self.moving.size == x.shape[1] and np.array_equal(inside, x):
            return value, slope
        full = np.zeros((*value.shape, x.shape[1]))
        full[:, :, self.moving] = slope
        return value, full * (inside == x)

    def _inside(self, x: Array) -> Array:
        return np.clip(x, self.region[:, 0], self.region[:, 1])


def by_calls(runner: Runner) -> Run:
    """A `Run` of the distinct conditions by calls of a runner; a failed run raises an error."""
    first = runner.cases.first
    return lambda index, x: runner(first[index], x)


def straight(runner: Runner, unit: Indices, column: Indices, infinite: bool = False) -> Run:
    """A `Run` whose runs are neither remembered nor stored; NaN where a run failed.

    Its index is the number of a simulated value: column `column[index]` of the run of unit
    `unit[index]`. An infinite value is NaN as well, unless `infinite` ones are asked for.
    """
    same = bool(np.all(column == column[0]))

    def run(index: Indices, x: Array) -> Array:
        values = runner.straight(unit[index], x)
        own = values[:, column[0]] if same else values[np.arange(len(x)), column[index]]
        return own if infinite else np.where(np.isfinite(own), own, np.nan)

    return run
