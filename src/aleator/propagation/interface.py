"""What a propagation is given, and what it gives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from aleator.moments import Moments
from aleator.outcomes import Outcomes

Array = NDArray[np.float64]
Run = Callable[[NDArray[np.int64], Array], Array]


class Response(Protocol):
    """Outcomes of all N experiments at the same points of the box."""

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) at points x (J, n)."""
        ...

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes (N, J) and their derivatives (N, J, n) at points x (J, n)."""
        ...


class Propagation(Protocol):
    """alpha (K,) to what is known of the N outcomes, without noise."""

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments up to `order`, with jacobians by alpha if asked for."""
        ...


@runtime_checkable
class NodePropagation(Propagation, Protocol):
    """A propagation that knows the outcomes at nodes, as a `NodeDensity` needs them."""

    def outcomes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        """Outcomes at the nodes of the law, with derivatives by alpha if asked for."""
        ...
