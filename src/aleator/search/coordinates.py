"""The unit cube in which searches move: linear for means, logarithmic for standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.laws import Hyperparameter
from aleator.types import Array


class Coordinates:
    """Map between alpha (..., K) and u (..., F) in [0, 1]^F for the F free hyperparameters.

    u = (alpha - lower)/(upper - lower), or the same of logarithms where `log` is set.

    >>> h = [Hyperparameter("x.sd", 0.01, 1.0, 0.1, free=True, log=True)]
    >>> c = Coordinates(h)
    >>> c.to_unit(np.array([0.1])).round(6).tolist(), c.to_alpha(np.array([1.0])).tolist()
    ([0.5], [1.0])
    """

    def __init__(self, hyperparameters: Sequence[Hyperparameter]) -> None:
        self.free = np.array([k for k, h in enumerate(hyperparameters) if h.free], dtype=np.intp)
        self._base = np.array([h.start for h in hyperparameters])
        chosen = [hyperparameters[k] for k in self.free]
        self.log = np.array([h.log for h in chosen], dtype=bool)
        self.lower = np.array([h.lower for h in chosen])
        self.upper = np.array([h.upper for h in chosen])
        self._from = self._shape(self.lower)
        self._width = self._shape(self.upper) - self._from

    @property
    def start(self) -> Array:
        """The hyperparameters' start, as alpha (K,)."""
        return self._base.copy()

    def to_unit(self, alpha: Array) -> Array:
        """The free entries of alpha, clipped to their limits, as u."""
        free = np.clip(alpha[..., self.free], self.lower, self.upper)
        return np.asarray((self._shape(free) - self._from) / self._width)

    def to_alpha(self, u: Array) -> Array:
        """Alpha (..., K) with fixed entries at their value."""
        return self.filled(self._unshape(self._from + u * self._width))

    def filled(self, free: Array) -> Array:
        """Alpha (..., K) whose free entries are these (..., F), clipped to their limits."""
        alpha = np.tile(self._base, (*free.shape[:-1], 1))
        alpha[..., self.free] = np.clip(free, self.lower, self.upper)
        return alpha

    def moved(self, alpha: Array, step: Array) -> Array:
        """Alpha (K,) after a step (F,) in u; a small step keeps its digits in a wide box."""
        return self.filled(self._unshape(self._shape(alpha[self.free]) + step * self._width))

    def gradient(self, alpha: Array, score: Array) -> Array:
        """The derivative by u, given the derivative by alpha (..., K)."""
        by_alpha = self._width * np.where(self.log, alpha[self.free], 1.0)
        return np.asarray(score[..., self.free] * by_alpha)

    def _shape(self, values: Array) -> Array:
        return np.where(self.log, np.log(np.where(self.log, values, 1.0)), values)

    def _unshape(self, inner: Array) -> Array:
        return np.where(self.log, np.exp(np.where(self.log, inner, 0.0)), inner)
