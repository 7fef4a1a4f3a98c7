"""Ways to the coefficients of an expansion: projection on a tensor rule, and regression.

A way is an `Expanding`: `design` says where to run, `fit` makes the expansion of the outcomes.
`Projection` on a tensor rule is the paper's; `Regression` takes few runs in many parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from aleator.core.polynomials import tensor
from aleator.core.threads import single_threaded
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.laws import Inputs
from aleator.moments.expansion import (
    Basis,
    Expansion,
    ExpansionDesign,
    IndexSet,
    TotalDegree,
    checked,
    induced,
)


@dataclass(frozen=True)
class Projection:
    """c_k = sum_j y_j psi_k(theta_j) w_j at the nodes of a tensor Gauss rule (paper, quadrature).

    `terms` are the polynomials, `nodes` the nodes a parameter (default: degree + 1, the fewest
    that determine them). Exact for polynomials of degree up to 2 nodes - 1 - degree in every
    parameter; others alias. nodes^n runs an experiment: for few parameters. There is no
    leave-one-out error. Raises InputsError for fewer nodes than degree + 1.

    >>> from aleator.moments.expansion import TotalDegree
    >>> basis = Basis.normal(1)
    >>> way = Projection(TotalDegree(2))
    >>> design = way.design(basis)                                  # x^2 = 1 + sqrt(2) psi_2
    >>> way.fit(basis, design, design.x.T**2).coefficients.round(6).tolist()
    [[1.0, 0.0, 1.414214]]
    """

    terms: IndexSet
    nodes: int | None = None

    def __post_init__(self) -> None:
        if self.nodes is not None and self.nodes <= self.terms.degree:
            raise InputsError(
                f"{self.nodes} nodes do not determine polynomials of degree {self.terms.degree}",
                f"use at least {self.terms.degree + 1} nodes",
            )

    def design(self, basis: Basis) -> ExpansionDesign:
        """All combinations of the nodes of the marginal laws."""
        return tensor_design(basis, [self.nodes or self.terms.degree + 1] * len(basis.laws))

    def fit(self, basis: Basis, design: ExpansionDesign, outcomes: Array) -> Expansion:
        """The expansion from outcomes (N, J) at the nodes."""
        outcomes, indices = checked(design, outcomes), self.terms.indices(basis.limits)
        coefficients = (outcomes * design.weights) @ basis.evaluate(design.t, indices)
        return Expansion(basis, indices, coefficients, np.full(len(outcomes), np.nan))


def expansion_map(
    inputs: Inputs, alpha: Array, nodes: int, degree: int, order: int
) -> tuple[Array, Array]:
    """Matrix (F, J) from outcomes at the J nodes to the expansion at F finer nodes, and weights.

    The expansion is the projection on a tensor rule of `nodes` a parameter, to total degree
    `degree` (paper, eq. (quadrature)). The finer rule, with floor(order degree / 2) + 1 nodes a
    parameter, integrates the expansion to the power `order` exactly (paper, eq. (moments)).
    """
    basis, way = Basis.of(inputs, alpha), Projection(TotalDegree(degree), nodes)
    design = way.design(basis)
    fine = tensor_design(basis, [order * degree // 2 + 1] * len(basis.laws))
    unit = way.fit(basis, design, np.eye(len(design)))
    return unit.evaluate(fine.t).T, fine.weights


def tensor_design(basis: Basis, sizes: list[int]) -> ExpansionDesign:
    """The tensor Gauss rule with sizes[i] nodes of parameter i (one for a constant)."""
    rules = [basis.rule(i, size) for i, size in enumerate(sizes)]
    picks = tensor(tuple(rule.x.size for rule in rules))
    columns = list(zip(rules, picks.T, strict=True))
    return ExpansionDesign(
        np.stack([rule.t[pick] for rule, pick in columns], axis=1),
        np.stack([rule.x[pick] for rule, pick in columns], axis=1),
        np.prod([rule.weights[pick] for rule, pick in columns], axis=0),
    )


@dataclass(frozen=True)
class Regression:
    """Weighted least squares on points of the induced distribution (see `induced`).

    All N experiments share the points, one QR decomposition and its leverages. With `runs` (default
    twice the number of terms) well above the number of terms the matrix is well conditioned by
    construction, whatever law and terms. With `adaptive` every lower degree is tried too, and each
    experiment takes the degree of the least corrected leave-one-out error; more terms than 80 % of
    the runs are not tried, for there the errors can no longer be compared. Exact for polynomials in
    the set. Raises InputsError for runs below one, and if there are fewer runs than terms and the
    degree may not be lowered.

    >>> from aleator.moments.expansion import TotalDegree
    >>> basis = Basis.normal(10)
    >>> way = Regression(TotalDegree(2))
    >>> design = way.design(basis)                                  # 2 * 66 runs
    >>> y = way.fit(basis, design, np.sum(design.x, axis=1)[None] ** 2)
    >>> len(design), y.mean.round(9).tolist(), y.variance.round(9).tolist()   # E = 10, Var = 200
    (132, [10.0], [200.0])
    """

    terms: IndexSet
    runs: int | None = None
    adaptive: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        if self.runs is not None and self.runs < 1:
            raise InputsError(f"{self.runs} runs make no design", "allow at least one run")

    def design(self, basis: Basis) -> ExpansionDesign:
        """Points of the induced distribution; fewer runs are the beginning of more."""
        indices = self.terms.indices(basis.limits)
        return induced(basis, indices, self.runs or 2 * len(indices), self.seed)

    def fit(self, basis: Basis, design: ExpansionDesign, outcomes: Array) -> Expansion:
        """The expansion from outcomes (N, J) at the points of the design, or of any other."""
        outcomes = checked(design, outcomes)
        indices, ends = self._nested(basis, len(design))
        psi = basis.evaluate(design.t, indices[: ends[-1]])
        fits = nested_fits(psi, design.weights, outcomes, ends)
        best = np.argmin(fits.corrected, axis=0)
        coefficients = np.zeros((len(outcomes), ends[-1]))
        for k in np.unique(best):
            which = np.flatnonzero(best == k)
            coefficients[which, : ends[k]] = fits.coefficients(ends[k], which).T
        error = np.sqrt(np.take_along_axis(fits.leave_one_out, best[None], axis=0)[0])
        return Expansion(basis, indices[: ends[-1]], coefficients, error)

    def _nested(self, basis: Basis, runs: int) -> tuple[Indices, tuple[int, ...]]:
        """The terms, those of a lower degree first, and how many there are up to each degree."""
        sets = [
            self.terms.lowered(degree).indices(basis.limits)
            for degree in range(0 if self.adaptive else self.terms.degree, self.terms.degree + 1)
        ]
        seen: dict[tuple[int, ...], None] = {}
        ends = []
        for indices in sets:
            seen.update(dict.fromkeys(map(tuple, indices.tolist())))
            ends.append(len(seen))
        allowed = 0.8 * runs if self.adaptive else runs
        kept = tuple(sorted({end for end in ends if end <= allowed}))
        if not kept:
            raise InputsError(
                f"{runs} runs do not determine {ends[0]} coefficients",
                "allow more runs, lower the degree, or set adaptive=True",
            )
        return np.array(list(seen), dtype=np.intp), kept


@dataclass(frozen=True, eq=False)
class NestedFits:
    """Fits of N outcomes with the first k terms, for k in `ends` (E,).

    `leave_one_out` (E, N) are mean-square errors; `corrected` are those times the factor
    J/(J - k) (1 + tr(C^-1)/J) of small samples (Chapelle, Vapnik and Bengio 2002; Blatman and
    Sudret 2011, eq. 21), by which fits with different numbers of terms are compared.
    """

    upper: Array
    projected: Array
    ends: tuple[int, ...]
    leave_one_out: Array
    corrected: Array

    def coefficients(self, end: int, which: Indices) -> Array:
        """Coefficients (k, n') of the first k terms for the outcomes `which` (n',)."""
        part = self.projected[:end, which]
        return np.asarray(linalg.solve_triangular(self.upper[:end, :end], part))


@single_threaded
def nested_fits(
    psi: Array, weights: Array, outcomes: Array, ends: tuple[int, ...], smallest: float = 1e-10
) -> NestedFits:
    """Fit outcomes (N, J) by the first k columns of psi (J, P) for every k in `ends`, increasing.

    Minimizes sum_j weights_j (y_j - psi_j c)^2; weights (J,) are normalized to sum to one. The
    leave-one-out residual is r_j / (1 - h_j) with the leverage h_j, without any second fit. A point
    that alone determines a coefficient (h_j = 1) makes the error infinite, and so do columns that
    depend on each other: where less than `smallest` is left over it is rounding. One QR
    decomposition of the weighted matrix serves every leading part of the terms: the fit with the
    first k of them is Q_k Q_k' b, its leverages are the row sums of Q_k^2, and the inverse of the
    leading block of R is the leading block of R^-1. Needs ends[-1] <= J. Cost O(J P^2 + J P N).
    """
    share = weights / weights.sum()
    root = np.sqrt(share)[:, None]
    orthogonal, upper = np.linalg.qr(root * psi[:, : ends[-1]])
    projected = orthogonal.T @ (root * outcomes.T)
    errors, corrected = [], []
    residual, leverage, begin = root * outcomes.T, np.zeros(len(share)), 0
    spread = _inverse_norms(upper, smallest)
    for end in ends:
        part = orthogonal[:, begin:end]
        residual = residual - part @ projected[begin:end]
        leverage = leverage + np.sum(part**2, axis=1)
        begin = end
        free = 1.0 - leverage
        determined = np.all(free > smallest) and np.isfinite(spread[end - 1]) and end < len(share)
        error = np.sum((residual / np.maximum(free, smallest)[:, None]) ** 2, axis=0)
        errors.append(error if determined else np.full_like(error, np.inf))
        count = len(share)
        factor = count / max(count - end, 1) * (1.0 + spread[end - 1] / count)
        corrected.append(errors[-1] * factor)
    return NestedFits(upper, projected, ends, np.array(errors), np.array(corrected))


def _inverse_norms(upper: Array, smallest: float) -> Array:
    """tr((R_k' R_k)^-1) (P,) for every leading block R_k; infinite from a dependent column on."""
    size = np.linalg.norm(upper, axis=0)
    depends = np.flatnonzero(np.abs(np.diag(upper)) <= smallest * size)
    sound = int(depends[0]) if depends.size else len(upper)
    norms = np.full(len(upper), np.inf)
    inverse = linalg.solve_triangular(upper[:sound, :sound], np.eye(sound))
    norms[:sound] = np.cumsum(np.sum(inverse**2, axis=0))
    return norms
