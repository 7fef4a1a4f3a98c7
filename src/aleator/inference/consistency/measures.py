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


def moments(w: Array) -> tuple[float, float, float]:
    """Skewness, and a measure of heavy tails twice: as it is, and with the other sign, of light.

    With u, the values over their size, it is the cube root of log 2 - mean of log(1 + u^2), which
    is never negative. It sees Student's t as well as the likelihood ratio to a t law does
    (docs/statistics/consistency.md); two modes lower it. Of 11 to 300 normal values the root is
    normal down to p = 0.001, while without it p = 0.001 came four times as often of 27.
    """
    m = w - w.mean()
    scaled = m / np.sqrt(np.mean(m**2))
    heavy = float(np.cbrt(np.log(2.0) - np.mean(np.log1p(scaled**2))))
    return dagostino(float(np.mean(scaled**3)), w.size), heavy, -heavy


def dagostino(skewness: float, count: int) -> float:
    """A skewness of so many normal values as a standard normal one (D'Agostino, 1970).

    Below nine values the skewness over its standard deviation.

    >>> round(dagostino(0.5, 50), 3)
    1.548
    """
    n = float(count)
    y = skewness * np.sqrt((n + 1.0) * (n + 3.0) / (6.0 * max(n - 2.0, 1.0)))
    if count < 9:
        return float(y)
    fourth = 3.0 * (n * n + 27.0 * n - 70.0) * (n + 1.0) * (n + 3.0)
    fourth /= (n - 2.0) * (n + 5.0) * (n + 7.0) * (n + 9.0)
    square = np.sqrt(2.0 * (fourth - 1.0)) - 1.0
    return float(np.arcsinh(y * np.sqrt(0.5 * (square - 1.0))) / np.sqrt(0.5 * np.log(square)))


def anderson_darling(u: Array) -> float:
    """A^2 of sorted probabilities u (M,) against the uniform law (Anderson and Darling, 1954).

    >>> round(anderson_darling(np.array([0.25, 0.5, 0.75])), 3)
    0.269
    """
    inside = np.clip(u, 1e-15, 1.0 - 1e-15)
    odd = 2.0 * np.arange(u.size) + 1.0
    return float(-u.size - np.mean(odd * (np.log(inside) + np.log1p(-inside[::-1]))))
