"""A rule of nodes from outside the package: Halton points of the law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.core.types import Array
from aleator.laws import Inputs
from aleator.laws.quadrature import CubatureNodes


@dataclass(frozen=True)
class Halton:
    """Scrambled Halton points, the same for every alpha, with equal weights."""

    points: int = 256
    seed: int = 0

    def nodes(self, inputs: Inputs, alpha: Array) -> CubatureNodes:
        unit = qmc.Halton(inputs.scattering, rng=self.seed).random(self.points)
        x, dx = inputs.image(alpha, special.ndtri(unit))
        weights = np.full(self.points, 1.0 / self.points)
        return CubatureNodes(x, weights, dx, np.zeros((self.points, inputs.size)))
