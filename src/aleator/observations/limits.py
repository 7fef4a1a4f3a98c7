"""Limits of a test, as its censored values tell them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aleator.observations.responses import Observations
from aleator.types import Array


def limits_of(seen: Observations) -> list[tuple[float, float]] | None:
    """Lower and upper limit of each response, infinite without one; values beyond are censored.

    A response whose right-censored values all have one bound has that as its upper limit. None
    where bounds differ, and where values lie between two bounds: these are no limits of a test.

    >>> seen = Observations.exact([1.0, 2.0, 2.0])
    >>> limits_of(replace(seen, upper=[1.0, np.inf, np.inf]))
    [(-inf, 2.0)]
    """
    found = []
    for k in range(len(seen.responses)):
        own = (seen.response == k) & seen.censored
        above = np.unique(seen.lower[own & np.isposinf(seen.upper)])
        below = np.unique(seen.upper[own & np.isneginf(seen.lower)])
        between = own & np.isfinite(seen.lower) & np.isfinite(seen.upper)
        if above.size > 1 or below.size > 1 or np.any(between):
            return None
        found.append((float(below[0]) if below.size else -np.inf,
                      float(above[0]) if above.size else np.inf))  # fmt: skip
    return found


def limited_alike(asked: Observations, seen: Observations) -> Observations:
    """Observations that were not made (M,), with the limits of the test of those that were seen.

    As long as nothing is known of a new value, it is one beyond a limit.
    """
    lower, upper = asked.lower.copy(), asked.upper.copy()
    for k, (low, high) in enumerate(limits_of(seen) or []):
        new = asked.response == k
        if np.isfinite(high):
            lower[new], upper[new] = high, np.inf
        elif np.isfinite(low):
            lower[new], upper[new] = -np.inf, low
    return replace(asked, lower=lower, upper=upper)


def ends_of(seen: Observations, limits: list[tuple[float, float]]) -> tuple[Array, Array]:
    """The limits of each observation, (M,)."""
    each = np.array(limits).reshape(-1, 2)[seen.response]
    return each[:, 0], each[:, 1]
