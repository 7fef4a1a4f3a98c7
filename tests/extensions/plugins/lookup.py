"""A simulator from outside the package: a curve of the outcome over one parameter, in a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array
from aleator.errors import SimulatorError


@dataclass(frozen=True)
class Lookup:
    """The outcome by linear interpolation in the rows `parameter,outcome` of a CSV file.

    Raises SimulatorError where the table cannot be read.
    """

    lookup: Path
    block: int = 8192

    @property
    def name(self) -> str:
        return f"lookup in {self.lookup.name}"

    @cached_property
    def _curve(self) -> Array:
        try:
            return np.loadtxt(self.lookup, delimiter=",", ndmin=2).T
        except (OSError, ValueError) as error:
            raise SimulatorError(f"{self.lookup}: {error}", "give a CSV file of numbers") from error

    def asks(self, _: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """It takes no condition, and one parameter."""
        if len(self._curve) != 2 or len(parameters) != 1:
            raise SimulatorError(
                f"a curve of {len(self._curve) - 1} for {len(parameters)} parameters",
                "give a table of two columns, and one parameter",
            )
        return ()

    def __call__(self, _: Mapping[str, NDArray[Any]], parameters: Mapping[str, Array]) -> Array:
        (x,) = parameters.values()
        return np.interp(x, *self._curve)

    def fingerprint(self) -> str:
        return sha256(self.lookup.read_bytes()).hexdigest()
