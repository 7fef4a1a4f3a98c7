"""The interface of a marginal law; every law fills it in a file of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aleator.laws.hyperparameter import Hyperparameter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rule:
    """A quadrature rule of q nodes for a law with k hyperparameters.

    `x` (q,) are the nodes, `weights` (q,) sum to one, `germ` (q,) are the nodes in the
    coordinate of the law's polynomials; `dx` and `dweights` (q, k) are the derivatives by the
    law's hyperparameters, so that the derivative of any weighted sum is exact for any q.
    """

    x: Array
    weights: Array
    germ: Array
    dx: Array
    dweights: Array


class Law(Protocol):
    """A marginal law P_X(alpha) of one parameter.

    `values` (k,) are its hyperparameters in the order of `hyperparameters`.
    """

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters, resolved and in order."""
        ...

    @property
    def box(self) -> tuple[float, float]:
        """Finite interval that holds every node for every admissible alpha."""
        ...

    @property
    def bounded(self) -> bool:
        """Whether the user stated the box, rather than the law having to guess one."""
        ...

    @property
    def scatters(self) -> bool:
        """Whether the parameter varies between experiments (a constant does not)."""
        ...

    def rule(self, values: Array, nodes: int) -> Rule:
        """The Gauss rule of the law with `nodes` nodes (one for a constant)."""
        ...

    def polynomials(self, values: Array, germ: Array, degree: int) -> Array:
        """The law's orthonormal polynomials at the germ (J,), as (J, degree + 1)."""
        ...

    def quantile(self, values: Array, probability: Array) -> Array:
        """The quantile of the law at each probability; maps uniform samples to the law."""
        ...
