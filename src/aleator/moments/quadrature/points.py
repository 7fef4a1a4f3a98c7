"""Points of the law with equal weights: Sobol', random, and on a grid of probabilities."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.errors import InputsError
from aleator.laws import Inputs
from aleator.moments.quadrature.interface import MOST_NODES, affordable, check_whole
from aleator.moments.quadrature.nodes import Nodes
from aleator.polynomials import tensor
from aleator.types import Array

SOBOL_BITS = 30


@dataclass(frozen=True)
class SobolPoints:
    """Scrambled Sobol' points of standard normal variates, mapped by the laws; equal weights.

    theta = Phi^-1(u) for points u of (0, 1)^d that do not depend on alpha (Sobol', 1967; Owen,
    1998), so that every average is smooth in alpha and its derivative exact. `points` J is a power
    of two from 2 to 2^20, `seed` chooses the scrambling: other seeds show the error.
    Raises InputsError for other sizes.

    >>> from aleator.laws import Normal
    >>> rule = SobolPoints(1024).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([3.0, 2.0]))
    >>> bool(abs(rule.weights @ rule.x[:, 0] - 3.0) < 1e-3)
    True
    """

    points: int
    seed: int = 0

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        check_whole("points", self.points, 2, 2**20)
        check_whole("seed", self.seed, 0, None)
        if self.points & (self.points - 1):
            below = 1 << (int(self.points).bit_length() - 1)
            raise InputsError(
                f"{self.points} Sobol' points lose the balance that powers of two have",
                f"use {below} or {2 * below}",
            )

    def nodes(self, inputs: Inputs, alpha: Array) -> Nodes:
        """The points at alpha. Cost O(J n K)."""
        return _equal(inputs, alpha, _sobol_variates(self.points, inputs.scattering, self.seed))


@dataclass(frozen=True)
class MonteCarloPoints:
    """Independent standard normal variates, drawn once, mapped by the laws; equal weights.

    The error falls with J^(-1/2) whatever the outcome; here to compare with. `points` J from 2 to
    1e6. Raises InputsError beyond that.

    >>> from aleator.laws import Normal
    >>> rule = MonteCarloPoints(4096).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([3.0, 2.0]))
    >>> bool(abs(rule.weights @ rule.x[:, 0] - 3.0) < 4 * 2.0 / 64)
    True
    """

    points: int
    seed: int = 0

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        check_whole("points", self.points, 2, MOST_NODES)
        check_whole("seed", self.seed, 0, None)

    def nodes(self, inputs: Inputs, alpha: Array) -> Nodes:
        """The points at alpha. Cost O(J n K)."""
        return _equal(inputs, alpha, _random_variates(self.points, inputs.scattering, self.seed))


@dataclass(frozen=True)
class ProbabilityGrid:
    """A regular grid in probability, (i + 1/2)/m in each dimension, with equal weights.

    The paper's quasi-Monte Carlo: J = m^d. Misses the tails, whose share of a moment vanishes only
    slowly with m. `per_dimension` m from 1 to 10^4. Raises InputsError beyond that, and where J is
    above 1e6.

    >>> from aleator.laws import Normal
    >>> rule = ProbabilityGrid(2).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([0.0, 1.0]))
    >>> rule.x[:, 0].round(4).tolist(), rule.weights.tolist()
    ([-0.6745, 0.6745], [0.5, 0.5])
    """

    per_dimension: int

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        check_whole("per_dimension", self.per_dimension, 1, 10_000)

    def nodes(self, inputs: Inputs, alpha: Array) -> Nodes:
        """The grid at alpha. Cost O(J n K)."""
        affordable(self.per_dimension**inputs.scattering)
        return _equal(inputs, alpha, _grid_variates(self.per_dimension, inputs.scattering))


def _equal(inputs: Inputs, alpha: Array, xi: Array) -> Nodes:
    x, dx = inputs.image(alpha, xi)
    count = xi.shape[0]
    return Nodes(x, np.full(count, 1.0 / count), dx, np.zeros((count, inputs.size)))


@lru_cache(maxsize=16)
def _sobol_variates(points: int, dimensions: int, seed: int) -> Array:
    if not dimensions:
        return np.zeros((1, 0))
    engine = qmc.Sobol(dimensions, bits=SOBOL_BITS, rng=np.random.default_rng(seed))
    # the points are multiples of 2^-bits, zero among them: half a step keeps them inside
    return _frozen(special.ndtri(engine.random(points) + 0.5 ** (SOBOL_BITS + 1)))


@lru_cache(maxsize=16)
def _random_variates(points: int, dimensions: int, seed: int) -> Array:
    if not dimensions:
        return np.zeros((1, 0))
    return _frozen(np.random.default_rng(seed).standard_normal((points, dimensions)))


@lru_cache(maxsize=16)
def _grid_variates(per_dimension: int, dimensions: int) -> Array:
    if not dimensions:
        return np.zeros((1, 0))
    middles = special.ndtri((np.arange(per_dimension) + 0.5) / per_dimension)
    return _frozen(middles[tensor((per_dimension,) * dimensions)])


def _frozen(xi: Array) -> Array:
    xi.setflags(write=False)
    return xi
