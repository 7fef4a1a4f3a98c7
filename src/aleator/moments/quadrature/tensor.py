"""The tensor product of the laws' Gauss rules."""

from __future__ import annotations

from dataclasses import dataclass

from aleator.laws import Inputs
from aleator.moments.quadrature.interface import affordable, check_whole
from aleator.moments.quadrature.nodes import Nodes, axes, combined
from aleator.polynomials import tensor
from aleator.types import Array


@dataclass(frozen=True)
class TensorGauss:
    """The tensor product of the laws' Gauss rules (paper, eq. (quadrature)).

    J = per_dimension^d for d scattering parameters; exact for polynomials of degree
    2 per_dimension - 1 in each of them. `per_dimension` from 1 to 100. Raises InputsError beyond
    that, and where J is above 1e6.

    >>> import numpy as np
    >>> from aleator.laws import Normal
    >>> rule = TensorGauss(3).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([0.0, 1.0]))
    >>> round(float(rule.weights @ rule.x[:, 0] ** 4), 9)
    3.0
    """

    per_dimension: int

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        check_whole("per_dimension", self.per_dimension, 1, 100)

    def nodes(self, inputs: Inputs, alpha: Array) -> Nodes:
        """The rule at alpha. Cost O(J n K)."""
        affordable(self.per_dimension**inputs.scattering)
        rules = axes(inputs, alpha, self.per_dimension)
        return combined(inputs, alpha, rules, tensor(tuple(rule.x.size for rule in rules)))
