"""Nodes and weights of the joint law, by which averages over it are computed.

Each choice turns a joint law at alpha into `CubatureNodes`. The derivatives by alpha are those of
the computed sum itself, so that a weighted sum over the nodes has an exact gradient however coarse
the rule is. A Gauss rule is exact for polynomials of x if the law has orthogonal polynomials of x.
For other laws (the lognormal one, and those of correlated parameters) it is exact for polynomials
of the standard normal variate.

| choice | nodes for d scattering parameters | error for a smooth outcome |
|---|---|---|
| `TensorGauss(q)` | q^d | geometric in q; exact to degree 2q - 1 in each parameter |
| `Smolyak(L)` | about (2d)^L / L! | exact to total degree 2L + 1; some weights are negative |
| `SobolPoints(J)` | J | about J^-1 and better, any d |
| `MonteCarloPoints(J)` | J | J^-1/2, any d |
| `ProbabilityGrid(m)` | m^d | m^-1 where the outcome is unbounded; the paper's |
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from math import comb
from typing import Protocol

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.core.polynomials import tensor
from aleator.core.threads import single_threaded
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.laws import Inputs, Rule
from aleator.laws.inputs import zeros


@dataclass(frozen=True)
class CubatureNodes:
    """A cubature rule of J nodes in n parameters with K hyperparameters.

    `x` (J, n) are the nodes, and `weights` (J,) sum to one. `dx` (J, n, K) and `dweights` (J, K)
    are their derivatives by alpha; each `dx[:, i, k]` is one piece of memory.
    """

    x: Array
    weights: Array
    dx: Array
    dweights: Array


def axes(inputs: Inputs, alpha: Array, per_dimension: int) -> list[Rule]:
    """A Gauss rule for each of the n parameters; their product is a rule of the joint law.

    A constant has one node. A correlated parameter has the rule of its standard normal variate.
    """
    laws, values = inputs.independent(alpha)
    rules = [law.rule(v, per_dimension) for law, v in zip(laws, values, strict=True)]
    for i in inputs.correlated:
        own = np.zeros((per_dimension, inputs.slices[i].stop - inputs.slices[i].start))
        rules[i] = Rule(rules[i].x, rules[i].weights, rules[i].t, own, own)
    return rules


@single_threaded
def combined(inputs: Inputs, alpha: Array, rules: Sequence[Rule], picks: Indices) -> CubatureNodes:
    """Nodes of the joint law, each made of one node of every parameter's rule.

    `picks` (J, n) are the indices of these nodes. Weights are products of the rules' weights. Cost
    O(J n K).
    """
    count, n = picks.shape
    x, dx = zeros(count, n, inputs.size)
    weights, dweights = np.ones(count), np.zeros((count, inputs.size))
    factors = [rule.weights[picks[:, i]] for i, rule in enumerate(rules)]
    for i, (rule, part) in enumerate(zip(rules, inputs.slices, strict=True)):
        x[:, i] = rule.x[picks[:, i]]
        dx[:, i, part] = rule.dx[picks[:, i]]
        weights *= factors[i]
        if np.any(rule.dweights):
            others = np.prod([np.ones(count), *factors[:i], *factors[i + 1 :]], axis=0)
            dweights[:, part] = others[:, None] * rule.dweights[picks[:, i]]
    if inputs.correlated:
        tied = list(inputs.correlated)
        x[:, tied], dx[:, tied] = inputs.tied(alpha, x[:, tied])
    return CubatureNodes(x, weights, dx, dweights)


class Cubature(Protocol):
    """The interface of a choice of quadrature nodes for the joint law."""

    def nodes(self, inputs: Inputs, alpha: Array) -> CubatureNodes:
        """The nodes and weights of the law alpha (K,), with their derivatives by alpha."""


def check_whole(name: str, value: int, lower: int, upper: int | None) -> None:
    """Raise InputsError unless the value is a whole number within its limits."""
    if type(value) is not int or value < lower or (upper is not None and value > upper):
        limits = f"between {lower} and {upper}" if upper is not None else f"of at least {lower}"
        raise InputsError(
            f"{name} = {value!r} is not a whole number {limits}", "choose one in that range"
        )


def affordable(count: int, most: int = 10**6) -> None:
    """Raise InputsError where a rule has more nodes than fit into memory."""
    if count > most:
        raise InputsError(
            f"this rule has {count:.3g} nodes, more than {most:.0e}",
            "use fewer nodes a dimension, Smolyak(level) or SobolPoints(points)",
        )


@dataclass(frozen=True)
class TensorGauss:
    """The tensor product of the laws' Gauss rules (paper, eq. (quadrature)).

    It has J = per_dimension^d nodes for d scattering parameters, and is exact for polynomials of
    degree 2 per_dimension - 1 in each of them. `per_dimension` is from 1 to 100. Raises InputsError
    beyond that, and where J is above 1e6.

    >>> import numpy as np
    >>> from aleator.laws import Normal
    >>> rule = TensorGauss(3).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([0.0, 1.0]))
    >>> round(float(rule.weights @ rule.x[:, 0] ** 4), 9)
    3.0
    """

    per_dimension: int

    def __post_init__(self) -> None:
        check_whole("per_dimension", self.per_dimension, 1, 100)

    def nodes(self, inputs: Inputs, alpha: Array) -> CubatureNodes:
        """The nodes and weights at alpha. Cost O(J n K)."""
        affordable(self.per_dimension**inputs.scattering)
        rules = axes(inputs, alpha, self.per_dimension)
        return combined(inputs, alpha, rules, tensor(tuple(rule.x.size for rule in rules)))


class _EqualWeights(ABC):
    """Base class of choices with equal weights and standard normal variates fixed in advance."""

    @abstractmethod
    def _variates(self, dimensions: int) -> Array:
        """Standard normal variates (J, dimensions)."""

    def nodes(self, inputs: Inputs, alpha: Array) -> CubatureNodes:
        """The points at alpha, with equal weights. Cost O(J n K)."""
        xi = self._variates(inputs.scattering) if inputs.scattering else np.zeros((1, 0))
        x, dx = inputs.image(alpha, xi)
        count = len(xi)
        return CubatureNodes(x, np.full(count, 1.0 / count), dx, np.zeros((count, inputs.size)))


@dataclass(frozen=True)
class SobolPoints(_EqualWeights):
    """Scrambled Sobol' points of standard normal variates, mapped by the laws; equal weights.

    theta = Phi^-1(u) for points u in (0, 1)^d that do not depend on alpha (Sobol', 1967; Owen,
    1998), so that every average is smooth in alpha and its derivative exact. `points` is the number
    J of points, a power of two from 2 to 2^20; raises InputsError for other numbers. `seed` chooses
    the scrambling; the differences between seeds show the error.

    >>> from aleator.laws import Normal
    >>> rule = SobolPoints(1024).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([3.0, 2.0]))
    >>> bool(abs(rule.weights @ rule.x[:, 0] - 3.0) < 1e-3)
    True
    """

    points: int
    seed: int = 0

    def __post_init__(self) -> None:
        check_whole("points", self.points, 2, 2**20)
        check_whole("seed", self.seed, 0, None)
        if self.points & (self.points - 1):
            below = 1 << (int(self.points).bit_length() - 1)
            raise InputsError(
                f"{self.points} Sobol' points lose the balance that powers of two have",
                f"use {below} or {2 * below}",
            )

    def _variates(self, dimensions: int) -> Array:
        return _sobol_variates(self.points, dimensions, self.seed)


@dataclass(frozen=True)
class MonteCarloPoints(_EqualWeights):
    """Independent standard normal variates, drawn once, mapped by the laws; equal weights.

    The error falls as J^(-1/2) for any outcome; the rule is here for comparison. `points` is the
    number J of points, from 2 to 1e6. Raises InputsError beyond that.

    >>> from aleator.laws import Normal
    >>> rule = MonteCarloPoints(4096).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([3.0, 2.0]))
    >>> bool(abs(rule.weights @ rule.x[:, 0] - 3.0) < 4 * 2.0 / 64)
    True
    """

    points: int
    seed: int = 0

    def __post_init__(self) -> None:
        check_whole("points", self.points, 2, 10**6)
        check_whole("seed", self.seed, 0, None)

    def _variates(self, dimensions: int) -> Array:
        return _random_variates(self.points, dimensions, self.seed)


@dataclass(frozen=True)
class ProbabilityGrid(_EqualWeights):
    """A regular grid in probability, (i + 1/2)/m in each dimension, with equal weights.

    This is the paper's quasi-Monte Carlo rule with J = m^d nodes. It misses the tails, whose part
    of a moment vanishes only slowly with m. `per_dimension` is m, from 1 to 10^4. Raises
    InputsError beyond that, and where J is above 1e6.

    >>> from aleator.laws import Normal
    >>> rule = ProbabilityGrid(2).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([0.0, 1.0]))
    >>> rule.x[:, 0].round(4).tolist(), rule.weights.tolist()
    ([-0.6745, 0.6745], [0.5, 0.5])
    """

    per_dimension: int

    def __post_init__(self) -> None:
        check_whole("per_dimension", self.per_dimension, 1, 10_000)

    def _variates(self, dimensions: int) -> Array:
        affordable(self.per_dimension**dimensions)
        return _grid_variates(self.per_dimension, dimensions)


@lru_cache(maxsize=16)
def _sobol_variates(points: int, dimensions: int, seed: int, bits: int = 30) -> Array:
    engine = qmc.Sobol(dimensions, bits=bits, rng=np.random.default_rng(seed))
    # The points are multiples of 2^-bits and include zero. Half a step keeps them inside (0, 1).
    return _frozen(special.ndtri(engine.random(points) + 0.5 ** (bits + 1)))


@lru_cache(maxsize=16)
def _random_variates(points: int, dimensions: int, seed: int) -> Array:
    return _frozen(np.random.default_rng(seed).standard_normal((points, dimensions)))


@lru_cache(maxsize=16)
def _grid_variates(per_dimension: int, dimensions: int) -> Array:
    middles = special.ndtri((np.arange(per_dimension) + 0.5) / per_dimension)
    return _frozen(middles[tensor((per_dimension,) * dimensions)])


def _frozen(xi: Array) -> Array:
    xi.setflags(write=False)
    return xi


@dataclass(frozen=True)
class Smolyak:
    """A sparse grid of the laws' own Gauss rules (Smolyak, 1963), by the combination technique.

    The rule is the sum over l with L - d < |l| <= L of
    (-1)^(L - |l|) C(d - 1, L - |l|) U_l1 x ... x U_ld, where U_l is the Gauss rule of l + 1 nodes
    (Gerstner and Griebel, 1998; linear growth). It is exact for monomials with
    sum_i floor(k_i / 2) <= L, hence to total degree 2L + 1, but not for x_i^(2L + 2). Nodes that
    several of the rules have in common, such as the middle of a normal law, are merged. `level` is
    L, from 0 to 20. Raises InputsError beyond that, and where there are more than 1e6 nodes.

    Some weights are negative. For an outcome that is not smooth enough for this level, a variance
    or another even moment can therefore be negative, and no density has such moments.

    >>> from aleator.laws import Normal
    >>> inputs = Inputs({name: Normal(0.0, 1.0) for name in "abcdefgh"})
    >>> alpha = np.tile([0.0, 1.0], 8)
    >>> rule = Smolyak(2).nodes(inputs, alpha)
    >>> rule.weights.size                               # a tensor rule of 3 nodes has 6561
    145
    >>> round(float(rule.weights @ (rule.x[:, 0] * rule.x[:, 1]) ** 2), 9)
    1.0
    """

    level: int

    def __post_init__(self) -> None:
        check_whole("level", self.level, 0, 20)

    def nodes(self, inputs: Inputs, alpha: Array) -> CubatureNodes:
        """The nodes and weights at alpha. Cost O(J n K), and once the cost of making the grid."""
        # The number of nodes before merging is at most the sum of the coefficients of t^0 to t^L
        # in (sum_l (l + 1) t^l)^d = (1 - t)^(-2d).
        affordable(comb(2 * inputs.scattering + self.level, self.level))
        levels = [axes(inputs, alpha, q) for q in range(1, self.level + 2)]
        stacks = [
            _stacked([rules[i] for rules in levels] if scatters else [levels[0][i]])
            for i, scatters in enumerate(law.scatters for law in inputs.laws.values())
        ]
        grid = _grid(self.level, tuple(_identity(stack) for stack in stacks))
        every = combined(inputs, alpha, stacks, grid.picks)
        weights = np.asarray(np.bincount(grid.node, grid.factor * every.weights), dtype=float)
        dweights = np.zeros((weights.size, inputs.size))
        for k in np.flatnonzero(np.any(every.dweights, axis=0)):
            dweights[:, k] = np.bincount(grid.node, grid.factor * every.dweights[:, k])
        return CubatureNodes(every.x[grid.first], weights, every.dx[grid.first], dweights)


@dataclass(frozen=True)
class _GridRule:
    """The E nodes of all tensor grids of a sparse grid, and their merging into J distinct nodes.

    `picks` (E, n) are indices into the concatenated rules of each parameter, and `factor` (E,) are
    the factors of the combination. `node` (E,) is the number of the distinct node, and `first` (J,)
    is one of the E nodes for each distinct one.
    """

    picks: Indices
    factor: Array
    node: Indices
    first: Indices


@lru_cache
def _grid(level: int, identities: tuple[tuple[int, ...], ...]) -> _GridRule:
    """The sparse grid of this level for parameters whose Gauss rules are concatenated.

    In the concatenation (a "stack") rule l begins at l (l + 1)/2; the stack of a constant has one
    node. `identities` are the equal nodes of each stack (see `_identity`).
    """
    moving = [i for i, identity in enumerate(identities) if len(identity) > 1]
    if not moving:
        zero = np.zeros((1, len(identities)), dtype=np.intp)
        return _GridRule(zero, np.ones(1), zero[:, 0], zero[:, 0])
    picks, factors = [], []
    for levels in _levels(len(moving), level):
        left = level - sum(levels)
        if left >= len(moving):
            continue
        sizes = [1] * len(identities)
        begin = np.zeros(len(identities), dtype=np.intp)
        for i, l in zip(moving, levels, strict=True):
            sizes[i], begin[i] = l + 1, l * (l + 1) // 2
        picks.append(tensor(tuple(sizes)) + begin)
        sign = (-1.0) ** left * comb(len(moving) - 1, left)
        factors.append(np.full(picks[-1].shape[0], sign))
    chosen = np.concatenate(picks)
    ids = np.stack([np.array(identity)[chosen[:, i]] for i, identity in enumerate(identities)], 1)
    _, first, node = np.unique(ids, axis=0, return_index=True, return_inverse=True)
    return _GridRule(chosen, np.concatenate(factors), node.reshape(-1), first)


def _levels(dimensions: int, total: int) -> list[tuple[int, ...]]:
    """All tuples of levels, one for each dimension, whose sum is at most `total`."""
    if dimensions == 1:
        return [(l,) for l in range(total + 1)]
    return [(l, *rest) for l in range(total + 1) for rest in _levels(dimensions - 1, total - l)]


def _stacked(rules: list[Rule]) -> Rule:
    """One rule with the concatenated nodes of several rules of one parameter (a "stack")."""
    parts = ([getattr(rule, field.name) for rule in rules] for field in fields(Rule))
    return Rule(*(np.concatenate(part) for part in parts))


def _identity(stack: Rule) -> tuple[int, ...]:
    """For each node of a stack, the first node that it equals for every alpha.

    Nodes with equal t are equal for every alpha if t does not depend on alpha; this is the case if
    the weights have no derivative. Nodes of other laws may coincide at one alpha and differ at the
    next, so that none are merged. Nodes closer than 1e-12 in t differ only by rounding.
    """
    own = np.arange(stack.x.size)
    if np.any(stack.dweights):
        return tuple(own.tolist())
    near = np.abs(stack.t[:, None] - stack.t[None, :]) <= 1e-12
    return tuple(np.argmax(near, axis=1).tolist())
