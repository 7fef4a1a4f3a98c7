"""Where the simulator is to be run for an expansion, and how such points are drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from aleator.errors import InputsError
from aleator.moments.expansion.basis import Basis
from aleator.types import Array, Indices

FINE = 40
"""Nodes of the Gauss rule that stands for a marginal law where points are drawn: it integrates
the square of a polynomial of degree 39 exactly, so that polynomials stay orthonormal on it."""


@dataclass(frozen=True, eq=False)
class Design:
    """J points at which each experiment is to be run.

    `t` (J, n) are the points in the variables of the polynomials, `x` (J, n) the variables of
    the basis, which are the parameters where none is correlated, and `weights` (J,) make
    sum_j weights_j f(x_j) an estimate of E f.
    """

    t: Array
    x: Array
    weights: Array

    def __post_init__(self) -> None:
        """Nobody may move a point after its runs."""
        for array in (self.t, self.x, self.weights):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.weights)


def induced(basis: Basis, indices: Indices, runs: int, seed: int) -> Design:
    """`runs` points from the distribution that a set of P polynomials induces.

    Density (1/P) sum_k psi_k(theta)^2 of the law, weights P / sum_k psi_k(theta)^2 / runs: least
    squares on P log P such points are as good as projection, for any law and any set (Cohen and
    Migliorati, SMAI J. Comput. Math. 3 (2017); sampled coordinate by coordinate as Narayan, SIAM
    J. Sci. Comput. 40 (2018) has it). The random numbers are a randomly shifted sequence of Sobol',
    so that a design of fewer runs is the beginning of one of more. Raises InputsError for less
    than one run or a degree above 39. Cost O(runs (P + n)).
    """
    if indices.max() >= FINE:
        raise InputsError(
            f"degree {indices.max()} is above {FINE - 1}", "lower the degree of the terms"
        )
    uniform = _uniform(runs, len(basis.laws) + 1, seed)
    degrees = indices[np.minimum((uniform[:, 0] * len(indices)).astype(int), len(indices) - 1)]
    picks = []
    for i in range(len(basis.laws)):
        rule = basis.rule(i, FINE)
        table = basis.table(i, rule.t, int(indices[:, i].max()))
        steps = np.cumsum(rule.weights[:, None] * table**2, axis=0)[:-1]
        picks.append(np.sum(steps.T[degrees[:, i]] < uniform[:, i + 1, None], axis=1))
    t, x = _at(basis, picks)
    density = np.mean(basis.evaluate(t, indices) ** 2, axis=1)
    return Design(t, x, 1.0 / (density * runs))


def _at(basis: Basis, picks: list[Indices]) -> tuple[Array, Array]:
    rules = [basis.rule(i, FINE) for i in range(len(picks))]
    t = np.stack([rule.t[pick] for rule, pick in zip(rules, picks, strict=True)], axis=1)
    return t, np.stack([rule.x[p] for rule, p in zip(rules, picks, strict=True)], axis=1)


def _uniform(runs: int, dimension: int, seed: int) -> Array:
    """Points (runs, dimension) of Sobol's sequence, moved by one random shift modulo 1."""
    if runs < 1:
        raise InputsError(f"{runs} runs make no design", "allow at least one run an experiment")
    power = int(np.ceil(np.log2(max(runs, 2))))
    base = qmc.Sobol(dimension, scramble=False).random_base2(power)[:runs]
    shift = np.random.default_rng(seed).random(dimension)
    return np.asarray((base + shift) % 1.0, dtype=np.float64)
