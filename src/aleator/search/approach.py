"""The first steps of an ascent, which the objective knows itself."""

from __future__ import annotations

from aleator.search.coordinates import Coordinates
from aleator.search.counted import FLOOR, CountedObjective
from aleator.types import Array

LEAST = 1.0
"""Log-likelihood that a step must gain for another one: near a maximum others are faster."""
STEPS = 10


def approached(
    objective: CountedObjective, coordinates: Coordinates, start: Array, most: int
) -> tuple[Array, int]:
    """The alpha (K,) to climb from, and how many evaluations it took.

    It is the start itself where the objective knows no way (see `Guiding`).
    """
    known, best, alpha = start, FLOOR, start
    for count in range(min(STEPS, most)):
        found = objective.toward(alpha)
        if found is None:
            return start, 0
        value, ahead = found
        gain = value - best
        if gain > 0.0:
            known, best = alpha, value
        if gain < LEAST:
            return known, count + 1
        alpha = coordinates.filled(ahead[coordinates.free])
    return known, min(STEPS, most)
