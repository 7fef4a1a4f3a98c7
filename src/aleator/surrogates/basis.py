"""Orthonormal Legendre products on [-1, 1]^n and the index sets they are taken from."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from aleator.types import Array, Indices


def legendre(z: Array, degree: int) -> tuple[Array, Array]:
    """Return orthonormal Legendre polynomials and their derivatives at z (J,), both (degree+1, J).

    Orthonormal for the uniform distribution on [-1, 1]: phi_k = sqrt(2k+1) P_k. The derivative
    comes from P_k' = P_(k-2)' + (2k-1) P_(k-1), which needs no division at the ends.

    >>> legendre(np.array([1.0]), 2)[0].ravel() ** 2
    array([1., 3., 5.])
    """
    value = _unscaled(z, degree)
    slope = np.zeros_like(value)
    if degree > 0:
        slope[1] = 1.0
    for k in range(2, degree + 1):
        slope[k] = slope[k - 2] + (2 * k - 1) * value[k - 1]
    scale = _scale(degree)[:, None]
    return value * scale, slope * scale


def _unscaled(z: Array, degree: int) -> Array:
    """P_0..P_degree at z (...), by the three-term recurrence: (degree+1, ...)."""
    value = np.empty((degree + 1, *z.shape))
    value[0] = 1.0
    if degree > 0:
        value[1] = z
    for k in range(2, degree + 1):
        np.multiply(z, value[k - 1], out=value[k])
        value[k] *= (2 * k - 1) / k
        value[k] -= (k - 1) / k * value[k - 2]
    return value


def _scale(degree: int) -> Array:
    return np.asarray(np.sqrt(2.0 * np.arange(degree + 1) + 1.0))


def products(indices: Indices, z: Array) -> Array:
    """Return the products phi_nu(z) as (P, J), for indices (P, n) and points z (J, n)."""
    highest = indices.max(axis=0, initial=0)
    values = _unscaled(z.T, int(highest.max(initial=0)))
    scale = _scale(len(values) - 1)
    out = np.broadcast_to(scale[indices].prod(axis=1)[:, None], (len(indices), len(z)))
    for i in np.flatnonzero(highest):
        out = out * values[indices[:, i], i]
    return np.array(out)


def products_with_gradient(indices: Indices, z: Array) -> Array:
    """Return the products and their n partial derivatives, stacked as (P, 1 + n, J)."""
    count, n = indices.shape
    out = np.empty((count, 1 + n, len(z)))
    for i, degrees in enumerate(indices.T):
        value, slope = (table[degrees] for table in legendre(z[:, i], int(degrees.max(initial=0))))
        for part in range(1 + n):
            factor = slope if part == 1 + i else value
            out[:, part] = out[:, part] * factor if i else factor
    return out


@lru_cache(maxsize=1024)
def ball(scale: tuple[float, ...], norm: float, count: int) -> tuple[Indices, Array]:
    """Return the `count` indices (count, n) of smallest size, with their sizes (count,), in order.

    size(nu) = (sum_i (nu_i / scale_i)^norm)^(1/norm): norm 2 suits outcomes that vary in any
    direction, norm 1 is the total degree, norm 1/2 leaves interactions out for long.

    >>> ball((1.0, 1.0), 1.0, 3)[0]
    array([[0, 0], [1, 0], [0, 1]])
    """
    high = 1.0 / max(scale)
    low = 0.0
    found = _inside(scale, norm, high, count)
    while found is not None and len(found[1]) < count:
        low, high = high, 2.0 * high
        found = _inside(scale, norm, high, count)
    while found is None or len(found[1]) > 2 * count:
        if high - low < 1e-9 * high:  # many indices of the same size: all of them are needed
            found = _inside(scale, norm, high, 10**9)
            break
        middle = 0.5 * (low + high)
        trial = _inside(scale, norm, middle, count)
        if trial is not None and len(trial[1]) < count:
            low = middle
        else:
            high, found = middle, trial
    assert found is not None
    indices, size = found
    order = np.lexsort((*indices.T, np.round(size, 9)))[:count]
    return indices[order], size[order]


def _inside(
    scale: tuple[float, ...], norm: float, radius: float, count: int
) -> tuple[Indices, Array] | None:
    """Return all indices up to a size, or None where they are far more than `count`."""
    indices = np.zeros((1, 0), dtype=np.intp)
    total = np.zeros(1)
    for one in scale:
        term = (np.arange(int(one * radius) + 2) / one) ** norm
        grid = total[:, None] + term
        row, degree = np.nonzero(grid <= radius**norm * (1.0 + 1e-12))
        indices = np.column_stack([indices[row], degree])
        total = grid[row, degree]
        if len(total) > 100 * count:
            return None
    return indices, total ** (1.0 / norm)
