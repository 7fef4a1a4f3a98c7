"""Two methods for the coefficients of an expansion: projection on a tensor rule, and regression.

Both are an `Expanding`: `design` chooses the points of the runs, `fit` computes the expansion from
the outcomes there. `Projection` on a tensor rule is the method of the paper. `Regression` needs
few runs where there are many parameters.
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
    """Coefficients by projection, c_k = sum_j y_j psi_k(theta_j) w_j (paper, quadrature).

    theta_j are the nodes of a tensor Gauss rule and w_j its weights. `terms` is the set of
    polynomials psi_k; `nodes` is the number of nodes per parameter (default: degree + 1, the fewest
    that determine the coefficients). The coefficients are exact if the outcome is a polynomial of
    degree up to 2 nodes - 1 - degree in every parameter; higher terms falsify them. The method
    takes nodes^n runs per experiment, so that it suits few parameters. It has no leave-one-out
    error. Raises InputsError for fewer nodes than degree + 1.

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
        """The design with all combinations of the nodes of the parameters' Gauss rules."""
        return tensor_design(basis, [self.nodes or self.terms.degree + 1] * len(basis.laws))

    def fit(self, basis: Basis, design: ExpansionDesign, outcomes: Array) -> Expansion:
        """The expansions of N outcomes by projection, from their values (N, J) at the nodes."""
        outcomes, indices = checked(design, outcomes), self.terms.indices(basis.limits)
        coefficients = (outcomes * design.weights) @ basis.evaluate(design.t, indices)
        return Expansion(basis, indices, coefficients, np.full(len(outcomes), np.nan))


def expansion_map(
    inputs: Inputs, alpha: Array, nodes: int, degree: int, order: int
) -> tuple[Array, Array]:
    """A matrix (F, J) that maps outcomes at J nodes to their expansion at F finer nodes.

    Returns the matrix and the weights (F,) of the finer nodes. The expansion is the projection on a
    tensor rule with `nodes` nodes per parameter, to total degree `degree` (paper, eq.
    (quadrature)). The finer rule, with floor(order degree / 2) + 1 nodes per parameter, integrates
    the power `order` of the expansion exactly (paper, eq. (moments)).
    """
    basis, way = Basis.of(inputs, alpha), Projection(TotalDegree(degree), nodes)
    design = way.design(basis)
    fine = tensor_design(basis, [order * degree // 2 + 1] * len(basis.laws))
    unit = way.fit(basis, design, np.eye(len(design)))
    return unit.evaluate(fine.t).T, fine.weights


def tensor_design(basis: Basis, sizes: list[int]) -> ExpansionDesign:
    """The tensor Gauss rule with sizes[i] nodes for parameter i (one node for a constant)."""
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
    """Coefficients by weighted least squares on points of the induced distribution (`induced`).

    All N experiments share the points and one QR decomposition. `runs` (default: twice the number
    of terms) well above the number of terms makes the matrix well conditioned, for any law and any
    terms. With `adaptive` every lower degree is tried too, and each experiment takes the degree
    with the least corrected leave-one-out error. Sets with more terms than 80 % of the runs are not
    tried, because their errors cannot be compared. The result is exact if the outcome is a
    polynomial in the set. Raises InputsError for runs below one, and where there are fewer runs
    than terms and the degree may not be lowered.

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
        """The design of points of the induced distribution; fewer runs are the first of more."""
        indices = self.terms.indices(basis.limits)
        return induced(basis, indices, self.runs or 2 * len(indices), self.seed)

    def fit(self, basis: Basis, design: ExpansionDesign, outcomes: Array) -> Expansion:
        """The expansions of N outcomes by regression, from values (N, J) at the points of a design.

        The design need not be that of `design`.
        """
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
        """The multi-indices sorted by degree (P, n), and how many there are up to each degree."""
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
    """Least-squares fits of N outcomes with the first k terms, for each k in `ends` (E,).

    `leave_one_out` (E, N) are mean-square leave-one-out errors. `corrected` (E, N) are these errors
    times J/(J - k) (1 + tr(C^-1)/J), a correction for J runs and the Gram matrix C of the k terms
    (Chapelle, Vapnik and Bengio 2002; Blatman and Sudret 2011, eq. 21). With it, fits with
    different numbers of terms can be compared. `upper` and `projected` are the R factor and the
    right-hand side of the QR decomposition, from which the coefficients follow.
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

    Each fit minimizes sum_j weights_j (y_j - psi_j c)^2; the weights (J,) are normalized to sum to
    one. The leave-one-out residual is r_j / (1 - h_j) with the residual r_j and the leverage h_j,
    so that no second fit is needed. The error is infinite where one point alone determines a
    coefficient (1 - h_j below `smallest`), or where columns depend linearly on each other. One QR
    decomposition of the weighted matrix gives all fits: with the first k terms the fit is
    Q_k Q_k' b, its leverages are the row sums of Q_k^2, and the inverse of the leading block of R
    is the leading block of R^-1. Needs ends[-1] <= J. Cost O(J P^2 + J P N).
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
    """tr((R_k' R_k)^-1) for every leading k x k block R_k of R, as (P,).

    It is infinite from the first column on that depends linearly on those before it.
    """
    size = np.linalg.norm(upper, axis=0)
    depends = np.flatnonzero(np.abs(np.diag(upper)) <= smallest * size)
    sound = int(depends[0]) if depends.size else len(upper)
    norms = np.full(len(upper), np.inf)
    inverse = linalg.solve_triangular(upper[:sound, :sound], np.eye(sound))
    norms[:sound] = np.cumsum(np.sum(inverse**2, axis=0))
    return norms
