"""Where to run and which polynomials to use: nested points, index sets and their growth."""

from __future__ import annotations

import heapq
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

# A degree is tried once more after a vanishing one (tanh has no even degrees), but only when
# everything else has fallen to this part of the degree before: a parameter that enters linearly
# costs nothing until then.
PARITY = 0.01


@lru_cache(maxsize=8)
def leja(count: int) -> Floats:
    """Return the first `count` symmetric Leja points of [-1, 1], in nested order.

    Each point maximizes the product of its distances to all points before it and is followed by
    its mirror image (Leja 1957; symmetric variant: Calvi and Phung 2011).

    >>> leja(5)
    array([ 0.  ,  1.  , -1.  ,  0.58, -0.58])
    """
    grid = np.cos(np.linspace(0.5 * np.pi, 0.0, 4 * count + 4001))
    grid[0] = 0.0
    points = np.zeros(count + 1)
    logs = np.full(len(grid), -np.inf)
    logs[1:] = np.log(grid[1:])
    for k in range(1, count, 2):
        best = grid[int(np.argmax(logs))]
        points[k], points[k + 1] = best, -best
        with np.errstate(divide="ignore"):
            logs += np.log(np.abs(grid - best)) + np.log(grid + best)
    return points[:count]


def legendre(z: Floats, degree: int) -> tuple[Floats, Floats]:
    """Return orthonormal Legendre polynomials and their derivatives at z (J,), both (degree+1, J).

    Orthonormal for the uniform distribution on [-1, 1]: phi_k = sqrt(2k+1) P_k. The derivative
    comes from P_k' = P_(k-2)' + (2k-1) P_(k-1), which needs no division at the ends.

    >>> legendre(np.array([1.0]), 2)[0].ravel() ** 2
    array([1., 3., 5.])
    """
    value = np.ones((degree + 1, len(z)))
    slope = np.zeros((degree + 1, len(z)))
    if degree > 0:
        value[1], slope[1] = z, 1.0
    for k in range(2, degree + 1):
        value[k] = ((2 * k - 1) * z * value[k - 1] - (k - 1) * value[k - 2]) / k
        slope[k] = slope[k - 2] + (2 * k - 1) * value[k - 1]
    scale = np.sqrt(2.0 * np.arange(degree + 1) + 1.0)[:, None]
    return value * scale, slope * scale


def products(indices: Ints, z: Floats) -> Floats:
    """Return the tensor products phi_nu(z) as (P, J) for indices (P, n) and z (J, n) in [-1, 1]."""
    out = np.ones((len(indices), len(z)))
    for i, degrees in enumerate(indices.T):
        if degrees.any():
            out *= legendre(z[:, i], int(degrees.max()))[0][degrees]
    return out


def products_with_gradient(indices: Ints, z: Floats) -> Floats:
    """Return products and their n partial derivatives, stacked as (P, 1 + n, J)."""
    count, n = indices.shape
    out = np.ones((count, 1 + n, len(z)))
    for i, degrees in enumerate(indices.T):
        value, slope = legendre(z[:, i], int(degrees.max()))
        factor = value[degrees]
        for part in range(1 + n):
            out[:, part] *= slope[degrees] if part == 1 + i else factor
    return out


def points_of(indices: Ints) -> Floats:
    """Return the Leja point (P, n) in [-1, 1]^n that belongs to each index."""
    return leja(int(indices.max(initial=0)) + 1)[indices]


def low_discrepancy(count: int, n: int, seed: int) -> Floats:
    """Return `count` randomly shifted Sobol' points in [-1, 1]^n."""
    power = max(int(np.ceil(np.log2(max(count, 1)))), 0)
    base = qmc.Sobol(n, scramble=False).random_base2(power)[:count]
    shift = np.random.default_rng(seed).random(n)
    return np.asarray(2.0 * ((base + shift) % 1.0) - 1.0, dtype=np.float64)


def first_indices(n: int, most: int) -> Ints:
    """Return the set to start from: total degree 2 up to four parameters, above without pairs."""
    axes = np.eye(n, dtype=np.intp)
    pairs = [axes[i] + axes[j] for i in range(n) for j in range(i)] if n <= 4 else []
    rows = [np.zeros(n, dtype=np.intp), *axes, *(2 * axes), *pairs]
    return np.array(rows[:most], dtype=np.intp)


def grown(indices: Ints, weight: Floats, count: int) -> Ints:
    """Return `count` further indices that keep the set downward closed, the largest expected first.

    `weight` (P,) is the size of each coefficient over the scatter. Beyond the set it is
    extrapolated with one geometric rate a dimension, over and over, so that one round can go
    several degrees deep where the decay is slow. Ties are broken by the index itself, so that
    the order of experiments does not matter.
    """
    expected = {tuple(nu): w for nu, w in zip(indices.tolist(), _envelope(indices, weight))}
    rates = _rates(indices, weight)
    heap: list[tuple[float, tuple[int, ...]]] = []
    seen = set(expected)
    for nu in list(expected):
        _offer(nu, expected, rates, seen, heap)
    out: list[tuple[int, ...]] = []
    while heap and len(out) < count:
        negative, nu = heapq.heappop(heap)
        expected[nu] = -negative
        out.append(nu)
        _offer(nu, expected, rates, seen, heap)
    return np.array(out, dtype=np.intp).reshape(len(out), indices.shape[1])


def _offer(
    nu: tuple[int, ...],
    expected: dict[tuple[int, ...], float],
    rates: Floats,
    seen: set[tuple[int, ...]],
    heap: list[tuple[float, tuple[int, ...]]],
) -> None:
    """Put the admissible forward neighbors of nu on the heap."""
    for i in range(len(nu)):
        new = (*nu[:i], nu[i] + 1, *nu[i + 1 :])
        below = [((*new[:j], new[j] - 1, *new[j + 1 :]), j) for j in range(len(new)) if new[j] > 0]
        if new in seen or any(mu not in expected for mu, _ in below):
            continue
        if len(below) == 2 and sum(new) == 2:  # a pair of which nothing is known yet
            size = float(np.prod([expected[mu] for mu, _ in below]))
        else:
            logs = [np.log(max(expected[mu] * rates[j], 1e-300)) for mu, j in below]
            size = float(np.exp(np.mean(logs)))
        seen.add(new)
        heapq.heappush(heap, (-float(f"{size:.6g}"), new))


def _envelope(indices: Ints, weight: Floats) -> list[float]:
    """Return weights that an even or odd function does not bring to zero at every other degree."""
    known = {tuple(nu): float(w) for nu, w in zip(indices.tolist(), weight)}
    out = []
    for nu in map(tuple, indices.tolist()):
        size = known[nu]
        for i in range(len(nu)):
            if nu[i] > 1:
                size = max(size, PARITY * known[(*nu[:i], nu[i] - 1, *nu[i + 1 :])])
        out.append(float(f"{size:.6g}"))
    return out


def _rates(indices: Ints, weight: Floats) -> Floats:
    """Return the factor (n,) by which coefficients shrink with each degree of a parameter."""
    rates = np.full(indices.shape[1], 0.5)
    for i, degrees in enumerate(indices.T):
        top = int(degrees.max())
        if top < 2:
            continue
        marginal = np.sqrt(np.bincount(degrees, weight**2, top + 1))[1:]
        envelope = np.maximum.accumulate(marginal[::-1])[::-1]
        usable = envelope > 1e-13
        if usable.sum() > 1:
            k = np.flatnonzero(usable)
            slope = np.polyfit(k, np.log(envelope[k]), 1)[0]
            rates[i] = np.clip(np.exp(slope), 0.05, 0.95)
    return rates
