"""What more runs would make of surfaces, by how their errors fell so far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from aleator.surrogates.adaptive import GROWTH, AdaptiveSurfaces
from aleator.types import Array

SLOWEST, FASTEST = 0.5, 6.0
"""Powers of the number of runs by which errors may be taken to fall."""


@dataclass(frozen=True)
class Outlook:
    """Of `surfaces`, `rough` are not exact enough: their largest error is `worst` of the scatter.

    `needed` runs would bring all of them to `level`, and `more` runs the largest error to `then`;
    both are None where no surface has had a round of runs after its first.
    """

    rough: int
    surfaces: int
    worst: float
    level: float
    more: int
    needed: int | None
    then: float | None


def outlook(surfaces: AdaptiveSurfaces, more: int = 1000) -> Outlook:
    """Extrapolate e ~ R^-p, with the median p of the last rounds of the rough surfaces.

    A rough guide: errors fall fast, or hardly, as soon as a surface sees what it has to follow.
    """
    relative, runs = surfaces.relative, surfaces.emulator.runs.astype(np.float64)
    rough = ~surfaces.good & np.isfinite(relative)
    count, level = int(rough.sum()), surfaces.level
    worst = float(relative[rough].max(initial=0.0))
    power = _power(surfaces.past[-1, rough], relative[rough])
    if not count or power is None:
        return Outlook(count, rough.size, worst, level, more, None, None)

    def price(goal: float) -> float:
        times = np.maximum(relative[rough] / goal, 1.0) ** (1.0 / power)
        return float(runs[rough] @ (times - 1.0))

    needed = int(np.ceil(price(level)))
    then = level if needed <= more else float(brentq(lambda e: price(e) - more, level, worst))
    return Outlook(count, rough.size, worst, level, more, needed, then)


def _power(before: Array, now: Array) -> float | None:
    """By which power of the number of runs the errors fell in the last round; None if unknown."""
    known = np.isfinite(before) & (before > 0.0) & (now > 0.0)
    if not known.any():
        return None
    powers = np.log(before[known] / now[known]) / np.log1p(GROWTH)
    return float(np.clip(np.median(powers), SLOWEST, FASTEST))
