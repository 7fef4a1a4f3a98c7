"""Covariances of a random function with its slopes.

A function f of M' x, with M (D, r), has the correlation k(q) of its values at x and x', where q is
the squared distance of M' x and M' x'. Let W (n, r) be the last n rows of M and d = W M' (x - x').
Its slopes by the last n entries of x then have (Rasmussen and Williams 2006, section 9.4)

    Cov(f, df'/dx'_j) = -2 k' d_j   and   Cov(df/dx_i, df'/dx'_j) = -4 k'' d_i d_j - 2 k' (W W')_ij.
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
    out, square = 1.0 + r, r * r
    square /= 3.0
    out += square
    out *= np.exp(np.negative(r, out=r), out=r)
    return np.asarray(out)


def with_slope(squared: Array, gaussian: bool) -> tuple[Array, Array]:
    """The correlation k at squared distances, and its derivative by them."""
    if gaussian:
        value = correlation(squared, gaussian)
        return value, -0.5 * value
    r = np.sqrt(5.0 * np.maximum(squared, 0.0))
    decay = np.exp(-r)
    slope = (1.0 + r) * decay
    return slope + r * r / 3.0 * decay, (-5.0 / 6.0) * slope


def derivatives(squared: Array, gaussian: bool) -> tuple[Array, Array, Array]:
    """The first three derivatives of k by squared distances.

    The third derivative of Matern's correlation has a pole at zero. It counts as zero there: what
    multiplies it vanishes faster.
    """
    if gaussian:
        value = np.exp(-0.5 * np.maximum(squared, 0.0))
        return -0.5 * value, 0.25 * value, -0.125 * value
    r = np.sqrt(5.0 * np.maximum(squared, 0.0))
    decay = np.exp(-r)
    third = np.divide(decay, r, out=np.zeros_like(r), where=r > 0.0)
    return (-5.0 / 6.0) * (1.0 + r) * decay, (25.0 / 12.0) * decay, (-125.0 / 24.0) * third


def squared_distances(a: Array, b: Array) -> Array:
    """Squared distances (A, B) between the rows of two arrays."""
    out = np.asarray(a @ (-2.0 * b).T)
    out += (a**2).sum(axis=1)[:, None]
    out += (b**2).sum(axis=1)
    return out


def moved(gap: Array, a: Array, b: Array) -> Array:
    """Half the sum over all i, j of gap_ij (a_i - a_j)(b_i - b_j)', for a symmetric gap."""
    return np.asarray(a.T @ (gap.sum(axis=1)[:, None] * b) - a.T @ gap @ b)


@dataclass(frozen=True)
class SlopeCorrelations:
    """The correlations of M values with slopes at some of their points, and of these slopes.

    The points are x (M, D), and `mix` is the module's M. Slopes by the last `parameters` entries of
    x are those of the points `sloped` (S,); they are in order of the parameters.
    """

    x: Array
    mix: Array
    parameters: int
    sloped: Indices
    gaussian: bool

    @cached_property
    def _mixed(self) -> Array:
        return np.asarray(self.x @ self.mix)

    @cached_property
    def _own(self) -> Array:
        """W (n, r)."""
        return self.mix[len(self.mix) - self.parameters :]

    @cached_property
    def _derivatives(self) -> tuple[Array, Array, Array]:
        """The first three derivatives of k between all points and those with slopes, (M, S)."""
        squared = squared_distances(self._mixed, self._mixed[self.sloped])
        return derivatives(squared, self.gaussian)

    @cached_property
    def _apart(self) -> Array:
        """d (n, M, S)."""
        g = self._own @ self._mixed.T
        return np.asarray(g[:, :, None] - g[:, None, self.sloped])

    @property
    def across(self) -> Array:
        """The correlations (M, n S) of values with slopes."""
        out = -2.0 * self._derivatives[0] * self._apart
        return np.asarray(out.transpose(1, 0, 2).reshape(len(self.x), -1))

    @property
    def inner(self) -> Array:
        """The correlations (n S, n S) of slopes with slopes."""
        first, second, _ = (one[self.sloped] for one in self._derivatives)
        apart, gram = self._apart[:, self.sloped], self._own @ self._own.T
        out = (-4.0 * second * apart)[:, None] * apart - 2.0 * gram[..., None, None] * first
        size = self.parameters * self.sloped.size
        return np.asarray(out.transpose(0, 2, 1, 3).reshape(size, size))

    def by_mix(self, across: Array, inner: Array) -> Array:
        """The derivative (D, r) by `mix` of twice the sum of across times weights, plus inner's.

        The weights have the shapes of `across` and `inner`; those of the latter are symmetric.
        """
        n, s, sloped, own = self.parameters, self.sloped.size, self.sloped, self._own
        across = 2.0 * across.reshape(-1, n, s).transpose(1, 0, 2)
        inner = inner.reshape(n, s, n, s).transpose(0, 2, 1, 3)
        apart, (first, second, third) = self._apart, self._derivatives
        along = np.einsum("ijpq,jpq->ipq", inner, apart[:, sloped])
        # By squared distances.
        some = -2.0 * second * (across * apart).sum(axis=0)
        some[sloped] -= 4.0 * third[sloped] * (along * apart[:, sloped]).sum(axis=0)
        some[sloped] -= 2.0 * second[sloped] * np.einsum("ijpq,ij->pq", inner, own @ own.T)
        gap = np.zeros((len(self.x), len(self.x)))
        gap[:, sloped] = some
        out = 2.0 * moved(gap + gap.T, self.x, self.x) @ self.mix
        # By d, the difference of g = x M W', and by W W'.
        by_apart = -2.0 * first * across
        by_apart[:, sloped] -= 8.0 * second[sloped] * along
        by_g = by_apart.sum(axis=2).T
        by_g[sloped] -= by_apart.sum(axis=1).T
        by_gram = -2.0 * np.einsum("ijpq,pq->ij", inner, first[sloped])
        out += self.x.T @ by_g @ own
        out[len(out) - n :] += by_g.T @ self._mixed + (by_gram + by_gram.T) @ own
        return np.asarray(out)
