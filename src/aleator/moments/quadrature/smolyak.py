"""Sparse grids of the laws' own Gauss rules."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np

from aleator.laws import Inputs, Rule
from aleator.moments.quadrature.interface import affordable, check_whole
from aleator.moments.quadrature.nodes import Nodes, axes, combined
from aleator.polynomials import tensor
from aleator.types import Array, Indices

ALIKE = 1e-12
"""Nodes of one parameter closer than this, in the variable of its polynomials, are one."""


@dataclass(frozen=True)
class Smolyak:
    """A sparse grid of the laws' own Gauss rules (Smolyak, 1963), by the combination technique.

    sum over l with L - d < |l| <= L of (-1)^(L - |l|) C(d - 1, L - |l|) U_l1 x ... x U_ld, where
    U_l is the Gauss rule of l + 1 nodes (Gerstner and Griebel, 1998; linear growth). Exact for
    monomials with sum_i floor(k_i / 2) <= L, hence to total degree 2L + 1; not for x_i^(2L + 2).
    Nodes that rules of fixed nodes share, such as the middle of normal laws, are merged.
    `level` L from 0 to 20. Raises InputsError beyond that, and where there are above 1e6 nodes.

    Some weights are negative: a variance or another even moment can come out negative for an
    outcome that is not smooth at this level, and a density of such moments has no solution.

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
        """Check at once, so that the mistake is reported where it was made."""
        check_whole("level", self.level, 0, 20)

    def nodes(self, inputs: Inputs, alpha: Array) -> Nodes:
        """The rule at alpha. Cost O(J n K), besides the grid, which is made once."""
        # before merging: the coefficients of t^0..t^L in (sum_l (l + 1) t^l)^d = (1 - t)^(-2d)
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
        return Nodes(every.x[grid.first], weights, every.dx[grid.first], dweights)


@dataclass(frozen=True)
class _Grid:
    """The tensor grids of a sparse grid one after the other (E nodes), merged into J nodes.

    `picks` (E, n) into each parameter's stack of rules, `factor` (E,) of the combination, `node`
    (E,) which of the J it is, and `first` (J,) one of the E for each.
    """

    picks: Indices
    factor: Array
    node: Indices
    first: Indices


@lru_cache(maxsize=8)
def _grid(level: int, identities: tuple[tuple[int, ...], ...]) -> _Grid:
    """Combine the stacks: rule l of a stack begins at l (l + 1)/2; a constant's stack has one."""
    moving = [i for i, identity in enumerate(identities) if len(identity) > 1]
    if not moving:
        zero = np.zeros((1, len(identities)), dtype=np.intp)
        return _Grid(zero, np.ones(1), zero[:, 0], zero[:, 0])
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
    return _Grid(chosen, np.concatenate(factors), node.reshape(-1), first)


def _levels(dimensions: int, total: int) -> list[tuple[int, ...]]:
    """Every tuple of that many levels with a sum of at most total."""
    if dimensions == 1:
        return [(l,) for l in range(total + 1)]
    return [(l, *rest) for l in range(total + 1) for rest in _levels(dimensions - 1, total - l)]


def _stacked(rules: list[Rule]) -> Rule:
    """Rules of one parameter one after the other."""
    return Rule(
        np.concatenate([rule.x for rule in rules]),
        np.concatenate([rule.weights for rule in rules]),
        np.concatenate([rule.t for rule in rules]),
        np.concatenate([rule.dx for rule in rules]),
        np.concatenate([rule.dweights for rule in rules]),
    )


def _identity(stack: Rule) -> tuple[int, ...]:
    """For each node of a stack the first one that it is equal to, whatever alpha is.

    Equal t are equal nodes where the law maps a t that does not depend on alpha, as is seen
    by weights without derivative; other laws' nodes may meet at one alpha but part at the next.
    """
    own = np.arange(stack.x.size)
    if np.any(stack.dweights):
        return tuple(own.tolist())
    near = np.abs(stack.t[:, None] - stack.t[None, :]) <= ALIKE
    return tuple(np.argmax(near, axis=1).tolist())
