"""Evenly spaced nodes of the germ: for what varies faster than any polynomial rule can follow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from aleator.cubature.interface import affordable
from aleator.errors import InputsError
from aleator.inputs import Inputs, Nodes
from aleator.quadrature import tensor

Array = NDArray[np.float64]

REACH = 8.0
"""Ends of the grid in standard deviations of the germ: the mass beyond is 1e-15."""
NEGLIGIBLE = 1e-16
"""Nodes whose weight is below this share of the largest are left out: the grid is a ball."""


@dataclass(frozen=True)
class GermGrid:
    """The trapezoidal rule in the standard normal germ, mapped by the laws.

    theta on an even grid of `per_dimension` m points from -8 to 8 in every scattering parameter,
    weights proportional to phi(theta). For smooth integrands it converges as fast as a Gauss rule
    (Trefethen and Weideman, 2014), and it resolves narrow ones: a normal density of standard
    deviation s in theta is integrated to 2 exp(-2 pi^2 s^2/h^2) with the step h = 16/(m - 1), where
    a Gauss rule of m nodes has far wider gaps. Meant for densities fitted to the nodes themselves.
    J is about half of m^2 for two parameters. m from 5 to 4001; raises InputsError beyond, and
    where the grid would have above a million nodes.

    >>> from aleator.laws import Normal
    >>> rule = GermGrid(41).nodes(Inputs({"x": Normal(0.0, 1.0)}), np.array([0.0, 1.0]))
    >>> round(float(rule.weights @ rule.x[:, 0] ** 8), 9)
    105.0
    """

    per_dimension: int

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if not 5 <= self.per_dimension <= 4001:
            raise InputsError(
                f"germ grid of {self.per_dimension} nodes a dimension: not between 5 and 4001",
                "401 for one parameter, 61 for two and 25 for three are usual",
            )

    def nodes(self, inputs: Inputs, alpha: Array) -> Nodes:
        """The grid at alpha. Cost O(J n K)."""
        germ, weights = _grid(self.per_dimension, inputs.scattering)
        x, dx = inputs.image(alpha, germ)
        return Nodes(x, weights, dx, np.zeros((weights.size, inputs.size)))

    def size(self, inputs: Inputs) -> int:
        """Nodes that are not negligible."""
        return int(_grid(self.per_dimension, inputs.scattering)[1].size)


@lru_cache(maxsize=8)
def _grid(per_dimension: int, dimensions: int) -> tuple[Array, Array]:
    if dimensions == 0:
        return np.zeros((1, 0)), np.ones(1)
    affordable(per_dimension**dimensions)
    theta = np.linspace(-REACH, REACH, per_dimension)
    germ = theta[tensor((per_dimension,) * dimensions)]
    weights = np.exp(-0.5 * np.sum(germ**2, axis=1))
    kept = weights > NEGLIGIBLE * weights.max()
    germ, weights = germ[kept], weights[kept] / weights[kept].sum()
    germ.setflags(write=False)
    weights.setflags(write=False)
    return germ, weights
