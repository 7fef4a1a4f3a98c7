"""Response surfaces as the check uses them: a stand-in for the simulator that costs no run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aleator.surrogates import Surface
from aleator.surrogates.responses import moving_parameters
from aleator.types import Array, Indices


class Emulator(Protocol):
    """A cheap stand-in for the noise-free simulator; the check corrects it by runs."""

    def at(self, index: Indices, x: Array) -> Array:
        """Outcomes (R,) of experiments `index` (R,) at points x (R, n)."""

    def evaluate(self, x: Array, rows: Indices) -> Array:
        """Outcomes (N', J) of experiments `rows` (N',) at the same points x (J, n)."""


@dataclass(frozen=True)
class SurfaceEmulator:
    """Surfaces of U distinct conditions within their region (n, 2), for N experiments.

    `condition` (N,) says which surface is whose.
    """

    surface: Surface
    region: Array
    condition: Indices

    def at(self, index: Indices, x: Array) -> Array:
        """Outcomes (R,) at points moved into the region."""
        return self.surface.at(self.condition[index], self._inside(x))

    def evaluate(self, x: Array, rows: Indices) -> Array:
        """Outcomes (N', J) at points moved into the region."""
        asked, of = np.unique(self.condition[rows], return_inverse=True)
        return self.surface.take(asked).evaluate(self._inside(x))[of]

    def _inside(self, x: Array) -> Array:
        inside = np.clip(x, self.region[:, 0], self.region[:, 1])
        return np.asarray(inside[:, moving_parameters(self.region)])
