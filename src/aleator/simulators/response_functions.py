"""Outcomes of experiments as functions of the parameters, and their distributions under a law.

A `Run` gives the outcomes of pairs of an experiment and a point; a `ResponseFunction` those of all
experiments at the same points. The simulator itself is one (`DirectResponse`), surfaces are others,
and both may be `Confined` to a region.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.simulators.runner import Runner

Run = Callable[[Indices, Array], Array]
"""Outcomes (R,) of experiments index (R,), each at a point x (R, n) of its own."""


class ResponseFunction(Protocol):
    """Outcomes of all N experiments at the same points of the box."""

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) at points x (J, n)."""
        ...

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes (N, J) and their derivatives (N, J, n) at points x (J, n)."""
        ...


@runtime_checkable
class Divisible(ResponseFunction, Protocol):
    """A response that also gives outcomes of some experiments only, or of each at a point of its
    own."""

    def take(self, rows: Indices) -> Divisible:
        """The response of the experiments `rows`, each at most once."""
        ...

    def at(self, index: Indices, x: Array) -> Array:
        """Outcomes (R,) of experiments index[r], each at its own point x[r], x (R, n)."""
        ...


class OutcomeDistribution(Protocol):
    """The distributions of N outcomes under a law."""

    @property
    def mean(self) -> Array:
        """(N,)."""

    @property
    def sd(self) -> Array:
        """(N,)."""

    @property
    def standardized(self) -> Array:
        """Standardized moments (N, 5) of orders zero to four."""

    @property
    def status(self) -> NDArray[np.int64]:
        """(N,) `Status` codes."""

    def cdf(self, y: Array) -> Array:
        """P(outcome < y) at y (N,) or (N, G), of the same shape."""

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, Q) that are not exceeded with probabilities p (Q,)."""


@dataclass(frozen=True)
class DirectResponse:
    """The simulator itself: every call runs it, gradients by central differences.

    `run(index (R,), x (R, n))` runs it, `box` (n, 2) keeps the differences inside.
    A difference is `difference_step` times the spread of the points, for which a constant has
    `constant_spread` times the width of its box.
    """

    run: Run
    experiments: int
    box: Array
    difference_step: float = 1e-4
    constant_spread: float = 0.1

    def take(self, rows: Indices) -> DirectResponse:
        """The simulator of the experiments `rows`."""
        run = self.run
        return replace(self, run=lambda index, x: run(rows[index], x), experiments=rows.size)

    def at(self, index: Indices, x: Array) -> Array:
        """Outcomes (R,) of R runs."""
        return self.run(index, x)

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) of N J runs."""
        index = np.repeat(np.arange(self.experiments), x.shape[0])
        outcome = self.run(index, np.tile(x, (self.experiments, 1)))
        return outcome.reshape(self.experiments, x.shape[0])

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes and central differences, from N J (2 n + 1) runs in one call.

        The step is relative to the spread of the points, or to the box of a constant; where it
        would leave the box the point moves less far on that side.
        """
        count, n = x.shape
        # exactly zero for a constant, which np.std of equal numbers is not
        spread = np.where(np.ptp(x, axis=0) > 0.0, np.std(x, axis=0), 0.0)
        width = self.box[:, 1] - self.box[:, 0]
        step = self.difference_step * np.where(spread > 0.0, spread, self.constant_spread * width)
        moved = np.flatnonzero(step > 0.0)
        points, gaps = [x], []
        for i in moved:
            ends = []
            for sign in (1.0, -1.0):
                shifted = x.copy()
                # a node of a rule with many nodes may itself lie beyond the box of an open law
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
    """Indices of the parameters whose region (n, 2) has a width; the others are known."""
    return np.flatnonzero(region[:, 1] > region[:, 0])


def completed(region: Array, x: Array) -> Array:
    """Parameters (R, n): x (R, moving) of those whose region (n, 2) has a width, and the others."""
    full = np.tile(region[:, 0], (len(x), 1))
    full[:, moving_parameters(region)] = x
    return full


@dataclass(frozen=True)
class Confined:
    """A response known only inside a region (n, 2): outside, the value at its nearest point.

    Surfaces explode when extrapolated; a search that is still far away must not see that. An
    answer is sound only if its law stays inside. A parameter whose region has no width is
    known: the inner response is one of the others alone.
    """

    inner: Divisible
    region: Array

    def take(self, rows: Indices) -> Confined:
        """The response of the experiments `rows`."""
        return Confined(self.inner.take(rows), self.region)

    @cached_property
    def moving(self) -> Indices:
        """The parameters that the inner response takes."""
        return moving_parameters(self.region)

    def at(self, index: Indices, x: Array) -> Array:
        """Outcomes (R,) of experiments index[r] at points x[r] moved into the region."""
        return self.inner.at(index, self._inside(x)[:, self.moving])

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) at points x (J, n) moved into the region."""
        return self.inner.evaluate(self._inside(x)[:, self.moving])

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes and derivatives; the derivative by a coordinate that was moved is zero."""
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
    """`run(index (R,), x (R, n)) -> (R,)` of the distinct conditions; a run that fails raises."""
    first = runner.cases.first
    return lambda index, x: runner(first[index], x)


def straight(runner: Runner) -> Run:
    """Outcomes (R,) of the distinct conditions, by runs that are neither remembered nor stored; NaN
    where a run has no finite value."""
    first = runner.cases.first

    def run(index: Indices, x: Array) -> Array:
        values = runner.straight(first[index], x)[:, 0]
        return np.where(np.isfinite(values), values, np.nan)

    return run


def attempts(runner: Runner, region: Array) -> Run:
    """`run(index (R,), x (R, moving)) -> (R,)` of the distinct conditions, NaN where it fails.

    Of the parameters whose region (n, 2) has a width; the others are known. Raises InputsError
    where all are.
    """
    if moving_parameters(region).size == 0:
        raise InputsError(
            "every parameter is known: there is nothing to identify but noise",
            "free a hyperparameter, or give a parameter a law",
        )
    first = runner.cases.first
    return lambda index, x: runner.attempt(first[index], completed(region, x))
