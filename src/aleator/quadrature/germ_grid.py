"""An even grid of standard normal variates: for what varies too fast for a polynomial rule."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import sparse

from aleator.errors import InputsError
from aleator.laws import Inputs
from aleator.polynomials.gauss import tensor
from aleator.quadrature.interface import affordable
from aleator.quadrature.nodes import Lattice, Nodes
from aleator.types import Array, Flags, Indices

REACH = 8.0
"""Ends of the grid in standard deviations: the mass beyond is 1e-15."""
NEGLIGIBLE = 1e-16
"""Nodes whose weight is below this share of the largest are left out: the grid is a ball."""
LARGEST_WAVE = 0.02
"""What the ripple of a smoothed grid may do to the information that one outcome has on a shift."""
WIDEST = 0.7
"""Grids whose smoothing would be wider, in standard deviations, carry no lattice."""


@dataclass(frozen=True)
class GermGrid:
    """The trapezoidal rule in standard normal variates, mapped by the laws.

    theta on an even grid of `per_dimension` m points from -8 to 8 in every scattering parameter,
    weights proportional to phi(theta). For smooth integrands it converges as fast as a Gauss rule
    (Trefethen and Weideman, 2014), and it resolves narrow ones: a normal density of standard
    deviation s in theta is integrated to 2 exp(-2 pi^2 s^2/h^2) with the step h = 16/(m - 1), where
    a Gauss rule of m nodes has far wider gaps. Meant for densities fitted to the nodes themselves,
    for which the nodes carry their `Lattice` (m of 17 and more).
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
                f"grid of {self.per_dimension} variates a dimension: not between 5 and 4001",
                "401 for one parameter, 61 for two and 25 for three are usual",
            )

    def nodes(self, inputs: Inputs, alpha: Array) -> Nodes:
        """The grid at alpha. Cost O(J n K)."""
        variates, weights, lattice = _grid(self.per_dimension, inputs.scattering)
        x, dx = inputs.image(alpha, variates)
        return Nodes(x, weights, dx, np.zeros((weights.size, inputs.size)), lattice)


@lru_cache(maxsize=8)
def _grid(per_dimension: int, dimensions: int) -> tuple[Array, Array, Lattice | None]:
    if dimensions == 0:
        return np.zeros((1, 0)), np.ones(1), None
    affordable(per_dimension**dimensions)
    theta = np.linspace(-REACH, REACH, per_dimension)
    variates = theta[tensor((per_dimension,) * dimensions)]
    square = np.sum(variates**2, axis=1)
    weights = np.exp(-0.5 * square)
    kept = weights > NEGLIGIBLE * weights.max()
    variates, square, weights = variates[kept], square[kept], weights[kept] / weights[kept].sum()
    step = theta[1] - theta[0]
    width = _width(step)
    lattice = None
    if width < WIDEST:
        pairs = _neighbors(kept.reshape((per_dimension,) * dimensions))
        first, second = zip(*(_differences(*pair, step) for pair in pairs), strict=True)
        lattice = Lattice(square, width, float(step), first, second)
    for array in (variates, square, weights):
        array.setflags(write=False)
    return variates, weights, lattice


def _width(step: float) -> float:
    """The least smoothing tau that leaves no spikes on a grid of this step h, whatever the noise.

    Normals of deviation tau at distance h ripple by 2 exp(-2 pi^2 tau^2/h^2) (Poisson's sum) with
    frequency 2 pi/h: twice differentiated that is LARGEST_WAVE.
    """
    frequency = 2.0 * np.pi / step
    return float(np.sqrt(2.0 * np.log(2.0 * frequency**2 / LARGEST_WAVE)) / frequency)


def _neighbors(kept: Flags) -> list[tuple[Indices, Indices]]:
    """For every axis the nodes (J,) to the left and to the right, -1 where there is none."""
    number = np.where(kept, np.cumsum(kept).reshape(kept.shape) - 1, -1)
    pairs = []
    for axis in range(kept.ndim):
        edge = np.full_like(number.take([0], axis), -1)
        wide = np.concatenate([edge, number, edge], axis=axis)
        inside = np.arange(number.shape[axis])
        pairs.append((wide.take(inside, axis)[kept], wide.take(inside + 2, axis)[kept]))
    return pairs


def _differences(
    left: Indices, right: Indices, step: float
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Matrices (J, J) of first and second differences along one axis."""
    node = np.arange(left.size)
    both = (left >= 0) & (right >= 0)
    left, right = np.where(left < 0, node, left), np.where(right < 0, node, right)
    slope = 1.0 / (step * np.where(both, 2.0, 1.0))
    bend = both / step**2
    shape = (node.size, node.size)
    rows = np.tile(node, 3)
    first = sparse.csr_array(
        (np.concatenate([slope, -slope]), (rows[: 2 * node.size], np.concatenate([right, left]))),
        shape=shape,
    )
    second = sparse.csr_array(
        (np.concatenate([bend, -2.0 * bend, bend]), (rows, np.concatenate([left, node, right]))),
        shape=shape,
    )
    return first, second
