"""The polynomials of a joint law: products of the orthonormal polynomials of its marginals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.errors import InputsError
from aleator.laws import Inputs, Law, Normal, Rule
from aleator.polynomials import evaluate, polished_rule, symmetric
from aleator.types import Array, Indices


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
        """Check at once, so that the mistake is reported where it was made."""
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
