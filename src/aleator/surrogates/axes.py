"""The coordinates in which surfaces are polynomials: parameters in their region, or logarithms."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.types import Array, Flags

RATIO = 2.0
"""Upper over lower end of a region from which a logarithm is another coordinate than x."""


@dataclass(frozen=True, eq=False)
class Axes:
    """Coordinates z in [-1, 1]^n of points x of a region `box` (n, 2).

    z is linear in x, or in log x where an axis is `logarithmic` (n,).

    >>> axes = Axes(np.array([[1.0, 9.0], [1.0, 9.0]]), np.array([False, True]))
    >>> axes.inward(np.array([[3.0, 3.0]])).tolist(), axes.outward(np.array([[-0.5, 0.0]])).tolist()
    ([[-0.5, 0.0]], [[3.0, 3.0]])
    """

    box: Array
    logarithmic: Flags

    @classmethod
    def plain(cls, box: Array) -> Axes:
        """Linear ones."""
        return cls(box, np.zeros(len(box), dtype=np.bool_))

    def inward(self, x: Array) -> Array:
        """Coordinates z (..., n) of points x (..., n)."""
        low, high = self._terms(self.box.T)
        return np.asarray((2.0 * self._terms(x) - low - high) / (high - low))

    def outward(self, z: Array) -> Array:
        """Points x (..., n) of coordinates z (..., n)."""
        low, high = self._terms(self.box.T)
        x = 0.5 * (low + high) + 0.5 * (high - low) * z
        x[..., self.logarithmic] = np.exp(x[..., self.logarithmic])
        return np.asarray(np.clip(x, *self.box.T))

    def rates(self, x: Array) -> Array:
        """Derivatives dz/dx (..., n) at points x (..., n), each coordinate by its own parameter."""
        low, high = self._terms(self.box.T)
        return np.asarray(2.0 / (high - low) / np.where(self.logarithmic, x, 1.0))

    def moved(self, box: Array) -> Axes:
        """Those of another box: logarithms where there still are any."""
        return Axes(box, self.logarithmic & (box[:, 0] > 0.0))

    def others(self) -> list[Axes]:
        """Those that may be better: none of the logarithms, all, and one more or less."""
        able = logarithms(self.box)
        flips = [self.logarithmic ^ (np.arange(able.size) == i) for i in np.flatnonzero(able)]
        sets = {tuple(flags.tolist()) for flags in (np.zeros_like(able), able, *flips)}
        sets -= {tuple(self.logarithmic.tolist())}
        return [replace(self, logarithmic=np.array(flags)) for flags in sorted(sets)]

    def _terms(self, x: Array) -> Array:
        if not self.logarithmic.any():
            return x
        out = np.array(x, dtype=np.float64)
        out[..., self.logarithmic] = np.log(out[..., self.logarithmic])
        return out


def logarithms(box: Array) -> Flags:
    """Which parameters of a region (n, 2) have a logarithm that bends there."""
    low, high = box.T
    return np.asarray((low > 0.0) & (high > RATIO * low))
