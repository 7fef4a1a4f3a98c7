"""Correlations of a random function with its values and slopes elsewhere, by distance.

A function f of w = M' x, with rows M (D, r), has the correlation k(q) of its values at x and x',
where q is the squared distance of w and w'. With d = W (w - w'), where W (n, r) are the last n rows
of M, the slopes by the last n entries of x have (Rasmussen and Williams 2006, section 9.4)

    Cov(f, df'/dx'_j) = -2 k'(q) d_j,    Cov(df/dx_i, df'/dx'_j) = -4 k''(q) d_i d_j - 2 k'(q) W W'_ij.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.core.types import Array, Indices


def correlation(squared: Array, gaussian: bool) -> Array:
    """The correlation k at squared distances, which are overwritten."""
    np.maximum(squared, 0.0, out=squared)
    if gaussian:
        squared *= -0.5
        return np.asarray(np.exp(squared, out=squared))
    squared *= 5.0
    r = np.sqrt(squared, out=squared)
    return np.asarray((1.0 + r + r * r / 3.0) * np.exp(-r))


def with_slope(squared: Array, gaussian: bool) -> tuple[Array, Array]:
    """The correlation k at squared distances, and its derivative by them."""
    if gaussian:
        value = correlation(squared, gaussian)
        return value, -0.5 * value
    r = np.sqrt(5.0 * np.maximum(squared, 0.0))
    decay = np.exp(-r)
    slope = (1.0 + r) * decay
    return slope + r * r / 3.0 * decay, (-5.0 / 6.0) * slope


def curvature(squared: Array, gaussian: bool) -> tuple[Array, Array]:
    """The second and third derivative of k by squared distances.

    The third derivative of Matern's correlation has a pole at zero; it counts as zero there, since
    it is multiplied by squares of distances.
    """
    if gaussian:
        value = np.exp(-0.5 * np.maximum(squared, 0.0))
        return 0.25 * value, -0.125 * value
    r = np.sqrt(5.0 * np.maximum(squared, 0.0))
    decay = np.exp(-r)
    third = np.divide(decay, r, out=np.zeros_like(r), where=r > 0.0)
    return (25.0 / 12.0) * decay, (-125.0 / 24.0) * third


def squared_distances(a: Array, b: Array) -> Array:
    """Squared distances (A, B) between the rows of two arrays."""
    out = np.asarray(a @ (-2.0 * b).T)
    out += (a**2).sum(axis=1)[:, None]
    out += (b**2).sum(axis=1)
    return out


def with_slopes(first: Array, apart: Array) -> Array:
    """Covariances (n, ...) of a value with slopes elsewhere; `first` is k', `apart` d (n, ...)."""
    return np.asarray(-2.0 * first * apart)


def of_slopes(first: Array, second: Array, apart: Array, gram: Array) -> Array:
    """Covariances (n, n, ...) of slopes with slopes elsewhere; `gram` is W W' (n, n)."""
    out = (-4.0 * second * apart)[:, None] * apart
    out -= 2.0 * gram.reshape(*gram.shape, *(1 for _ in first.shape)) * first
    return np.asarray(out)


@dataclass(frozen=True)
class Correlations:
    """The correlations of values at x (M, D), and of slopes at some of these points.

    `mix` is M (D, r), `told` (S,) are the points with slopes by the last `slopes` columns of x. The
    rows of a matrix are the M values and then, parameter by parameter, the slopes.
    """

    x: Array
    mix: Array
    gaussian: bool
    told: Indices
    slopes: int

    @cached_property
    def _mixed(self) -> Array:
        return np.asarray(self.x @ self.mix)

    @cached_property
    def _own(self) -> Array:
        """W (n, r)."""
        return self.mix[len(self.mix) - self.slopes :]

    @cached_property
    def _squared(self) -> Array:
        return squared_distances(self._mixed, self._mixed)

    @cached_property
    def _values(self) -> tuple[Array, Array]:
        return with_slope(self._squared, self.gaussian)

    @cached_property
    def _curved(self) -> tuple[Array, Array]:
        return curvature(self._squared[:, self.told], self.gaussian)

    @cached_property
    def _apart(self) -> Array:
        """d (n, M, S) from the points with slopes."""
        g = (self._mixed @ self._own.T).T
        return np.asarray(g[:, :, None] - g[:, None, self.told])

    @cached_property
    def matrix(self) -> Array:
        """All correlations, (M + n S, M + n S)."""
        value, first = self._values
        if not self.told.size:
            return value
        m, s, n, told = len(value), self.told.size, self.slopes, self.told
        out = np.empty((m + n * s, m + n * s))
        out[:m, :m] = value
        across = with_slopes(first[:, told], self._apart)
        out[:m, m:] = across.transpose(1, 0, 2).reshape(m, n * s)
        out[m:, :m] = out[:m, m:].T
        inner = of_slopes(
            first[np.ix_(told, told)], self._curved[0][told], self._apart[:, told],
            self._own @ self._own.T,
        )  # fmt: skip
        out[m:, m:] = inner.transpose(0, 2, 1, 3).reshape(n * s, n * s)
        return out

    def by_mix(self, gap: Array) -> Array:
        """The derivative (D, r) by `mix` of the sum of the matrix times a symmetric gap."""
        first, m = self._values[1], len(self.x)
        if not self.told.size:
            return np.asarray(4.0 * moved(gap * first, self.x, self.x) @ self.mix)
        s, n, told, apart, own = self.told.size, self.slopes, self.told, self._apart, self._own
        across = 2.0 * gap[:m, m:].reshape(m, n, s).transpose(1, 0, 2)
        inner = gap[m:, m:].reshape(n, s, n, s).transpose(0, 2, 1, 3)
        first_told, (second, third) = first[:, told], self._curved
        gram, inside = own @ own.T, apart[:, told]
        # By squared distances.
        along = np.einsum("ijpq,jpq->ipq", inner, inside)
        by_squared = gap[:m, :m] * first
        by_told = -2.0 * second * (across * apart).sum(axis=0)
        by_told[told] -= 4.0 * third[told] * (along * inside).sum(axis=0)
        by_told[told] -= 2.0 * second[told] * np.einsum("ijpq,ij->pq", inner, gram)
        by_squared[:, told] += by_told
        out = 4.0 * moved(0.5 * (by_squared + by_squared.T), self.x, self.x) @ self.mix
        # By the distances d = g - g' with g = x M W', and by W W'.
        by_apart = -2.0 * first_told * across
        by_apart[:, told] -= 8.0 * second[told] * along
        by_g = by_apart.sum(axis=2).T
        np.subtract.at(by_g, told, by_apart.sum(axis=1).T)
        by_gram = -2.0 * np.einsum("ijpq,pq->ij", inner, first_told[told])
        out += self.x.T @ by_g @ own
        out[len(out) - n :] += by_g.T @ self._mixed + (by_gram + by_gram.T) @ own
        return np.asarray(out)


def moved(gap: Array, a: Array, b: Array) -> Array:
    """Half the sum over all i, j of gap_ij (a_i - a_j)(b_i - b_j)', for a symmetric gap."""
    return np.asarray(a.T @ (gap.sum(axis=1)[:, None] * b) - a.T @ gap @ b)
