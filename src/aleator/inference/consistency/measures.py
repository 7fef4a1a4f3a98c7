"""Measures of the shape of residuals: uniformity, skewness, tails."""

from __future__ import annotations

import numpy as np

from aleator.types import Array


def standardized(values: Array) -> Array:
    """Values of mean zero and mean square one; zeros where they do not scatter.

    A sum of products of independent ones scatters alike then, whatever their scale and tails.
    """
    left = values - values.mean()
    size = np.sqrt(np.mean(left**2))
    return np.asarray(left / size if size > 0.0 else left)


def scatter(w: Array) -> Array:
    """log(1 + u^2) of each value, with u the values over their size: what scatters more has more.

    It sees scatter that differs as well as |u| does, and one far value counts little in it.
    """
    return np.asarray(np.log1p(standardized(w) ** 2))


def moments(w: Array) -> tuple[float, float, float]:
    """Skewness, and a measure of heavy tails twice: as it is, and with the other sign, of light.

    With u, the values but the farthest one over their size, skewness is the mean of u log(1 + u^2),
    and the tails are the cube root of log 2 - mean of log(1 + u^2), which is never negative. It
    sees Student's t as well as the likelihood ratio to a t law does
    (docs/statistics/consistency.md); two modes lower it. Of 11 to 300 normal values the root is
    normal down to p = 0.001, while without it p = 0.001 came four times as often of 27. One gross
    error is neither a skewed law nor heavy tails: the farthest value has a test of its own.
    """
    nearer = np.delete(w, np.argmax(np.abs(standardized(w))))
    u, far = standardized(nearer), scatter(nearer)
    heavy = float(np.cbrt(np.log(2.0) - np.mean(far)))
    return float(np.mean(u * far)), heavy, -heavy
