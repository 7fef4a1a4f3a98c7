"""Which rows of new conditions are beyond those that were tested, and how far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from aleator.inference.decisions.extrapolation import beyond_hull, beyond_range
from aleator.tasks.decide.ground import Ground
from aleator.types import Array


@dataclass(frozen=True, eq=False)
class Beyond:
    """Distances (R,) of R rows from the tested ones, in tested ranges, and why, in words.

    Zero within the convex hull of the tested conditions; infinite for a level or a value of a
    condition that was never varied. `why` is "" for rows within.
    """

    distance: Array
    why: tuple[str, ...]


def beyond(ground: Ground) -> Beyond | None:
    """Of the conditions that the simulator asks for, and the covariates of the laws.

    None where the experiments that were measured are not at hand.
    """
    if ground.tested is None:
        return None
    new, tested = ground.conditions.table, ground.tested.table
    asked = dict.fromkeys([*ground.runner.cases.columns, *ground.inputs.covariates])
    names = [name for name in asked if name in new and name in tested]
    return compared(tested[names], new[names])


def compared(tested: pd.DataFrame, new: pd.DataFrame) -> Beyond:
    """Rows of new conditions against tested ones, column by column and jointly.

    >>> tested = pd.DataFrame({"load": [1.0, 3.0], "oil": ["a", "b"]})
    >>> compared(tested, pd.DataFrame({"load": [2.0, 4.0, 2.0], "oil": ["a", "a", "c"]})).why
    ('', 'load is 0.5 tested ranges above the highest', "oil 'c' was never tested")
    """
    numbers = [str(n) for n in tested if _is_number(tested[n]) and _is_number(new[n])]
    texts = [name for name in tested if name not in numbers]
    here, there = (frame[numbers].to_numpy(dtype=float) for frame in (tested, new))
    each = beyond_range(here, there) if numbers else np.zeros((len(new), 0))
    distance = beyond_hull(here, there) if numbers else np.zeros(len(new))
    words = [_words(numbers, row, far) for row, far in zip(each, distance.tolist(), strict=True)]
    for name in texts:
        known = set(map(str, tested[name]))
        for row, cell in enumerate(map(str, new[name])):
            if cell not in known:
                distance[row] = np.inf
                words[row] = f"{name} '{cell}' was never tested"
    return Beyond(distance, tuple(words))


def _is_number(column: pd.Series[Any]) -> bool:
    return bool(pd.api.types.is_numeric_dtype(column))


def _words(names: Sequence[str], each: Array, distance: float) -> str:
    if not distance > 0.0:
        return ""
    if not np.any(each):
        return f"{' and '.join(names)} were never tested together so: {distance:.2g} tested ranges"
    parts = []
    for name, away in zip(names, each.tolist(), strict=True):
        side = "above the highest" if away > 0.0 else "below the lowest"
        if np.isinf(away):
            parts.append(f"{name} was never varied")
        elif away:
            parts.append(f"{name} is {abs(away):.2g} tested ranges {side}")
    return ", ".join(parts)
