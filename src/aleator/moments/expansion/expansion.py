"""The expansion of N experiments at once, and what every way to get one has in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aleator.errors import InputsError
from aleator.moments.expansion.basis import Basis
from aleator.moments.expansion.design import Design
from aleator.types import Array, Indices

NOTHING = 1e-12
"""Standard deviation over mean below which an outcome does not vary: what is left is rounding."""


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

        leave_one_out^2 / (variance + leave_one_out^2); zero where the outcome does not vary, NaN
        without a leave-one-out error.
        """
        missed = self.leave_one_out**2
        whole = self.variance + missed
        varies = ~(np.sqrt(whole) <= NOTHING * np.abs(self.mean))
        return np.where(varies, missed / np.where(varies, whole, 1.0), 0.0)


class Expanding(Protocol):
    """A way to an expansion: where to run, and what to make of the outcomes.

    design = choice.design(basis); outcomes = the simulator at design.x;
    expansion = choice.fit(basis, design, outcomes).
    """

    def design(self, basis: Basis) -> Design:
        """The points that every experiment is to be run at."""
        ...

    def fit(self, basis: Basis, design: Design, outcomes: Array) -> Expansion:
        """The expansion from outcomes (N, J) at the points of the design."""
        ...


def checked(design: Design, outcomes: Array) -> Array:
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
