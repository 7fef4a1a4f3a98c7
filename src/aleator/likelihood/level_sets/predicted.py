"""What an outcome without noise would be under a law: its values at points of the law."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.core.status import Status
from aleator.core.types import Array, Flags, Indices
from aleator.laws.inputs import Inputs, parameters_at
from aleator.likelihood.individual.rules import standard_points
from aleator.simulators.response_functions import ResponseFunction


@dataclass(frozen=True)
class PredictionPointSettings:
    """At how many points of a law outcomes are predicted, and where; chosen by judgement.

    `points`: points of the law. `fewest`: points at least, of very many conditions. `values`:
    simulated values of all conditions together. `coarse`: points that give a probability to a
    thousandth, of one and of two variates; of more it is `fewest`. `reach`: standard normal
    variates to which a lattice goes. `wide`: so many times farther out lies half of the points of
    more variates than two, for the tails.
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
    """The distributions of N outcomes: values (U, P) with weights (P,) of the points of a law.

    They are those of U distinct conditions; `condition` (N,) says which each experiment has.

    A lattice with the weights of the normal law for one variate or two, so that moments are exact
    to many digits; else points of a Sobol' sequence, half of the law and half farther out. Between
    neighbouring values probability is linear; beyond all of them it is half of what there is beyond
    the last. A value that is not finite counts as none.

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
        """(N,)."""
        return self._mean[self.condition]

    @property
    def sd(self) -> Array:
        """(N,)."""
        return self._sd[self.condition]

    @cached_property
    def standardized(self) -> Array:
        """Standardized moments (N, 5) of orders zero to four."""
        sd = np.where(self._sd > 0.0, self._sd, 1.0)
        third, fourth = self._central(3) / sd**3, self._central(4) / sd**4
        none, one = np.zeros_like(sd), np.ones_like(sd)
        return np.stack([one, none, one, third, fourth], axis=1)[self.condition]

    @property
    def status(self) -> NDArray[np.int64]:
        """(N,) `Status` codes: solved where there is any value."""
        known = self._finite.any(axis=1)
        return np.where(known, int(Status.SOLVED), int(Status.DEGENERATE))[self.condition]

    def cdf(self, y: Array) -> Array:
        """P(outcome < y) at y (N,) or (N, G), of the same shape."""
        found, order = np.empty(y.shape), np.argsort(self.condition, kind="stable")
        ends = np.cumsum(np.bincount(self.condition, minlength=len(self.values)))[:-1]
        each = zip(np.split(order, ends), *self._sorted, strict=True)
        for rows, value, level in each:
            beyond = 0.5 * level[0], 0.5 + 0.5 * level[-1]
            found[rows] = np.interp(y[rows], value, level, left=beyond[0], right=beyond[1])
        return found

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, Q) that are not exceeded with probabilities p (Q,)."""
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
        """Values in order, and the probability below the middle of each."""
        values = np.where(self._finite, self.values, self._mean[:, None])
        order = np.argsort(values, axis=1)
        value = np.take_along_axis(values, order, axis=1)
        share = np.take_along_axis(self._share, order, axis=1)
        return value, np.cumsum(share, axis=1) - 0.5 * share


@dataclass(frozen=True, eq=False)
class PointPredictor:
    """From a law alpha (K,) to the outcomes of N experiments under it.

    `response` is that of the distinct conditions, and `condition` (N,) are those of the
    experiments; `lower` and `upper` (N,) are the ends of what the response reaches.
    """

    inputs: Inputs
    response: ResponseFunction
    condition: Indices
    lower: Array
    upper: Array
    points: int = PREDICTION_POINTS.points
    settings: PredictionPointSettings = PREDICTION_POINTS

    def coarse(self) -> PointPredictor:
        """By as few points of the law as serve for many data sets."""
        own, s = self.settings, self.inputs.scattering
        return replace(self, points=own.coarse[s - 1] if 1 <= s <= 2 else own.fewest)

    def under(self, alpha: Array) -> PredictedOutcomes:
        """Their distributions. Cost: the response at 8192 points of the law, fewer of very many."""
        xi, weights = self._points
        law = alpha[: self.inputs.size]
        x = parameters_at(self.inputs, law, xi[None], slice(0, 1), often=True)[0][0]
        return PredictedOutcomes(self.response.evaluate(x), weights, self.condition)

    @cached_property
    def _points(self) -> tuple[Array, Array]:
        """Variates (P, s) and their weights (P,)."""
        own, s = self.settings, self.inputs.scattering
        conditions = int(self.condition.max()) + 1
        count = min(self.points, max(own.values // conditions, own.fewest))
        if not 1 <= s <= 2:
            xi = standard_points(count, s)
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
