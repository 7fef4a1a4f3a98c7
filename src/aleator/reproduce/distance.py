"""Earth mover's distance between fitted densities and a reference distribution function."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aleator.densities import FittedDensity

Array = NDArray[np.float64]


def from_reference(fitted: FittedDensity, y: Array, cdf: Array) -> Array:
    """W1 = integral of |F(y) - G(y)| dy (N,) of N densities from references cdf (N, G) at y (N, G).

    The points increase and hold all mass of both; the trapezoidal rule, second order in their
    distance. In one dimension this is the transport problem of the paper's appendix.

    >>> from aleator.densities import Gaussian
    >>> from aleator.moments import Moments
    >>> standard = Moments(np.zeros(1), np.ones(1), np.array([[1.0, 0.0, 1.0]]))
    >>> y = np.linspace(-9.0, 10.0, 4001)[None, :]
    >>> normal = Gaussian().fit(standard, -np.inf, np.inf)
    >>> from_reference(normal, y, normal.cdf(y - 0.25)).round(6).tolist()  # moved by a quarter
    [0.25]
    """
    gap = np.abs(fitted.cdf(y) - cdf)
    return np.asarray(np.sum(0.5 * (gap[:, 1:] + gap[:, :-1]) * np.diff(y, axis=1), axis=1))
