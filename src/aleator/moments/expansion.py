"""Polynomial chaos expansions of the outcomes of many experiments in many parameters.

An expansion is a sum of products of orthonormal polynomials, one for each of n parameters
(`Basis`). A multi-index k (n,) stands for the product p_k1(theta_1) .. p_kn(theta_n). A set of
multi-indices (`TotalDegree`, `Hyperbolic`) that contains k contains every k' <= k as well. A design
says at which points to run the simulator. The module `projection` computes an `Expansion` from the
outcomes there, and `sobol_indices` gives the parameters' shares of the variance.
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
    """A rule that says which multi-indices an expansion has; their number grows with `degree`."""

    @property
    def degree(self) -> int:
        """The largest degree in one parameter, before the limit of that parameter is applied."""

    def lowered(self, degree: int) -> Self:
        """This rule with another degree."""

    def indices(self, limits: Sequence[int | None]) -> Indices:
        """Multi-indices (P, n), with entry i at most limits[i]; None sets no limit of its own."""


class _OfDegree:
    """Base of the sets of multi-indices k with (sum_i k_i^q)^(1/q) <= degree; q is the norm."""

    degree: int

    @property
    def norm(self) -> float:
        """The exponent q of the norm; 1 makes the set that of the total degree."""
        return 1.0

    def __post_init__(self) -> None:
        if self.degree < 0:
            raise InputsError(f"degree {self.degree} is negative", "use 0 or more")

    def indices(self, limits: Sequence[int | None]) -> Indices:
        """The multi-indices (P, n) of the set, sorted by their sum. Cost O(P n)."""
        tops = (self.degree if limit is None else min(limit, self.degree) for limit in limits)
        costs = [np.arange(top + 1.0) ** self.norm for top in tops]
        return _below(costs, self.degree**self.norm)


@dataclass(frozen=True)
class TotalDegree(_OfDegree):
    """The multi-indices k with k_1 + .. + k_n <= degree, the set of the paper.

    For degree d there are P = (n + d)!/(n! d!) of them if no parameter has a limit of its own.
    Raises InputsError for a negative degree.

    >>> TotalDegree(2).indices((None, None)).tolist()
    [[0, 0], [0, 1], [1, 0], [0, 2], [1, 1], [2, 0]]
    >>> TotalDegree(2).indices((None,) * 10).shape           # 12!/(10! 2!) = 66
    (66, 10)
    """

    degree: int

    def lowered(self, degree: int) -> TotalDegree:
        """The total-degree set of another degree."""
        return TotalDegree(degree)


@dataclass(frozen=True)
class Hyperbolic(_OfDegree):
    """The multi-indices k with (sum_i k_i^q)^(1/q) <= degree, with q = `norm` in (0, 1].

    The set has few products of several parameters (Blatman and Sudret, J. Comput. Phys. 230 (2011),
    sec. 3.2). q = 1 gives `TotalDegree`; with q towards 0 only polynomials of single parameters
    remain. Raises InputsError for a negative degree or a norm that is not in (0, 1].

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
        """The hyperbolic set of another degree, with this norm."""
        return Hyperbolic(degree, self.norm)


def highest(indices: Indices) -> tuple[int, ...]:
    """The largest degree of each parameter among multi-indices (P, n).

    >>> highest(np.array([[0, 0], [3, 0], [1, 1]]))
    (3, 1)
    """
    return tuple(int(degree) for degree in indices.max(axis=0))


def constant(indices: Indices) -> int:
    """The row of the constant polynomial (all degrees zero) among multi-indices (P, n).

    >>> constant(np.array([[1, 0], [0, 0]]))
    1
    """
    return int(np.flatnonzero(~indices.any(axis=1))[0])


def _below(costs: Sequence[Array], most: float, largest: int = 200_000) -> Indices:
    """The multi-indices k (P, n) with costs[0][k_1] + .. + costs[n-1][k_n] <= `most`.

    The indices are built one parameter after the other: each partial index is extended by every
    degree whose cost still fits. Degree zero costs nothing, so that no partial index is dropped:
    the work is O(P n). Raises InputsError for more than `largest` indices, which would fill the
    memory.
    """
    most = most * (1.0 + 1e-9)  # The costs are rounded.
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
    # Sort by the sum, then lexicographically; lexsort takes its last key first.
    return found[np.lexsort((*found.T[::-1], found.sum(axis=1)))]


@dataclass(frozen=True, eq=False)
class Basis:
    """Orthonormal polynomials of n independent variables, given by the laws of the variables.

    psi_k(t) = p_k1(t_1) .. p_kn(t_n) for every multi-index k. The polynomials p of a variable are
    orthonormal under its law, whose hyperparameters have the given `values`. A variable that is
    constant has only the polynomial 1. Raises InputsError where laws and values differ in number.

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
        """The basis of the joint law of the parameters with hyperparameters alpha (K,).

        Its variables are the parameters, except that independent standard normal variates stand for
        correlated parameters.
        """
        return cls(*inputs.independent(alpha))

    @classmethod
    def normal(cls, count: int) -> Basis:
        """The basis of Hermite polynomials of `count` independent standard normal variates."""
        return cls((Normal(0.0, 1.0),) * count, (np.array([0.0, 1.0]),) * count)

    @property
    def limits(self) -> tuple[int | None, ...]:
        """The largest degree of each variable: 0 for a constant, None (no limit) for any other."""
        return tuple(None if law.scatters else 0 for law in self.laws)

    def rule(self, parameter: int, nodes: int) -> Rule:
        """The Gauss rule of one parameter's law with `nodes` nodes (one node for a constant)."""
        return self.laws[parameter].rule(self.values[parameter], nodes)

    def exact_rule(self, parameter: int, degree: int) -> tuple[Array, Array, Array]:
        """A Gauss rule exact up to `degree`: nodes t (q,), weights (q,), and p_0..p_(q-1) at t."""
        return polished_rule(*self.recurrence(parameter, degree // 2 + 1), degree)

    def recurrence(self, parameter: int, count: int) -> tuple[Array, Array]:
        """The two sets of recurrence coefficients (count,) of one parameter's polynomials."""
        return self.laws[parameter].recurrence(self.values[parameter], count)

    def symmetric(self, parameter: int, count: int) -> bool:
        """Whether a parameter's law is symmetric, judged by the first `count` coefficients."""
        return symmetric(*self.recurrence(parameter, count))

    def table(self, parameter: int, t: Array, degree: int) -> Array:
        """The polynomials p_0..p_degree of one parameter at t (J,), as (J, degree + 1)."""
        return evaluate(*self.recurrence(parameter, degree + 1), t, degree)

    def evaluate(self, t: Array, indices: Indices) -> Array:
        """psi_k at points t (J, n) for the multi-indices k (P, n), as (J, P). Cost O(J P n)."""
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

    `t` (J, n) are the points as arguments of the polynomials; `x` (J, n) are the same points as
    values of the variables of the basis (the parameters, if none is correlated). With `weights`
    (J,), sum_j weights_j f(x_j) estimates the expectation of f.
    """

    t: Array
    x: Array
    weights: Array

    def __post_init__(self) -> None:
        """Make the arrays read-only: no point may change after the simulator was run there."""
        for array in (self.t, self.x, self.weights):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.weights)


def induced(
    basis: Basis, indices: Indices, runs: int, seed: int, fine: int = 40
) -> ExpansionDesign:
    """A design of `runs` points from the distribution that a set of P polynomials induces.

    Its density is that of the law times (1/P) sum_k psi_k(theta)^2, and a point has the weight
    P / sum_k psi_k(theta)^2 / runs. Least squares on the order of P log P such points is as
    accurate as projection, for any law and any set of polynomials (Cohen and Migliorati, SMAI J.
    Comput. Math. 3 (2017)). The points are sampled one coordinate after the other (Narayan, SIAM J.
    Sci. Comput. 40 (2018)). The random numbers are a randomly shifted Sobol' sequence, so that a
    design of fewer runs is the beginning of one of more. Raises InputsError for less than one run
    or a degree above 39. Cost O(runs (P + n)).

    Each parameter's law is replaced by its Gauss rule of `fine` nodes. This rule integrates the
    square of a polynomial of degree 39 exactly, so that the polynomials stay orthonormal.
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
    """Points (runs, dimension) of Sobol's sequence, all moved by one random shift modulo 1."""
    if runs < 1:
        raise InputsError(f"{runs} runs make no design", "allow at least one run an experiment")
    power = int(np.ceil(np.log2(max(runs, 2))))
    base = qmc.Sobol(dimension, scramble=False).random_base2(power)[:runs]
    shift = np.random.default_rng(seed).random(dimension)
    return np.asarray((base + shift) % 1.0, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Expansion:
    """The expansions Y_l(theta) = sum_k c_lk psi_k(theta) of N outcomes (paper, expansion).

    `indices` (P, n) are the multi-indices k, shared by all experiments; the first is zero.
    `coefficients` (N, P) are the c_lk. `leave_one_out` (N,) estimates the root-mean-square error
    under the law, in the outcome's unit, from the runs that were fitted. It is NaN where the method
    gives no such estimate, as projection.

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
        """Check the shapes, and make the arrays read-only."""
        if self.coefficients.shape != (len(self.leave_one_out), len(self.indices)):
            raise InputsError(
                f"coefficients {self.coefficients.shape} for {len(self.leave_one_out)} experiments "
                f"and {len(self.indices)} multi-indices",
                "give one row an experiment and one column a multi-index",
            )
        for array in (self.indices, self.coefficients, self.leave_one_out):
            array.setflags(write=False)

    def evaluate(self, t: Array) -> Array:
        """Outcomes (N, J) at points t (J, n), the arguments of the polynomials. O(J P (n + N))."""
        return self.coefficients @ self.basis.evaluate(t, self.indices).T

    @property
    def mean(self) -> Array:
        """The mean of each outcome (N,), the coefficient of the constant polynomial."""
        return self.coefficients[:, 0]

    @property
    def variance(self) -> Array:
        """The variance of each outcome (N,), the sum of the squares of its other coefficients."""
        return np.asarray(np.sum(self.coefficients[:, 1:] ** 2, axis=1))

    @property
    def unexplained(self) -> Array:
        """Share (N,) of the outcome's variance that the expansion misses, an estimate of 1 - R^2.

        It is leave_one_out^2 / (variance + leave_one_out^2). It is zero where the outcome varies
        only by rounding, and NaN where there is no leave-one-out error.
        """
        missed = self.leave_one_out**2
        whole = self.variance + missed
        varies = ~(np.sqrt(whole) <= 1e-12 * np.abs(self.mean))
        return np.where(varies, missed / np.where(varies, whole, 1.0), 0.0)


class Expanding(Protocol):
    """A method for an expansion: it chooses the points, and fits the outcomes there.

    Used as design = choice.design(basis); outcomes = the simulator at design.x;
    expansion = choice.fit(basis, design, outcomes).
    """

    def design(self, basis: Basis) -> ExpansionDesign:
        """The points at which every experiment is to be run."""

    def fit(self, basis: Basis, design: ExpansionDesign, outcomes: Array) -> Expansion:
        """The expansions that fit outcomes (N, J) at the points of the design."""


def checked(design: ExpansionDesign, outcomes: Array) -> Array:
    """Outcomes (N, J) as an array; raises InputsError if not finite, or not one for each point."""
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
    """The shares that n parameters have in the variance of N outcomes (Sobol' indices).

    `first` (N, n): the share of one parameter alone. `total` (N, n): the share of one parameter
    with all its interactions. `second` (N, n, n): the share of two parameters together beyond their
    first-order shares; symmetric, zero on the diagonal. `variance` (N,): the variance, in the
    outcome's unit squared. Shares are NaN where an outcome varies only by rounding.
    """

    first: Array
    total: Array
    second: Array
    variance: Array

    @property
    def closed(self) -> Array:
        """The share (N, n, n) that each pair of parameters explains: S_i + S_j + S_ij.

        S_i is the first-order share and S_ij the second-order share; the diagonal holds S_i.
        """
        n = self.first.shape[1]
        pairs = self.first[:, :, None] + self.first[:, None, :] + self.second
        return np.where(np.eye(n, dtype=bool), self.first[:, :, None], pairs)


def sobol_indices(indices: Indices, coefficients: Array) -> SobolIndices:
    """First, second and total Sobol' indices of N expansions in orthonormal polynomials.

    Var Y = sum of c_k^2 over k != 0. A term belongs to the parameters with k_i > 0, so that each
    index is the sum of squares of its terms over the variance (Sudret, Reliab. Eng. Syst. Saf. 93
    (2008)). `indices` (P, n) are the multi-indices k, `coefficients` (N, P) the c_k. Variance that
    the expansion misses appears in no index. Raises InputsError where the shapes do not fit. Cost
    O(N P + P n^2).

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
