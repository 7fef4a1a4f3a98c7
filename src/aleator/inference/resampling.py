"""What replicates of an estimate tell of its error: bias, standard errors, intervals."""

from __future__ import annotations

import numpy as np
from scipy import special

from aleator.inference.information import LEVEL
from aleator.types import Array


def percentile(alpha: Array, level: float = LEVEL) -> Array:
    """Intervals (F, 2) between quantiles of replicates (R, F); NaN without any."""
    return quantiles(alpha, np.full((alpha.shape[1], 2), _tails(level)))


def basic(estimate: Array, alpha: Array, level: float = LEVEL) -> Array:
    """Intervals (F, 2) by the errors, estimate - (quantile - estimate) (Efron 1979)."""
    return np.asarray(2.0 * estimate[:, None] - percentile(alpha, level)[:, ::-1])


def bias_corrected(estimate: Array, alpha: Array, influence: Array, level: float = LEVEL) -> Array:
    """BCa intervals (F, 2) of replicates (R, F), second-order right (Efron 1987).

    The quantiles are those of the levels Phi(z0 + (z0 + z)/(1 - a (z0 + z))), z = Phi^-1 of the
    tail; z0 is Phi^-1 of the share of replicates below the estimate, half of the ties counted, and
    a = sum U^3 / (6 (sum U^2)^1.5) of the influence U (N, F) of each experiment. Where all
    replicates are on one side of the estimate they are NaN.

    >>> rng = np.random.default_rng(0)
    >>> alpha = rng.normal(1.0, 2.0, (100_000, 1))
    >>> bias_corrected(np.array([1.0]), alpha, rng.normal(size=(50, 1)) * 0.0).round(1).tolist()
    [[-2.9, 4.9]]
    """
    if not len(alpha):
        return np.full((alpha.shape[1], 2), np.nan)
    below = np.mean(alpha < estimate, axis=0) + 0.5 * np.mean(alpha == estimate, axis=0)
    inside = (below > 0.0) & (below < 1.0)
    offset = special.ndtri(np.where(inside, below, 0.5))[:, None]
    moved = offset + special.ndtri(_tails(level))
    levels = special.ndtr(offset + moved / (1.0 - acceleration(influence)[:, None] * moved))
    return np.where(inside[:, None], quantiles(alpha, levels), np.nan)


def acceleration(influence: Array) -> Array:
    """a (F,) of the influence (N, F); zero where nothing has any."""
    square = np.sum(influence**2, axis=0)
    cube = np.sum(influence**3, axis=0)
    known = square > 0.0
    found = cube / (6.0 * np.where(known, square, 1.0) ** 1.5)
    return np.where(known & np.isfinite(found), found, 0.0)


def quantiles(alpha: Array, levels: Array) -> Array:
    """The quantiles (F, L) of replicates (R, F) at levels (F, L); NaN without any."""
    if not len(alpha):
        return np.full(levels.shape, np.nan)
    return np.array([np.quantile(alpha[:, k], own) for k, own in enumerate(levels)])


def _tails(level: float) -> Array:
    return np.array([0.5 - level / 2.0, 0.5 + level / 2.0])
