"""Where to run: evenly over a box, or where a law is; earlier points are counted in."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import qmc

from aleator.types import Array, Indices

# Points gather at the faces of the box, as sin(CLUSTER t) / sin(CLUSTER) of evenly spread t does:
# between even spacing (0), where polynomials oscillate at the faces, and Chebyshev's (pi / 2),
# which wastes runs there on outcomes with kinks.
CLUSTER = 0.4 * np.pi
# The sequence is chosen from so many points, hence no longer. Fixed, or it would not be nested.
CANDIDATES = 4096
# Points that tell of all the box.
EVERYWHERE = 512
# The least variance, of one, that a point is taken to have before it is run.
TINY = 1e-10
# Points that differ by less are the same: rounding between the box and [-1, 1]^n.
SAME = 1e-9


def low_discrepancy(count: int, n: int, shift: Array) -> Array:
    """Return `count` points (count, n) of Sobol's sequence in [-1, 1]^n, moved by `shift` modulo 1.

    >>> low_discrepancy(2, 1, np.array([0.25]))
    array([[-0.5], [ 0.5]])
    """
    power = int(np.ceil(np.log2(max(count, 2))))
    base = qmc.Sobol(n, scramble=False).random_base2(power)[:count]
    return np.asarray(2.0 * ((base + shift) % 1.0) - 1.0, dtype=np.float64)


def fixed_shift(n: int) -> Array:
    """Return one shift (n,) without symmetry, so that no two candidates are equally good."""
    return np.asarray(np.sqrt(np.arange(2.0, 2.0 + n)) % 1.0)


def everywhere(n: int) -> Array:
    """Return points (J, n) that tell of all of [-1, 1]^n."""
    return low_discrepancy(EVERYWHERE, n, fixed_shift(n))


def spread(count: int, n: int) -> Array:
    """Return the first `count` points (count, n) in [-1, 1]^n of a nested, well separated sequence.

    Greedy choice of the point at which a Gaussian process with a Matern-3/2 covariance knows least
    (P-greedy; De Marchi, Schaback and Wendland 2005), in coordinates that gather at the faces.
    Every prefix covers the box; at most CANDIDATES points. Cost: 4096 count^2 operations, once.

    >>> spread(3, 1).round(1).ravel() ** 2
    array([0., 1., 1.])
    """
    return _greedy(max(64, 2 ** int(np.ceil(np.log2(count)))), n)[:count]


@lru_cache(maxsize=16)
def _greedy(count: int, n: int) -> Array:
    t = low_discrepancy(CANDIDATES, n, fixed_shift(n))
    # every candidate is equally unknown at first: begin in the middle
    middle = int(np.argmin((t**2).sum(axis=1)))
    chosen = _least_known(t, np.ones(len(t)), [middle], count)
    return clustered(t[chosen])


def asymmetric(z: Array, few: int) -> Array:
    """Return points z (M, n) in another order: the last of `few` is neither mid nor at a face.

    The first ones of `spread` are nearly all: at these a cube is as good as a line.

    >>> asymmetric(np.array([[0.0], [1.0], [-1.0], [0.6]]), 3).ravel().tolist()
    [0.0, 1.0, 0.6, -1.0]
    """
    away = np.minimum(np.abs(z), 1.0 - np.abs(z)).min(axis=1)
    order = np.arange(len(z))
    last = few - 1 + int(np.argmax(away[few - 1 :]))
    order = np.concatenate([order[: few - 1], [last], np.delete(order, last)[few - 1 :]])
    return np.asarray(z[order])


def evenly(z: Array, count: int) -> Array:
    """Return `count` more points (count, n) in [-1, 1]^n than z (M, n), evenly spread.

    Those of `spread` where z are its first; else its greedy choice goes on from z.

    >>> bool((evenly(spread(5, 2), 3) == spread(8, 2)[5:]).all())
    True
    """
    n = z.shape[1]
    sequence = spread(len(z) + count, n)
    if np.allclose(z, sequence[: len(z)], rtol=0.0, atol=SAME):
        return sequence[len(z) :]
    candidates = low_discrepancy(CANDIDATES, n, fixed_shift(n))
    t = np.vstack([_even(z), candidates])
    chosen = _least_known(t, np.ones(len(t)), list(range(len(z))), len(z) + count)
    return clustered(candidates[chosen[len(z) :] - len(z)])


def continued(z: Array, draws: Array, count: int) -> Array:
    """Return `count` more points (count, n) in [-1, 1]^n than z (M, n), where draws (D, n) lie.

    The greedy choice of `spread` goes on from the points that there are, and weighs what is not
    known at a point by the density of the draws there (a kernel estimate, Scott 1992). Candidates
    are the draws and low-discrepancy points. Cost: some 2500 (M + count)^2 operations.

    >>> continued(np.array([[0.0]]), np.array([[0.5], [0.6], [0.7]]), 1).round(1).tolist()
    [[0.7]]
    """
    n = z.shape[1]
    candidates = np.vstack(
        [np.clip(draws, -1.0, 1.0), clustered(low_discrepancy(2048, n, fixed_shift(n)))]
    )
    t = np.vstack([_even(z), _even(candidates)])
    weight = np.concatenate([np.zeros(len(z)), _kernel_density(draws, candidates)])
    chosen = _least_known(t, weight, list(range(len(z))), len(z) + count)
    return candidates[chosen[len(z) :] - len(z)]


def _least_known(t: Array, weight: Array, first: list[int], count: int) -> Indices:
    """Return `count` rows of t (T, n), the `first` and then greedily those of most variance."""
    length = np.sqrt(t.shape[1] / 6.0)
    factors = np.zeros((count, len(t)))
    variance = np.ones(len(t))
    chosen = np.empty(count, dtype=np.intp)
    free = np.ones(len(t), dtype=np.bool_)
    for k in range(count):
        new = (
            first[k] if k < len(first) else int(np.argmax(np.where(free, variance * weight, -1.0)))
        )
        chosen[k] = new
        free[new] = False
        r = np.sqrt(((t - t[new]) ** 2).sum(axis=1)) / length
        known = factors[:k].T @ factors[:k, new]
        # points that a region's move brings together can be all but equal
        factors[k] = ((1.0 + r) * np.exp(-r) - known) / np.sqrt(max(variance[new], TINY))
        variance = np.maximum(variance - factors[k] ** 2, 0.0)
    return chosen


def _kernel_density(draws: Array, points: Array) -> Array:
    """Return the density (P,) of draws (D, n) at points (P, n), up to a factor."""
    count, n = draws.shape
    scale = np.maximum(draws.std(axis=0), 1e-6)
    width = scale * count ** (-1.0 / (n + 4))
    distance = (((points[:, None] - draws) / width) ** 2).sum(axis=2)
    return np.asarray(np.exp(-0.5 * distance).mean(axis=1))


def clustered(t: Array) -> Array:
    """Return evenly spread points of [-1, 1]^n gathered at the faces; `_even` turns that round."""
    return np.asarray(np.sin(CLUSTER * t) / np.sin(CLUSTER))


def _even(z: Array) -> Array:
    return np.asarray(np.arcsin(np.clip(z * np.sin(CLUSTER), -1.0, 1.0)) / CLUSTER)


def shares(z: Array, where: Array | None = None) -> Array:
    """Return the part (M,) of the box [-1, 1]^n, or of points `where`, nearest to each z (M, n)."""
    n = z.shape[1]
    reference = low_discrepancy(8192, n, fixed_shift(n)) if where is None else where
    nearest = cKDTree(z).query(reference)[1]
    return np.bincount(nearest, minlength=len(z)) / len(reference)
