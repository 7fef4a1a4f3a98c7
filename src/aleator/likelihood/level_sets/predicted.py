"""The distribution of outcomes without noise under a law, from simulated values at its points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.core.status import Status
from aleator.core.types import Array, Flags, Indices
from aleator.laws.classes import separated
from aleator.laws.inputs import Inputs, parameters_at
from aleator.likelihood.individual.rules import standard_points
from aleator.simulators.response_functions import ResponseFunction


@dataclass(frozen=True)
class PredictionPointSettings:
    """Settings for the points of a law at which outcomes are predicted; chosen by judgement.

    `points`: the usual number of points. `fewest`: the smallest number, for very many conditions.
    `values`: the largest number of simulated values for all conditions together. `coarse`: the
    number of points that gives a probability to a thousandth, for one and for two variates; for
    more variates it is `fewest`. `reach`: the largest standard normal variate of the lattice that
    is used for one or two variates. `wide`: with more than two variates, half of the points are
    spread wider by this factor, for the tails.
    """

    points: int = 8192
    fewest: int = 512
    values: int = 8_000_000
    coarse: tuple[int, int] = (401, 1681)
    reach: float = 7.0
    wide: float = 1.6


PREDICTION_POINTS = PredictionPointSettings()


@dataclass(frozen=True, eq=False)
class PredictedOutcomes:
    """The distributions of N outcomes: values (U, P) at P points of a law, with weights (P,).

    The values are those of U distinct conditions, and `condition` (N,) is the number of each
    experiment's condition. For one or two variates the points are a lattice with weights of the
    normal law, so that moments are exact to many digits. For more variates they are points of a
    Sobol' sequence, half of them spread wider than the law. The distribution function is linear
    between neighboring values; beyond the outermost values it is half of the tail probability
    there. A value that is NaN is left out. An infinite one counts in distribution functions and
    quantiles only.

    >>> values = np.array([[0.0, 1.0, 2.0]])
    >>> found = PredictedOutcomes(values, np.full(3, 1 / 3), np.array([0]))
    >>> found.cdf(np.array([1.0])).tolist(), found.quantile(np.array([0.5])).tolist()
    ([0.5], [[1.0]])
    """

    values: Array
    weights: Array
    condition: Indices

    @property
    def mean(self) -> Array:
        """The mean outcome (N,) of each experiment."""
        return self._mean[self.condition]

    @property
    def sd(self) -> Array:
        """The standard deviation (N,) of each experiment's outcome."""
        return self._sd[self.condition]

    @cached_property
    def standardized(self) -> Array:
        """The standardized moments (N, 5) of each outcome, of orders zero to four."""
        sd = np.where(self._sd > 0.0, self._sd, 1.0)
        third, fourth = self._central(3) / sd**3, self._central(4) / sd**4
        none, one = np.zeros_like(sd), np.ones_like(sd)
        return np.stack([one, none, one, third, fourth], axis=1)[self.condition]

    @property
    def status(self) -> NDArray[np.int64]:
        """The `Status` code (N,) of each experiment: solved if any simulated value is finite."""
        known = self._finite.any(axis=1)
        return np.where(known, int(Status.SOLVED), int(Status.DEGENERATE))[self.condition]

    def cdf(self, y: Array) -> Array:
        """The distribution functions P(outcome < y) at y (N,) or (N, G), with the shape of y."""
        found, order = np.empty(y.shape), np.argsort(self.condition, kind="stable")
        ends = np.cumsum(np.bincount(self.condition, minlength=len(self.values)))[:-1]
        each = zip(np.split(order, ends), *self._sorted, strict=True)
        for rows, value, level in each:
            beyond = 0.5 * level[0], 0.5 + 0.5 * level[-1]
            found[rows] = np.interp(y[rows], value, level, left=beyond[0], right=beyond[1])
        return found

    def quantile(self, p: ArrayLike) -> Array:
        """The quantiles (N, Q) of the outcomes at probabilities p (Q,)."""
        value, level = self._sorted
        pairs = zip(level, value, strict=True)
        each = np.array([np.interp(np.asarray(p, dtype=float), *pair) for pair in pairs])
        return each[self.condition]

    @cached_property
    def _mean(self) -> Array:
        return np.asarray(np.sum(self._share * self._known, axis=1))

    @cached_property
    def _sd(self) -> Array:
        return np.sqrt(self._central(2))

    def _central(self, order: int) -> Array:
        off = self._known - self._mean[:, None]
        return np.asarray(np.sum(self._share * off**order, axis=1))

    @cached_property
    def _finite(self) -> Flags:
        return np.isfinite(self.values)

    @cached_property
    def _known(self) -> Array:
        return np.where(self._finite, self.values, 0.0)

    @cached_property
    def _share(self) -> Array:
        share = np.where(self._finite, self.weights, 0.0)
        with np.errstate(invalid="ignore"):
            return np.asarray(share / share.sum(axis=1, keepdims=True))

    @cached_property
    def _sorted(self) -> tuple[Array, Array]:
        """The values (U, P) in rising order, and the probability up to the middle of each."""
        failed = np.isnan(self.values)
        values = np.where(failed, self._mean[:, None], self.values)
        order = np.argsort(values, axis=1)
        value = np.take_along_axis(values, order, axis=1)
        share = np.take_along_axis(np.where(failed, 0.0, self.weights), order, axis=1)
        with np.errstate(invalid="ignore"):
            share = share / share.sum(axis=1, keepdims=True)
        return value, np.cumsum(share, axis=1) - 0.5 * share


@dataclass(frozen=True, eq=False)
class PointPredictor:
    """Predicts the distributions of the outcomes of N experiments under a law alpha (K,).

    `response` is the simulator or its surfaces, for all distinct conditions. `condition` (N,) is
    the number of each experiment's condition. `lower` and `upper` (N,) are the smallest and the
    largest value of the response.
    """

    inputs: Inputs
    response: ResponseFunction
    condition: Indices
    lower: Array
    upper: Array
    points: int = PREDICTION_POINTS.points
    settings: PredictionPointSettings = PREDICTION_POINTS

    def coarse(self) -> PointPredictor:
        """This predictor with fewer points of the law, for the analysis of many data sets."""
        own, s = self.settings, self.inputs.scattering
        return replace(self, points=own.coarse[s - 1] if 1 <= s <= 2 else own.fewest)

    def under(self, alpha: Array) -> PredictedOutcomes:
        """The distributions of the outcomes under the law alpha (K,).

        Cost: the response at 8192 points of the law, or at fewer for very many conditions.
        """
        xi, weights = self._points
        parts = separated(self.inputs, alpha[: self.inputs.size])
        x = [parameters_at(*one[:2], xi[None], slice(0, 1), often=True)[0][0] for one in parts]
        every = np.concatenate([np.exp(log_share) * weights for *_, log_share in parts])
        return PredictedOutcomes(self.response.evaluate(np.concatenate(x)), every, self.condition)

    @cached_property
    def _points(self) -> tuple[Array, Array]:
        """The standard normal variates (P, s) of the points, and their weights (P,)."""
        own, s = self.settings, self.inputs.scattering
        conditions = int(self.condition.max()) + 1
        count = min(self.points, max(own.values // conditions, own.fewest))
        if not 1 <= s <= 2:
            xi = standard_points(count, s).copy()
            xi[count // 2 :] *= own.wide
            square = 0.5 * np.sum(xi**2, axis=1)
            wider = np.exp(square * (1.0 - own.wide**-2)) / own.wide**s
            weights = 1.0 / (0.5 + 0.5 * wider)
            return xi, weights / weights.sum()
        each = round(count ** (1.0 / s)) | 1
        t = np.linspace(-own.reach, own.reach, each)
        corners = np.meshgrid(*[t] * s, indexing="ij")
        xi = np.stack([corner.ravel() for corner in corners], axis=1)
        weights = np.exp(-0.5 * np.sum(xi**2, axis=1))
        return xi, weights / weights.sum()
