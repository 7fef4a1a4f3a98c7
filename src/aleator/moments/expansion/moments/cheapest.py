"""The cheapest way to exact moments, by a model of the cost."""

from __future__ import annotations

from aleator.moments.expansion.basis import Basis
from aleator.moments.expansion.moments.exact_quadrature import (
    MOST_NODES,
    ExactQuadrature,
    node_count,
)
from aleator.moments.expansion.moments.galerkin import MOST_ENTRIES, Galerkin, entry_bound
from aleator.types import Indices

# Seconds on one core, fitted to n = 1..10, d = 2..8, m = 4..8, Hermite and Laguerre; only their
# ratios matter. Online is with the gradient, the more expensive and the more frequent use.
QUADRATURE_PREPARATION = 0.5e-3
QUADRATURE_NODE = 20e-9
GALERKIN_PREPARATION = 1e-3
GALERKIN_FUNCTION = 0.06e-3
GALERKIN_ENTRY_PREPARATION = 300e-9
GALERKIN_ENTRY = 4e-9
GALERKIN_FILLING = 0.5
"""The entries that occur, over their bound: 0.26 to 1.0."""


def cheapest(
    basis: Basis, indices: Indices, order: int, expansions: int
) -> ExactQuadrature | Galerkin:
    """The way that should take least time to prepare and to evaluate so many expansions.

    With few parameters quadrature wins, with five or more Galerkin products; at four it depends on
    degree, order and use.

    >>> from aleator.moments.expansion.indices import TotalDegree
    >>> def choice(n, d, order):
    ...     indices = TotalDegree(d).indices((None,) * n)
    ...     return cheapest(Basis.normal(n), indices, order, expansions=1_000)
    >>> choice(2, 3, 5), choice(10, 2, 4)
    (ExactQuadrature(), Galerkin())
    """
    quadrature, galerkin = estimated_seconds(basis, indices, order, expansions)
    return ExactQuadrature() if quadrature < galerkin else Galerkin()


def estimated_seconds(
    basis: Basis, indices: Indices, order: int, expansions: int
) -> tuple[float, float]:
    """Seconds of `ExactQuadrature` and of `Galerkin`, infinite for what they refuse.

    Right within a factor of about three on the machine where it was fitted.
    """
    nodes = node_count(indices, order)
    entries = entry_bound(basis, indices, order)
    quadrature = QUADRATURE_PREPARATION + QUADRATURE_NODE * nodes * expansions
    filled = GALERKIN_FILLING * entries
    galerkin = (
        GALERKIN_PREPARATION
        + GALERKIN_FUNCTION * len(indices) * ((order - 1) // 2)
        + filled * (GALERKIN_ENTRY_PREPARATION + GALERKIN_ENTRY * expansions)
    )
    return (
        quadrature if nodes <= MOST_NODES else float("inf"),
        galerkin if entries <= MOST_ENTRIES else float("inf"),
    )
