"""What every choice of nodes offers."""

from __future__ import annotations

from typing import Protocol

from aleator.errors import InputsError
from aleator.laws import Inputs
from aleator.moments.quadrature.nodes import Nodes
from aleator.types import Array

MOST_NODES = 1_000_000
"""Nodes beyond which a rule is refused rather than left to exhaust the memory."""


class Cubature(Protocol):
    """A choice of nodes for the joint law."""

    def nodes(self, inputs: Inputs, alpha: Array) -> Nodes:
        """Nodes and weights of the law alpha (K,), with their derivatives by alpha."""
        ...


def check_whole(name: str, value: int, lower: int, upper: int | None) -> None:
    """Raise InputsError unless the value is a whole number within its limits."""
    if type(value) is not int or value < lower or (upper is not None and value > upper):
        limits = f"between {lower} and {upper}" if upper is not None else f"of at least {lower}"
        raise InputsError(
            f"{name} = {value!r} is not a whole number {limits}", "choose one in that range"
        )


def affordable(count: int) -> None:
    """Raise InputsError for more nodes than fit the memory."""
    if count > MOST_NODES:
        raise InputsError(
            f"this rule has {count:.3g} nodes, more than {MOST_NODES:.0e}",
            "use fewer nodes a dimension, Smolyak(level) or SobolPoints(points)",
        )
