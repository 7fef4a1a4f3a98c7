"""The cheapest way to exact moments, by a model of the cost."""

from __future__ import annotations

from dataclasses import dataclass

from aleator.errors import InputsError
from aleator.expansion.moments.basis import Basis
from aleator.expansion.moments.galerkin import MOST_ENTRIES, Galerkin, entry_bound
from aleator.expansion.moments.interface import Powers
from aleator.expansion.moments.tensor_gauss import MOST_NODES, TensorGauss, node_count

# Seconds on one core, fitted to n = 1..10, d = 2..8, m = 4..8, Hermite and Laguerre; only their
# ratios matter. Online is with the gradient, the more expensive and the more frequent use.
TENSOR_PREPARATION = 0.5e-3
TENSOR_NODE = 20e-9
GALERKIN_PREPARATION = 1e-3
GALERKIN_FUNCTION = 0.06e-3
GALERKIN_ENTRY_PREPARATION = 300e-9
GALERKIN_ENTRY = 4e-9
GALERKIN_FILLING = 0.5
"""The entries that occur, over their bound: 0.26 to 1.0."""


@dataclass(frozen=True)
class Automatic:
    """`TensorGauss` or `Galerkin`, whichever costs less for this basis, order and use.

    `expansions` is how many expansions (experiments times values of alpha) will be evaluated for
    each preparation. With few parameters a tensor rule wins, with five or more Galerkin products;
    at four it depends on degree, order and use. Raises InputsError for expansions below one.
    """

    expansions: int = 1_000

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.expansions < 1:
            raise InputsError(f"Automatic: {self.expansions} expansions", "use 1 or more")

    def powers(self, basis: Basis, order: int) -> Powers:
        """The offline step of the cheaper way."""
        return cheapest(basis, order, self.expansions).powers(basis, order)


def cheapest(basis: Basis, order: int, expansions: int) -> TensorGauss | Galerkin:
    """The way that should take least time to prepare and to evaluate so many expansions.

    >>> from aleator.polynomials.indices import TotalDegree
    >>> from aleator.polynomials.recurrence import hermite_recurrence
    >>> def basis(n, d):
    ...     return Basis((hermite_recurrence(9),) * n, TotalDegree(d).indices((None,) * n))
    >>> cheapest(basis(2, 3), 5, 1_000), cheapest(basis(10, 2), 4, 1_000)
    (TensorGauss(), Galerkin())
    """
    tensor, galerkin = estimated_seconds(basis, order, expansions)
    return TensorGauss() if tensor < galerkin else Galerkin()


def estimated_seconds(basis: Basis, order: int, expansions: int) -> tuple[float, float]:
    """Seconds of `TensorGauss` and of `Galerkin`, infinite for what they refuse.

    Right within a factor of about three on the machine where it was fitted.
    """
    nodes = node_count(basis, order)
    entries = entry_bound(basis, order)
    tensor = TENSOR_PREPARATION + TENSOR_NODE * nodes * expansions
    filled = GALERKIN_FILLING * entries
    galerkin = (
        GALERKIN_PREPARATION
        + GALERKIN_FUNCTION * basis.size * ((order - 1) // 2)
        + filled * (GALERKIN_ENTRY_PREPARATION + GALERKIN_ENTRY * expansions)
    )
    return (
        tensor if nodes <= MOST_NODES else float("inf"),
        galerkin if entries <= MOST_ENTRIES else float("inf"),
    )
