"""Surfaces of two elements through runs, for given borders and for borders that the runs choose.

y(x) = s(x) + h(x) q(x) with h = g^p where g > 0 and zero elsewhere: a kink for p = 1, a root for
p = 1/2, a jump for p = 0. The border g = 0 is a polynomial of low degree, so that it may be oblique
and curved, and lies at another place in every experiment; s and q are polynomials of least norm as
in module `fit`. For a given border this is a Gaussian process with covariance K_s + h h' K_q, all
in closed form; both elements are fitted together through all runs, so that what is smooth across
the border is learned from either side.

The idea of elements is that of multi-element polynomial chaos (Wan and Karniadakis 2005), whose
elements are boxes; a border that is oblique to them would need many. Hinging hyperplanes (Breiman
1993) are the case of linear s and q.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from aleator.surrogates.basis import ball, products
from aleator.surrogates.crease import Borders, border_indices
from aleator.surrogates.fit import TERMS, Judged, Prior
from aleator.surrogates.points import fixed_shift, low_discrepancy
from aleator.types import Array, Indices

# What makes a coefficient of the trend as good as free, and the covariance added to each run, both
# over that of a coefficient of size zero: as far apart as the inverse of the covariances bears.
FREE = 30.0
JITTER = 1e-10
# Points of the box at which the variance that is left is averaged.
LEFT = 64
# Points of the box at which the effect of a border is averaged.
SAMPLED = 1024
# Numbers held at once by one block of matrices: 32 MB.
BLOCK = 4_000_000


class Covariances(NamedTuple):
    """Of s and of q between runs (M, M), under one prior."""

    smooth: Array
    step: Array

    def inverse(self, factor: Array) -> Array:
        """The inverses (A, M, M) of the runs' covariances for factors h (A, M)."""
        full = self.smooth + self.step * factor[:, :, None] * factor[:, None, :]
        full[:, np.arange(full.shape[1]), np.arange(full.shape[1])] += JITTER
        return np.asarray(np.linalg.inv(full))


def terms(prior: Prior, runs: int) -> tuple[Indices, Array, Array]:
    """Return indices (P, n) and the weights (P,) of s and of q for a number of runs."""
    indices, size = ball(prior.scale, prior.norm, TERMS * runs + 10)
    weight = (1.0 + size**2) ** (-0.5 * prior.smoothness)
    smooth, step = weight.copy(), weight.copy()
    smooth[: max(1, int(prior.trend * runs))] *= FREE
    step[: max(1, int(0.5 * prior.trend * runs))] *= FREE
    return indices, smooth, step


def covariances(prior: Prior, z: Array) -> Covariances:
    """Return the covariances between runs at z (M, n)."""
    indices, *weights = terms(prior, len(z))
    basis = products(indices, z)
    return Covariances(*((basis * weight[:, None] ** 2).T @ basis for weight in weights))


def residuals(covariance: Covariances, factor: Array, y: Array) -> Array:
    """Return leave-one-out residuals (A, M) of runs y (A, M): [K^-1 y]_i / [K^-1]_ii."""
    out = np.empty_like(y)
    for part in blocks(*y.shape):
        inverse = covariance.inverse(factor[part])
        dual = np.einsum("aij,aj->ai", inverse, y[part])
        out[part] = dual / np.einsum("aii->ai", inverse)
    return out


def blocks(count: int, runs: int) -> Iterator[slice]:
    """Slices of a number of experiments whose matrices are held at once."""
    step = max(1, BLOCK // runs**2)
    return (slice(start, start + step) for start in range(0, count, step))


def with_slope(
    covariance: Covariances, factor: Array, change: Array, y: Array
) -> tuple[Array, Array]:
    """Return leave-one-out residuals (A, M) and their derivatives (A, M, T) by the border.

    `change` (A, M, T) are those of h. With C = K^-1, a = C y and G = K_q diag(h) C it is
    da = -C (dh K_q (h a)) - G' (dh a) and d diag(C) = -2 (C * G') dh, for r = a / diag(C).
    """
    residual, slope = np.empty_like(y), np.empty(change.shape)
    for part in blocks(*y.shape):
        h, dh = factor[part], change[part]
        inverse = covariance.inverse(h)
        dual = np.einsum("aij,aj->ai", inverse, y[part])
        precision = np.einsum("aii->ai", inverse)
        across = (covariance.step @ (h[:, :, None] * inverse)).transpose(0, 2, 1)
        beside = (h * dual) @ covariance.step
        ddual = -inverse @ (dh * beside[:, :, None]) - across @ (dh * dual[:, :, None])
        dprecision = -2.0 * (inverse * across) @ dh
        residual[part] = dual / precision
        slope[part] = (ddual - residual[part][:, :, None] * dprecision) / precision[:, :, None]
    return residual, slope


def scan(prior: Prior, z: Array, y: Array, borders: Array, power: float) -> Array:
    """Return mean square leave-one-out residuals (C, A) of runs y (A, M) at z for each border.

    One inverse a border serves all experiments, as one a prior does in module `fit`.
    """
    basis = products(border_indices(z.shape[1]), z)
    factor = Borders(borders, np.full(len(borders), power)).factor(basis)
    covariance = covariances(prior, z)
    score = np.empty((len(borders), len(y)))
    for part in blocks(len(borders), max(z.shape[0], int(np.sqrt(len(z) * len(y))))):
        inverse = covariance.inverse(factor[part])
        precision = np.einsum("cii->ci", inverse)[:, :, None]
        score[part] = (((inverse @ y.T) / precision) ** 2).mean(axis=1)
    return score


def sharpened(
    prior: Prior, z: Array, y: Array, borders: Borders, steps: int
) -> tuple[Borders, Array]:
    """Return borders of less leave-one-out error, with its mean square (A,).

    Levenberg-Marquardt in the coefficients of g, all experiments at once. A border is the same
    for any multiple of g, so that its straight part is kept at a slope of length one.
    """
    covariance = covariances(prior, z)
    basis = products(border_indices(z.shape[1]), z)[: borders.border.shape[1]]
    best = trial = _unit(borders.border, z.shape[1])
    least, damping = np.full(len(y), np.inf), np.full(len(y), 1e-2)
    here, slope = np.empty(y.shape), np.empty((*y.shape, len(basis)))
    for _ in range(steps + 1):
        at = Borders(trial, borders.power)
        change = at.slope(basis)[:, :, None] * basis.T
        r, dr = with_slope(covariance, at.factor(basis), change, y)
        value = (r**2).mean(axis=1)
        better = value < least
        best = np.where(better[:, None], trial, best)
        here[better], slope[better], least[better] = r[better], dr[better], value[better]
        damping = np.where(better, 0.3 * damping, 4.0 * damping)
        trial = _unit(best + _step(slope, here, damping), z.shape[1])
    return Borders(best, borders.power), least


def _step(slope: Array, residual: Array, damping: Array) -> Array:
    """Return the damped Gauss-Newton steps (A, T)."""
    normal = np.einsum("amt,ams->ats", slope, slope)
    size = np.einsum("att->at", normal).max(axis=1) + 1e-300
    normal += (damping * size)[:, None, None] * np.eye(slope.shape[2])
    right = np.einsum("amt,am->at", slope, residual)
    return -np.asarray(np.linalg.solve(normal, right[:, :, None])[:, :, 0])


def _unit(border: Array, n: int) -> Array:
    """Return borders whose straight part has a slope of length one."""
    length = np.sqrt(3.0) * np.linalg.norm(border[:, 1 : 1 + n], axis=1, keepdims=True)
    return np.asarray(border / np.maximum(length, 1e-12))


class Folded(NamedTuple):
    """Surfaces of two elements of some experiments through the same runs."""

    step: Array  # (P, A) coefficients of q
    judged: Judged  # of s: its coefficients; of both: what the runs say of their error


def folded(prior: Prior, z: Array, y: Array, borders: Borders) -> Folded:
    """Return the surfaces through runs y (A, M) at z (M, n), with the error that is expected.

    The expected error is the posterior variance at points of the box, as in `fit.judged`.
    """
    indices, *weights = terms(prior, len(z))
    bent = border_indices(z.shape[1])
    there = low_discrepancy(LEFT, z.shape[1], fixed_shift(z.shape[1]))
    here, far = products(indices, z), products(indices, there)
    h, h_far = borders.factor(products(bent, z)), borders.factor(products(bent, there))
    smooth, step = np.empty((2, len(indices), len(y)))
    residual, expected = np.empty(y.shape), np.empty(len(y))
    for a in range(len(y)):
        rows = np.vstack(
            [weights[0][:, None] * here, weights[1][:, None] * here * h[a],
             np.sqrt(JITTER) * np.eye(len(z))]
        )  # fmt: skip
        q, r = np.linalg.qr(rows)
        q, inverse = q[: 2 * len(indices)], np.linalg.inv(r)
        white = inverse.T @ y[a]
        precision = (inverse**2).sum(axis=1)
        dual = inverse @ white
        residual[a] = dual / precision
        terms_of = np.concatenate(weights)[:, None] * q
        smooth[:, a], step[:, a] = np.split(terms_of @ white, 2)
        prior_far = np.vstack([weights[0][:, None] * far, weights[1][:, None] * far * h_far[a]])
        left = (prior_far**2).sum(axis=0) - ((q.T @ prior_far) ** 2).sum(axis=0)
        variance = (dual**2 / precision).mean()
        expected[a] = np.sqrt(variance * np.maximum(left, 0.0).mean())
    return Folded(step, Judged(indices, smooth, expected, expected, residual.T))


def border_error(prior: Prior, z: Array, y: Array, borders: Borders, fit: Folded) -> Array:
    """Return the root-mean-square error (A,) that borders known only so well make over the box.

    Within the standard deviation of g on either side of a border, h q may be wrong by what it is
    there. For kinks and roots it is that of least squares in the leave-one-out residuals. A jump
    lies somewhere between the runs on its two sides.
    """
    n = z.shape[1]
    points = low_discrepancy(SAMPLED, n, fixed_shift(n))
    there, here = products(border_indices(n), points), products(border_indices(n), z)
    there, here = there[: borders.border.shape[1]], here[: borders.border.shape[1]]
    q = fit.step.T @ products(fit.judged.indices, points)
    change = borders.slope(here)[:, :, None] * here.T
    r, dr = with_slope(covariances(prior, z), borders.factor(here), change, y)
    variance = (r**2).sum(axis=1) / max(len(z) - dr.shape[2], 1)
    normal = np.einsum("amt,ams->ats", dr, dr)
    # coefficients of a border are of size one
    least = variance + 1e-12 * np.einsum("att->a", normal) + 1e-200
    normal += 4.0 * least[:, None, None] * np.eye(dr.shape[2])
    moves = np.linalg.inv(normal / least[:, None, None])
    sd = np.sqrt(np.einsum("tj,ats,sj->aj", there, moves, there, optimize=True))
    nearest = np.abs(borders.level(here)).min(axis=1, keepdims=True)
    power = borders.power[:, None]
    sd = np.where(power > 0.0, sd, nearest)
    near = np.abs(borders.level(there)) < sd
    return np.asarray(np.sqrt(0.5 * (near * (q * sd**power) ** 2).mean(axis=1)))
