"""Coefficients by tensor Gauss quadrature: the paper's way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.errors import InputsError
from aleator.laws import Inputs
from aleator.moments.expansion.basis import Basis
from aleator.moments.expansion.design import Design
from aleator.moments.expansion.expansion import Expansion, checked
from aleator.moments.expansion.indices import IndexSet, TotalDegree
from aleator.polynomials import tensor
from aleator.types import Array, Indices


@dataclass(frozen=True)
class Projection:
    """c_k = sum_j y_j psi_k(theta_j) w_j at the nodes of a tensor Gauss rule (paper, quadrature).

    `terms` are the polynomials, `nodes` the nodes a parameter (default: degree + 1, the fewest
    that determine them). Exact for polynomials of degree up to 2 nodes - 1 - degree in every
    parameter; others alias. nodes^n runs an experiment: for few parameters. There is no
    leave-one-out error. Raises InputsError for fewer nodes than degree + 1.

    >>> from aleator.moments.expansion.indices import TotalDegree
    >>> basis = Basis.normal(1)
    >>> way = Projection(TotalDegree(2))
    >>> design = way.design(basis)                                  # x^2 = 1 + sqrt(2) psi_2
    >>> way.fit(basis, design, design.x.T**2).coefficients.round(6).tolist()
    [[1.0, 0.0, 1.414214]]
    """

    terms: IndexSet
    nodes: int | None = None

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.nodes is not None and self.nodes <= self.terms.degree:
            raise InputsError(
                f"{self.nodes} nodes do not determine polynomials of degree {self.terms.degree}",
                f"use at least {self.terms.degree + 1} nodes",
            )

    def design(self, basis: Basis) -> Design:
        """All combinations of the nodes of the marginal laws."""
        return tensor_design(basis, [self.nodes or self.terms.degree + 1] * len(basis.laws))

    def fit(self, basis: Basis, design: Design, outcomes: Array) -> Expansion:
        """The expansion from outcomes (N, J) at the nodes."""
        return project(basis, self.terms.indices(basis.limits), design, outcomes)


def project(basis: Basis, indices: Indices, design: Design, outcomes: Array) -> Expansion:
    """Coefficients c_k = sum_j weights_j y_j psi_k(theta_j) for any design.

    As good as the weights integrate the product of outcome and polynomial: on a sparse grid they
    do not, and errors of order one alias into the coefficients (Constantine, Eldred and Phipps
    2012); use `SparseProjection` there.
    """
    outcomes = checked(design, outcomes)
    psi = basis.evaluate(design.t, indices)
    coefficients = (outcomes * design.weights) @ psi
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


def tensor_design(basis: Basis, sizes: list[int]) -> Design:
    """The tensor Gauss rule with sizes[i] nodes of parameter i (one for a constant)."""
    rules = [basis.rule(i, size) for i, size in enumerate(sizes)]
    picks = tensor(tuple(rule.x.size for rule in rules))
    columns = list(zip(rules, picks.T, strict=True))
    return Design(
        np.stack([rule.t[pick] for rule, pick in columns], axis=1),
        np.stack([rule.x[pick] for rule, pick in columns], axis=1),
        np.prod([rule.weights[pick] for rule, pick in columns], axis=0),
    )
