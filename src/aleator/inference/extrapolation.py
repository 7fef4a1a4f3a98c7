"""How far new conditions are beyond those that were tested, and why, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy import optimize

from aleator.core.types import Array


@dataclass(frozen=True)
class ExtrapolationSettings:
    """When conditions are beyond the tested ones; by judgement."""

    most: int = 2000
    """Distinct tested points up to which their convex hull is asked."""
    rounding: float = 1e-9


EXTRAPOLATION = ExtrapolationSettings()


def beyond_range(
    tested: Array, new: Array, settings: ExtrapolationSettings = EXTRAPOLATION
) -> Array:
    """Signed distances (Q, d) of new points (Q, d) from the range of the tested ones (R, d).

    In units of the tested range: 0.5 is half of it above the highest, zero within. Infinite
    where it has no width and the value is another.

    >>> beyond_range(np.array([[0.0], [2.0]]), np.array([[1.0], [3.0], [-1.0]])).ravel().tolist()
    [0.0, 0.5, -0.5]
    """
    low, high = tested.min(axis=0), tested.max(axis=0)
    width = np.where(high > low, high - low, 0.0)
    away = np.maximum(new - high, 0.0) - np.maximum(low - new, 0.0)
    size = np.maximum(np.abs(low), np.abs(high))
    away = np.where(np.abs(away) > settings.rounding * np.maximum(width, size), away, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(away == 0.0, 0.0, away / width))


def beyond_hull(
    tested: Array, new: Array, settings: ExtrapolationSettings = EXTRAPOLATION
) -> Array:
    """Distances (Q,) of new points (Q, d) from the convex hull of the tested ones (R, d).

    The least t such that a mean of tested points is within t tested ranges of the new one in every
    coordinate: min t, |sum_r w_r x_r - x| <= t, w >= 0, sum w = 1, a linear program. Zero for what
    lies between tested points; never less than the farthest `beyond_range`, which it is with more
    than 2000 distinct points. Cost: some milliseconds a point.

    >>> corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    >>> beyond_hull(corners, np.array([[0.2, 0.2], [1.0, 1.0]])).round(3).tolist()
    [0.0, 0.5]
    """
    single = np.abs(beyond_range(tested, new, settings=settings)).max(axis=1, initial=0.0)
    low = tested.min(axis=0)
    width = tested.max(axis=0) - low
    varied = width > 0.0
    points = np.unique((tested[:, varied] - low[varied]) / width[varied], axis=0)
    if varied.sum() < 2 or len(points) > settings.most:
        return np.asarray(single)
    asked = (new[:, varied] - low[varied]) / width[varied]
    found = [
        own if np.isinf(own) else max(own, _from_hull(points, x, settings))
        for own, x in zip(single.tolist(), asked, strict=True)
    ]
    return np.array(found)


def _from_hull(points: Array, x: Array, settings: ExtrapolationSettings) -> float:
    count, d = points.shape
    slack = np.ones((d, 1))
    rows = np.vstack([np.hstack([points.T, -slack]), np.hstack([-points.T, -slack])])
    total = np.append(np.ones(count), 0.0)[None]
    cost = np.append(np.zeros(count), 1.0)
    found = optimize.linprog(
        cost, A_ub=rows, b_ub=np.concatenate([x, -x]), A_eq=total, b_eq=np.ones(1), method="highs"
    )
    distance = float(found.fun) if found.success else float("nan")
    return distance if distance > settings.rounding else 0.0


@dataclass(frozen=True, eq=False)
class Beyond:
    """Distances (R,) of R rows from the tested ones, in tested ranges, and why, in words.

    Zero within the convex hull of the tested conditions; infinite for a level or a value of a
    condition that was never varied. `why` is "" for rows within.
    """

    distance: Array
    why: tuple[str, ...]


def compared(
    tested: pd.DataFrame, new: pd.DataFrame, settings: ExtrapolationSettings = EXTRAPOLATION
) -> Beyond:
    """Rows of new conditions against tested ones, column by column and jointly.

    >>> tested = pd.DataFrame({"load": [1.0, 3.0], "oil": ["a", "b"]})
    >>> compared(tested, pd.DataFrame({"load": [2.0, 4.0, 2.0], "oil": ["a", "a", "c"]})).why
    ('', 'load is 0.5 tested ranges above the highest', "oil 'c' was never tested")
    """
    numbers = [str(n) for n in tested if _is_number(tested[n]) and _is_number(new[n])]
    texts = [name for name in tested if name not in numbers]
    here, there = (frame[numbers].to_numpy(dtype=float) for frame in (tested, new))
    each = beyond_range(here, there, settings=settings) if numbers else np.zeros((len(new), 0))
    distance = beyond_hull(here, there, settings=settings) if numbers else np.zeros(len(new))
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
