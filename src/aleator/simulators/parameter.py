"""A parameter as its own outcome, so that what is asked of outcomes can be asked of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from aleator.core.types import Array
from aleator.simulators.protocol import BLOCKS, Columns


@dataclass(frozen=True)
class ParameterItself:
    """A simulator that takes no conditions, and returns the parameter `name`.

    >>> import numpy as np
    >>> ParameterItself("gap")({}, {"gap": np.array([9.0, 11.0]), "length": np.array([1.0, 1.0])})
    array([ 9., 11.])
    """

    name: str
    block: ClassVar[int] = BLOCKS.arrays
    vectorized: ClassVar[bool] = True

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:  # noqa: ARG002
        """No condition matters."""
        return ()

    def __call__(self, conditions: Columns, parameters: Columns) -> Array:  # noqa: ARG002
        """The values (R,) of the parameter."""
        return parameters[self.name]

    def fingerprint(self) -> str:
        """The name says all."""
        return f"parameter {self.name}"
