"""Steps of an ascent that the objective knows itself."""

from __future__ import annotations

import numpy as np

from aleator.search.coordinates import Coordinates
from aleator.search.counted import CountedObjective
from aleator.types import Array

LEAST = 1.0
"""Log-likelihood that a step must gain for another one: near a maximum others are faster."""
STEPS = 10


def approached(
    objective: CountedObjective, coordinates: Coordinates, start: Array, most: int
) -> tuple[Array, int]:
    """The best alpha (K,) on the objective's own way from `start`, and how many evaluations.

    It is the start itself where no step gains, or none is known (see `Guiding`).
    """
    best, alpha, value = start, start, -np.inf
    for count in range(min(STEPS, most)):
        found = objective.toward(alpha)
        if found is None:
            return start, 0
        gain = found[0] - value
        if gain > 0.0:
            best, value = alpha, found[0]
        if gain < LEAST:
            return best, count + 1
        alpha = coordinates.filled(found[1][coordinates.free])
    return best, max(min(STEPS, most), 0)
