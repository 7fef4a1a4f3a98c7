"""What a propagation is given, and what it gives."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from aleator.moments.densities.moments import Moments
from aleator.moments.densities.outcomes import Outcomes
from aleator.types import Array


class Propagation(Protocol):
    """alpha (K,) to what is known of the N outcomes, without noise."""

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments up to `order`, with jacobians by alpha if asked for."""
        ...


@runtime_checkable
class NodePropagation(Propagation, Protocol):
    """A propagation that knows the outcomes at nodes, which moments are computed from."""

    def outcomes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        """Outcomes at the nodes of the law, with derivatives by alpha if asked for."""
        ...

    def at(self, alpha: Array) -> Array:
        """The nodes x (J, n)."""
        ...
