"""Polynomial chaos expansions of the outcomes of many experiments in many parameters.

Products of the orthonormal polynomials of the parameters (`Basis`), by multi-indices of a set
(`TotalDegree`, `Hyperbolic`): a multi-index k (n,) stands for
p_k1(theta_1) .. p_kn(theta_n), and every set is downward closed, with k it holds each k' <= k.
A design says where to run the simulator; `Expansion` is what its outcomes give, by a way of
`projection`; from it come the parameters' shares of the variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from scipy.stats import qmc

from aleator.core.polynomials import evaluate, polished_rule, symmetric
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.laws import Inputs, Law, Normal, Rule


class IndexSet(Protocol):
    """A choice of multi-indices that grows with `degree`."""

    @property
    def degree(self) -> int:
        """The largest degree of a polynomial of one parameter (before its limit)."""

    def lowered(self, degree: int) -> Self:
        """The same choice with another degree."""

    def indices(self, limits: Sequence[int | None]) -> Indices:
        """Multi-indices (P, n), entry i at most limits[i] (None: as far as the degree goes)."""


class _OfDegree:
    """Base of sets (sum_i k_i^q)^(1/q) <= degree, q the norm."""

    degree: int

    @property
    def norm(self) -> float:
        """q."""
        return 1.0

    def __post_init__(self) -> None:
        if self.degree < 0:
            raise InputsError(f"degree {self.degree} is negative", "use 0 or more")

    def indices(self, limits: Sequence[int | None]) -> Indices:
        """Multi-indices (P, n) in the order of their sum. Cost O(P n)."""
        tops = (self.degree if limit is None else min(limit, self.degree) for limit in limits)
        costs = [np.arange(top + 1.0) ** self.norm for top in tops]
        return _below(costs, self.degree**self.norm)


@dataclass(frozen=True)
class TotalDegree(_OfDegree):
    """|k|_1 <= degree: P = (n + d)!/(n! d!) without limits, the set of the paper.

    Raises InputsError for a negative degree.

    >>> TotalDegree(2).indices((None, None)).tolist()
    [[0, 0], [0, 1], [1, 0], [0, 2], [1, 1], [2, 0]]
    >>> TotalDegree(2).indices((None,) * 10).shape           # 12!/(10! 2!) = 66
    (66, 10)
    """

    degree: int

    def lowered(self, degree: int) -> TotalDegree:
        """The same choice with another degree."""
        return TotalDegree(degree)


@dataclass(frozen=True)
class Hyperbolic(_OfDegree):
    """(sum_i k_i^q)^(1/q) <= degree with 0 < q <= 1: few products of many parameters.

    Blatman and Sudret, J. Comput. Phys. 230 (2011), sec. 3.2, with q = `norm`; q = 1 is
    `TotalDegree`, q towards 0 leaves only polynomials of single parameters. Raises InputsError for
    a negative degree or a norm that is not in (0, 1].

    >>> Hyperbolic(4).indices((None, None)).tolist()           # (1, 1): (1 + 1)^2 = 4
    [[0, 0], [0, 1], [1, 0], [0, 2], [1, 1], [2, 0], [0, 3], [3, 0], [0, 4], [4, 0]]
    """

    degree: int
    norm: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.norm <= 1.0:
            raise InputsError(
                f"norm {self.norm} is not in (0, 1]", "use 1 for the total degree, 0.5 for few"
            )

    def lowered(self, degree: int) -> Hyperbolic:
        """The same choice with another degree."""
        return Hyperbolic(degree, self.norm)


def highest(indices: Indices) -> tuple[int, ...]:
    """The largest degree of each parameter among multi-indices (P, n).

    >>> highest(np.array([[0, 0], [3, 0], [1, 1]]))
    (3, 1)
    """
    return tuple(int(degree) for degree in indices.max(axis=0))


def constant(indices: Indices) -> int:
    """Where the constant polynomial stands among multi-indices (P, n).

    >>> constant(np.array([[1, 0], [0, 0]]))
    1
    """
    return int(np.flatnonzero(~indices.any(axis=1))[0])


def _below(costs: Sequence[Array], most: float, largest: int = 200_000) -> Indices:
    """Multi-indices whose costs, costs[i][k_i] for each parameter, sum to at most `most`.

    Parameter after parameter every partial index is extended by all degrees that it can afford.
    Degree zero is free, so that no partial index is ever lost: cost O(P n). More than `largest` are
    a slip, and fill the memory.
    """
    most = most * (1.0 + 1e-9)  # costs are rounded
    found: Indices = np.zeros((1, 0), dtype=np.intp)
    spent = np.zeros(1)
    for cost in costs:
        counts = np.searchsorted(cost, most - spent, side="right")
        if counts.sum() > largest:
            raise InputsError(
                f"the set holds more than {largest} multi-indices",
                "lower the degree, or use Hyperbolic(degree) or fewer parameters",
            )
        parent = np.repeat(np.arange(len(found)), counts)
        degree = np.arange(len(parent)) - np.repeat(np.cumsum(counts) - counts, counts)
        found = np.column_stack([found[parent], degree])
        spent = spent[parent] + cost[degree]
    # by sum, then lexicographically: lexsort takes its last key first
    return found[np.lexsort((*found.T[::-1], found.sum(axis=1)))]


@dataclass(frozen=True, eq=False)
class Basis:
    """Orthonormal polynomials of n independent variables, given by the laws of the variables.

    psi_k(t) = p_k1(t_1) .. p_kn(t_n) for every multi-index k, with the polynomials of each law at
    `values` (k,) of its own hyperparameters. A constant has no polynomial but 1. Raises InputsError
    where laws and values differ in number.

    >>> from aleator.laws import Normal
    >>> basis = Basis((Normal(0.0, 1.0), Normal(2.0, 0.5)), (np.array([0.0, 1.0]),) * 2)
    >>> basis.evaluate(np.array([[2.0, 3.0]]), np.array([[0, 0], [1, 0], [1, 1]])).tolist()
    [[1.0, 2.0, 6.0]]
    """

    laws: tuple[Law, ...]
    values: tuple[Array, ...]

    def __post_init__(self) -> None:
        if len(self.laws) != len(self.values) or not self.laws:
            raise InputsError(
                f"{len(self.laws)} laws but {len(self.values)} arrays of values",
                "give each law its hyperparameters, and at least one law",
            )

    @classmethod
    def of(cls, inputs: Inputs, alpha: Array) -> Basis:
        """The basis of the joint law at alpha (K,), in the independent variables it is made of.

        These are the parameters themselves, and standard normal variates for correlated ones.
        """
        return cls(*inputs.independent(alpha))

    @classmethod
    def normal(cls, count: int) -> Basis:
        """Hermite polynomials of `count` independent standard normal variates."""
        return cls((Normal(0.0, 1.0),) * count, (np.array([0.0, 1.0]),) * count)

    @property
    def limits(self) -> tuple[int | None, ...]:
        """The largest degree that each law has: none, but zero for a constant."""
        return tuple(None if law.scatters else 0 for law in self.laws)

    def rule(self, parameter: int, nodes: int) -> Rule:
        """The Gauss rule of one marginal (one node for a constant)."""
        return self.laws[parameter].rule(self.values[parameter], nodes)

    def exact_rule(self, parameter: int, degree: int) -> tuple[Array, Array, Array]:
        """A Gauss rule exact to `degree`, for high powers: nodes t (q,), weights, p_0..p_(q-1)."""
        return polished_rule(*self.recurrence(parameter, degree // 2 + 1), degree)

    def recurrence(self, parameter: int, count: int) -> tuple[Array, Array]:
        """The recurrence coefficients (count,), (count,) of one marginal's polynomials."""
        return self.laws[parameter].recurrence(self.values[parameter], count)

    def symmetric(self, parameter: int, count: int) -> bool:
        """Whether polynomials below degree `count` have a symmetric weight, as far as they show."""
        return symmetric(*self.recurrence(parameter, count))

    def table(self, parameter: int, t: Array, degree: int) -> Array:
        """The polynomials of one marginal at t (J,), as (J, degree + 1)."""
        return evaluate(*self.recurrence(parameter, degree + 1), t, degree)

    def evaluate(self, t: Array, indices: Indices) -> Array:
        """psi at points t (J, n) for multi-indices (P, n), as (J, P). Cost O(J P n)."""
        value = np.ones((len(t), len(indices)))
        for i, degrees in enumerate(indices.T):
            used = np.flatnonzero(degrees)
            if used.size:
                table = self.table(i, t[:, i], int(degrees.max()))
                value[:, used] *= table[:, degrees[used]]
        return value


@dataclass(frozen=True, eq=False)
class ExpansionDesign:
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


def induced(
    basis: Basis, indices: Indices, runs: int, seed: int, fine: int = 40
) -> ExpansionDesign:
    """`runs` points from the distribution that a set of P polynomials induces.

    Density (1/P) sum_k psi_k(theta)^2 of the law, weights P / sum_k psi_k(theta)^2 / runs: least
    squares on P log P such points are as good as projection, for any law and any set (Cohen and
    Migliorati, SMAI J. Comput. Math. 3 (2017); sampled coordinate by coordinate as Narayan, SIAM
    J. Sci. Comput. 40 (2018) has it). The random numbers are a randomly shifted sequence of Sobol',
    so that a design of fewer runs is the beginning of one of more. Raises InputsError for less
    than one run or a degree above 39. Cost O(runs (P + n)).

    A Gauss rule of `fine` nodes stands for each marginal law: it integrates the square of a
    polynomial of degree 39 exactly, so that polynomials stay orthonormal on it.
    """
    if indices.max() >= fine:
        raise InputsError(
            f"degree {indices.max()} is above {fine - 1}", "lower the degree of the terms"
        )
    uniform = _uniform(runs, len(basis.laws) + 1, seed)
    degrees = indices[np.minimum((uniform[:, 0] * len(indices)).astype(int), len(indices) - 1)]
    rules = [basis.rule(i, fine) for i in range(len(basis.laws))]
    t, x = np.empty((2, runs, len(rules)))
    for i, rule in enumerate(rules):
        table = basis.table(i, rule.t, int(indices[:, i].max()))
        steps = np.cumsum(rule.weights[:, None] * table**2, axis=0)[:-1]
        pick = np.sum(steps.T[degrees[:, i]] < uniform[:, i + 1, None], axis=1)
        t[:, i], x[:, i] = rule.t[pick], rule.x[pick]
    density = np.mean(basis.evaluate(t, indices) ** 2, axis=1)
    return ExpansionDesign(t, x, 1.0 / (density * runs))


def _uniform(runs: int, dimension: int, seed: int) -> Array:
    """Points (runs, dimension) of Sobol's sequence, moved by one random shift modulo 1."""
    if runs < 1:
        raise InputsError(f"{runs} runs make no design", "allow at least one run an experiment")
    power = int(np.ceil(np.log2(max(runs, 2))))
    base = qmc.Sobol(dimension, scramble=False).random_base2(power)[:runs]
    shift = np.random.default_rng(seed).random(dimension)
    return np.asarray((base + shift) % 1.0, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Expansion:
    """Y_l(theta) = sum_k c_lk psi_k(theta) for N experiments (paper, eq. of the expansion).

    `indices` (P, n), the first of them zero, are shared by all experiments; `coefficients` (N, P);
    `leave_one_out` (N,) estimates the root-mean-square error under the law, in the outcome's unit,
    from the runs that were fitted (NaN where the way to the expansion has no such estimate).

    >>> basis = Basis.normal(1)
    >>> y = Expansion(basis, np.array([[0], [1]]), np.array([[3.0, 2.0]]), np.array([0.0]))
    >>> y.mean.tolist(), y.variance.tolist(), y.evaluate(np.array([[1.5]])).tolist()
    ([3.0], [4.0], [[6.0]])
    """

    basis: Basis
    indices: Indices
    coefficients: Array
    leave_one_out: Array

    def __post_init__(self) -> None:
        """Check the shapes; nobody may change a coefficient."""
        if self.coefficients.shape != (len(self.leave_one_out), len(self.indices)):
            raise InputsError(
                f"coefficients {self.coefficients.shape} for {len(self.leave_one_out)} experiments "
                f"and {len(self.indices)} multi-indices",
                "give one row an experiment and one column a multi-index",
            )
        for array in (self.indices, self.coefficients, self.leave_one_out):
            array.setflags(write=False)

    def evaluate(self, t: Array) -> Array:
        """Outcomes (N, J) at points t (J, n) of the polynomials. Cost O(J P (n + N))."""
        return self.coefficients @ self.basis.evaluate(t, self.indices).T

    @property
    def mean(self) -> Array:
        """E Y (N,), the coefficient of the constant polynomial."""
        return self.coefficients[:, 0]

    @property
    def variance(self) -> Array:
        """Var Y (N,) = sum of the other coefficients squared."""
        return np.asarray(np.sum(self.coefficients[:, 1:] ** 2, axis=1))

    @property
    def unexplained(self) -> Array:
        """Share (N,) of the outcome's variance that the expansion misses, an estimate of 1 - R^2.

        leave_one_out^2 / (variance + leave_one_out^2); zero where the outcome does not vary but by
        rounding, NaN without a leave-one-out error.
        """
        missed = self.leave_one_out**2
        whole = self.variance + missed
        varies = ~(np.sqrt(whole) <= 1e-12 * np.abs(self.mean))
        return np.where(varies, missed / np.where(varies, whole, 1.0), 0.0)


class Expanding(Protocol):
    """A way to an expansion: where to run, and what to make of the outcomes.

    design = choice.design(basis); outcomes = the simulator at design.x;
    expansion = choice.fit(basis, design, outcomes).
    """

    def design(self, basis: Basis) -> ExpansionDesign:
        """The points that every experiment is to be run at."""

    def fit(self, basis: Basis, design: ExpansionDesign, outcomes: Array) -> Expansion:
        """The expansion from outcomes (N, J) at the points of the design."""


def checked(design: ExpansionDesign, outcomes: Array) -> Array:
    """Outcomes (N, J) that belong to the design; raises InputsError where they do not."""
    outcomes = np.asarray(outcomes, dtype=np.float64)
    if outcomes.ndim != 2 or outcomes.shape[1] != len(design):
        raise InputsError(
            f"outcomes of shape {outcomes.shape} for a design of {len(design)} points",
            f"give one row an experiment and {len(design)} columns",
        )
    if not np.all(np.isfinite(outcomes)):
        raise InputsError(
            f"{np.sum(~np.isfinite(outcomes))} outcomes are not finite",
            "narrow the laws to where the simulator works",
        )
    return outcomes


@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Shares of the variance of N outcomes, by n parameters.

    `first` (N, n): of one parameter alone; `total` (N, n): of one parameter with all its
    interactions; `second` (N, n, n): of two parameters together beyond their first-order shares,
    symmetric, zero on the diagonal; `variance` (N,) in the outcome's unit squared. Shares are NaN
    where an outcome does not vary but by rounding.
    """

    first: Array
    total: Array
    second: Array
    variance: Array

    @property
    def closed(self) -> Array:
        """Shares (N, n, n) that two parameters explain by themselves: S_i + S_j + S_ij.

        On the diagonal S_i.
        """
        n = self.first.shape[1]
        pairs = self.first[:, :, None] + self.first[:, None, :] + self.second
        return np.where(np.eye(n, dtype=bool), self.first[:, :, None], pairs)


def sobol_indices(indices: Indices, coefficients: Array) -> SobolIndices:
    """First, second and total Sobol' indices of N expansions in orthonormal polynomials.

    Var Y = sum of c_k^2 over k != 0; a term belongs to the parameters with k_i > 0, so that each
    index is a partial sum of squares over that of all (Sudret, Reliab. Eng. Syst. Saf. 93 (2008)).
    `indices` (P, n), `coefficients` (N, P). As good as the expansion: what it misses has no share.
    Raises InputsError where the shapes do not fit. Cost O(N P + P n^2).

    >>> found = sobol_indices(np.array([[0, 0], [1, 0], [0, 2], [1, 1]]),
    ...                       np.array([[7.0, 2.0, 1.0, 2.0]]))    # variance 4 + 1 + 4
    >>> (9 * found.first).tolist(), (9 * found.total).tolist(), float(9 * found.second[0, 0, 1])
    ([[4.0, 1.0]], [[8.0, 5.0]], 4.0)
    """
    if indices.ndim != 2 or coefficients.ndim != 2 or coefficients.shape[1] != len(indices):
        raise InputsError(
            f"coefficients of shape {coefficients.shape} for multi-indices {indices.shape}",
            "give coefficients (N, P) for multi-indices (P, n)",
        )
    active = indices > 0
    order = active.sum(axis=1)
    squares = np.where(order > 0, coefficients**2, 0.0)
    variance = squares.sum(axis=1)
    mean = np.abs(coefficients[:, order == 0]).sum(axis=1)
    varies = np.sqrt(variance) > 1e-12 * mean
    share = squares / np.where(varies, variance, np.nan)[:, None]
    n = indices.shape[1]
    pairs = (active[:, :, None] & active[:, None, :])[order == 2] & ~np.eye(n, dtype=bool)
    return SobolIndices(
        first=share[:, order == 1] @ active[order == 1],
        total=share @ active,
        second=np.einsum("np,pij->nij", share[:, order == 2], pairs.astype(float)),
        variance=variance,
    )
