"""Where to run: one nested sequence of points, the same for every experiment."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import qmc

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

# Points gather at the faces of the box, as sin(CLUSTER t) / sin(CLUSTER) of evenly spread t does:
# between even spacing (0), where polynomials oscillate at the faces, and Chebyshev's (pi / 2),
# which wastes runs there on outcomes with kinks.
CLUSTER = 0.4 * np.pi
# The sequence is chosen from so many points, hence no longer. Fixed, or it would not be nested.
CANDIDATES = 4096


def low_discrepancy(count: int, n: int, shift: Floats) -> Floats:
    """Return `count` points (count, n) of Sobol's sequence in [-1, 1]^n, moved by `shift` modulo 1.

    >>> low_discrepancy(2, 1, np.array([0.25]))
    array([[-0.5], [ 0.5]])
    """
    power = int(np.ceil(np.log2(max(count, 2))))
    base = qmc.Sobol(n, scramble=False).random_base2(power)[:count]
    return np.asarray(2.0 * ((base + shift) % 1.0) - 1.0, dtype=np.float64)


def fixed_shift(n: int) -> Floats:
    """Return one shift (n,) without symmetry, so that no two candidates are equally good."""
    return np.asarray(np.sqrt(np.arange(2.0, 2.0 + n)) % 1.0)


def spread(count: int, n: int) -> Floats:
    """Return the first `count` points (count, n) in [-1, 1]^n of a nested, well separated sequence.

    Greedy choice of the point at which a Gaussian process with a Matern-3/2 covariance knows least
    (P-greedy; De Marchi, Schaback and Wendland 2005), in coordinates that gather at the faces.
    Every prefix covers the box; at most CANDIDATES points. Cost: 4096 count^2 operations, once.

    >>> spread(3, 1).round(1).ravel() ** 2
    array([0., 1., 1.])
    """
    return _greedy(max(64, 2 ** int(np.ceil(np.log2(count)))), n)[:count]


@lru_cache(maxsize=16)
def _greedy(count: int, n: int) -> Floats:
    t = low_discrepancy(CANDIDATES, n, fixed_shift(n))
    length = np.sqrt(n / 6.0)
    factors = np.zeros((count, len(t)))
    variance = np.ones(len(t))
    chosen = np.empty(count, dtype=np.intp)
    new = int(np.argmin((t**2).sum(axis=1)))
    for k in range(count):
        chosen[k] = new
        r = np.sqrt(((t - t[new]) ** 2).sum(axis=1)) / length
        known = factors[:k].T @ factors[:k, new]
        factors[k] = ((1.0 + r) * np.exp(-r) - known) / np.sqrt(variance[new])
        variance = variance - factors[k] ** 2
        variance[chosen[: k + 1]] = -1.0
        new = int(np.argmax(variance))
    return np.asarray(np.sin(CLUSTER * t[chosen]) / np.sin(CLUSTER))


def shares(z: Floats) -> Floats:
    """Return the part (M,) of the box [-1, 1]^n that is nearest to each point z (M, n)."""
    n = z.shape[1]
    reference = low_discrepancy(8192, n, fixed_shift(n))
    nearest = cKDTree(z).query(reference)[1]
    return np.bincount(nearest, minlength=len(z)) / len(reference)
