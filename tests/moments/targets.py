"""Moments of known laws, by a quadrature that shares nothing with the solver."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import stats

from aleator.core.types import Array
from aleator.moments.moments import Moments

_X, _W = np.polynomial.legendre.leggauss(500)


def standardized_of(
    pdf: Callable[[Array], Array], a: float, b: float, order: int
) -> tuple[float, float, Array]:
    """Mean, sd and standardized moments of an unnormalized density on [a, b]."""
    x = 0.5 * (a + b) + 0.5 * (b - a) * _X
    w = _W * pdf(x)
    w = w / w.sum()
    mean = float(w @ x)
    sd = float(np.sqrt(w @ (x - mean) ** 2))
    return mean, sd, np.array([w @ ((x - mean) / sd) ** m for m in range(order + 1)])


def stacked(rows: list[tuple[float, float, Array]]) -> Moments:
    mean, sd, standardized = (np.array(column) for column in zip(*rows, strict=True))
    standardized[:, :3] = 1.0, 0.0, 1.0
    return Moments(mean, sd, standardized)


def single(pdf: Callable[[Array], Array], a: float, b: float, order: int) -> Moments:
    return stacked([standardized_of(pdf, a, b, order)])


def row(moments: Moments, index: int | slice | Array) -> Moments:
    index = slice(index, index + 1) if isinstance(index, int) else index
    return Moments(moments.mean[index], moments.sd[index], moments.standardized[index])


def mixed(count: int, order: int, seed: int) -> tuple[Moments, Array, Array]:
    """Normal mixtures, betas, gammas and truncated normals in turn, with their ranges."""
    rng = np.random.default_rng(seed)
    rows, lower, upper = [], np.empty(count), np.empty(count)
    for i in range(count):
        pdf, lower[i], upper[i] = _law(i % 4, rng)
        rows.append(standardized_of(pdf, lower[i], upper[i], order))
    return stacked(rows), lower, upper


def _law(kind: int, rng: np.random.Generator) -> tuple[Callable[[Array], Array], float, float]:
    if kind == 0:
        means, sds, share = rng.uniform(-2, 2, 2), rng.uniform(0.3, 1, 2), rng.uniform(0.2, 0.8)
        parts = [stats.norm(m, s) for m, s in zip(means, sds, strict=True)]
        return lambda x: share * parts[0].pdf(x) + (1 - share) * parts[1].pdf(x), -8.0, 8.0
    if kind == 1:
        p, q = rng.uniform(1, 6, 2)
        return stats.beta(p, q).pdf, 0.0, 1.0
    if kind == 2:
        shape = rng.uniform(1, 8)
        return stats.gamma(shape).pdf, 0.0, shape + 6 * np.sqrt(shape)
    return stats.norm().pdf, rng.uniform(-3, -0.5), rng.uniform(0.5, 3)


def varied(count: int, order: int, seed: int) -> tuple[Moments, Array, Array]:
    """Normal mixtures, betas, gammas and truncated normals in turn, over wide parameters.

    Betas and truncated normals on their range, gammas from zero, mixtures without a range.
    """
    rng = np.random.default_rng(seed)
    rows, lower, upper = [], np.full(count, -np.inf), np.full(count, np.inf)
    for i in range(count):
        pdf, a, b, bounded = _wide_law(i % 4, rng)
        rows.append(standardized_of(pdf, a, b, order))
        if bounded[0]:
            lower[i] = a
        if bounded[1]:
            upper[i] = b
    return stacked(rows), lower, upper


def _wide_law(
    kind: int, rng: np.random.Generator
) -> tuple[Callable[[Array], Array], float, float, tuple[bool, bool]]:
    if kind == 0:
        pdf, _, _ = _law(0, rng)
        return pdf, -10.0, 10.0, (False, False)
    if kind == 1:
        p, q = rng.uniform(1.0, 8.0, 2)
        return stats.beta(p, q).pdf, 0.0, 1.0, (True, True)
    if kind == 2:
        shape = rng.uniform(1.0, 10.0)
        return stats.gamma(shape).pdf, 0.0, float(stats.gamma(shape).isf(1e-14)), (True, False)
    return stats.norm().pdf, rng.uniform(-4.0, -0.2), rng.uniform(0.2, 4.0), (True, True)


def cubics(count: int, order: int, seed: int, decay: float) -> Moments:
    """Moments of a + b X + c X^2 + d X^3, X standard normal, by exact Gauss-Hermite quadrature.

    Coefficients are normal with standard deviations 1, 1, decay, decay^2.
    """
    x, w = np.polynomial.hermite_e.hermegauss(40)
    w = w / w.sum()
    scales = np.array([1.0, 1.0, decay, decay**2])
    coefficients = scales * np.random.default_rng(seed).standard_normal((count, 4))
    y = coefficients @ x ** np.arange(4)[:, None]
    rows = []
    for values in y:
        mean = float(w @ values)
        sd = float(np.sqrt(w @ (values - mean) ** 2))
        rows.append(
            (mean, sd, np.array([w @ ((values - mean) / sd) ** m for m in range(order + 1)]))
        )
    return stacked(rows)
