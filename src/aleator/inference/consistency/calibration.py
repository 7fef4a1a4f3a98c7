"""Probabilities of statistics from few replicates, and of the smallest of many."""

from __future__ import annotations

import numpy as np
from scipy import special

from aleator.types import Array, Flags

FLATTEST = 1e-12
"""A statistic whose replicates scatter less than this, over its size, tells nothing."""
STRAIGHT = 1e-3
"""A skewness below this is none."""
SHRUNK = 20.0
"""The skewness of B replicates is taken B/(B + this) times."""


def probabilities(
    observed: Array, replicates: Array, skewed: Flags, one_sided: Flags, least: Array
) -> tuple[Array, Array, Array]:
    """p (T,) of observed statistics, p (B, T) of each replicate among the others, and z (T,).

    By the normal law, and where `skewed` by Pearson's third with the skewness of the replicates
    (Wilson and Hilferty, 1931); Student's t with B - 1 degrees of freedom is for their mean and
    scatter, which are estimated. So a few dozen replicates tell small probabilities. They are taken
    to scatter by `least` (T,) more; the probability is one where they do not scatter at all.
    """
    count = len(replicates)
    mean = replicates.mean(axis=0)
    sd = np.hypot(replicates.std(axis=0, ddof=1), least)
    flat = ~(sd > FLATTEST * (1.0 + np.abs(mean)))
    scale = np.where(flat, 1.0, sd)
    third = np.mean(((replicates - mean) / scale) ** 3, axis=0)
    skewness = np.where(skewed, third, 0.0) * count / (count + SHRUNK)
    z = _normal((observed - mean) / scale, skewness) / np.sqrt(1.0 + 1.0 / count)
    own = _normal((replicates - mean) / scale, skewness)
    r = np.clip(own / np.sqrt(1.0 - 1.0 / count), -np.sqrt(count - 1.01), np.sqrt(count - 1.01))
    left_out = r * np.sqrt((count - 2.0) / (count - 1.0 - r**2))
    p = np.where(flat, 1.0, _tail(z, count - 1.0, one_sided))
    return p, np.where(flat, 1.0, _tail(left_out, count - 2.0, one_sided)), np.where(flat, 0.0, z)


def effective(smallest: Array) -> float:
    """How many independent tests have such smallest p (B,): P(p_min < p) = 1 - (1 - p)^m.

    The maximum of the likelihood from the lower half of the replicates, the others counted as
    larger: the tail is what matters.
    """
    limit = float(np.median(smallest))
    low = smallest[smallest < limit]
    told = -np.log1p(-low).sum() - (smallest.size - low.size) * np.log1p(-limit)
    return low.size / told if told > 0.0 else 1.0


def corrected(p: Array, tests: float) -> Array:
    """The probability that the smallest of so many is as small."""
    return np.asarray(-np.expm1(tests * np.log1p(-np.minimum(p, 1.0 - 1e-15))))


def _normal(z: Array, skewness: Array) -> Array:
    """Standardized values of a skewed law as normal ones; a skewness near zero changes nothing.

    Only on the side of the long tail: where the short one ends hangs on a skewness that few
    replicates hardly know.
    """
    straight = (np.abs(skewness) < STRAIGHT) | (z * skewness < 0.0)
    g = np.where(straight, 1.0, skewness)
    inside = np.cbrt(np.maximum(0.5 * g * z + 1.0, 0.0))
    return np.where(straight, z, 6.0 / g * (inside - 1.0) + g / 6.0)


def _tail(z: Array, freedom: float, one_sided: Flags) -> Array:
    upper = special.stdtr(freedom, -z)
    return np.asarray(np.where(one_sided, upper, 2.0 * special.stdtr(freedom, -np.abs(z))))
