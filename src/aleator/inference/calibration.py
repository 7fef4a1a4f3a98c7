"""Whether probabilities look uniform: their histogram and their cumulative share, with bands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binom, kstwo

from aleator.types import Array

FEWEST, MOST = 2, 20
"""Bins of a histogram."""
EACH = 10
"""Values that a bin should have."""


@dataclass(frozen=True, eq=False)
class Counted:
    """Counts (B,) between `edges` (B + 1,); of a uniform sample 95 % lie from `low` to `high`."""

    edges: Array
    counts: Array
    low: float
    high: float
    expected: float


@dataclass(frozen=True, eq=False)
class Cumulated:
    """The cumulative share minus the uniform one, as a line, and where 95 % of all samples stay."""

    x: Array
    difference: Array
    band_x: Array
    band_low: Array
    band_high: Array


def counted(pit: Array) -> Counted:
    """The histogram of probabilities (N,), with the binomial range of each bin.

    >>> found = counted(np.array([0.1, 0.2, 0.7]))
    >>> found.counts.tolist(), found.expected
    ([2, 1], 1.5)
    """
    bins = int(np.clip(pit.size // EACH, FEWEST, MOST))
    counts, edges = np.histogram(pit, bins, (0.0, 1.0))
    low, high = binom.ppf([0.025, 0.975], pit.size, 1.0 / bins)
    return Counted(edges, counts, float(low), float(high), pit.size / bins)


def cumulated(pit: Array) -> Cumulated:
    """The difference of the cumulative share of probabilities (N,) from uniform.

    The band holds the whole curve in 95 % of all uniform samples (Kolmogorov).

    >>> cumulated(np.array([0.25])).difference.tolist()
    [0.0, -0.25, 0.75, 0.0]
    """
    reach = float(kstwo.ppf(0.95, pit.size))
    x = np.sort([0.0, reach, 1.0 - reach, 1.0])
    share = np.arange(pit.size + 1) / pit.size
    # from each jump of the share straight down to the next: two points for each probability
    ends = np.concatenate([[0.0], np.repeat(np.sort(pit), 2), [1.0]])
    difference = np.repeat(share, 2) - ends
    return Cumulated(ends, difference, x, np.maximum(-reach, -x), np.minimum(reach, 1.0 - x))
