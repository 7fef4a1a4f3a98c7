"""The unit cube in which searches move: linear for means, logarithmic for standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.types import Array, Indices

KNEE = 1e-3
"""Share of its upper limit below which a scale that may be zero is seen as its square."""


class Coordinates:
    """Map between alpha (..., K) and u (..., F) in [0, 1]^F for the F free hyperparameters.

    u = (alpha - lower)/(upper - lower), or the same of logarithms where `log` is set. A scale s
    that may be zero is seen as log sqrt(s^2 + d^2), d a thousandth of its upper limit: at zero the
    log-likelihood is flat in s and not in s^2, and zero is not infinitely far. A hyperparameter
    with others `beside` it is seen as the sum.

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
        self.lower, self.upper = limits_of(chosen)
        self._knee = np.array([KNEE * h.upper * h.reaches_zero for h in chosen])
        self._beside, self._known = _sums(hyperparameters, self.free)
        ends = np.array([(h.beside.lower, h.beside.upper) if h.beside else (h.lower, h.upper)
                         for h in chosen]).reshape(-1, 2)  # fmt: skip
        self._from = self._curved(ends[:, 0])
        self._width = self._curved(ends[:, 1]) - self._from

    @property
    def start(self) -> Array:
        """The hyperparameters' start, as alpha (K,)."""
        return self._base.copy()

    def to_unit(self, alpha: Array) -> Array:
        """The free entries of alpha, clipped to their limits, as u."""
        free = np.clip(alpha[..., self.free], self.lower, self.upper)
        u = (self._shape(free) - self._from) / self._width
        # a sum may lie beyond its limits where what it is made of does not
        return np.asarray(u if self._beside is None else np.clip(u, 0.0, 1.0))

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
        free = alpha[self.free]
        slope = np.where(self.log, free, 1.0)
        at_knee = self._knee > 0.0
        slope[at_knee] += self._knee[at_knee] ** 2 / free[at_knee]
        by_free = score[..., self.free]
        if self._beside is not None:
            by_free = by_free - by_free @ self._beside
        return np.asarray(by_free * (self._width * slope))

    def _shape(self, free: Array) -> Array:
        if self._beside is not None:
            free = free + free @ self._beside.T + self._known
        return self._curved(free)

    def _unshape(self, inner: Array) -> Array:
        knee = np.where(self._knee > 0.0, self._knee, 1.0)
        grown = np.exp(np.where(self.log, inner, 0.0))
        squared = np.where(self._knee > 0.0, (grown - knee) * (grown + knee), 0.0)
        flat = np.where(self._knee > 0.0, np.sqrt(np.maximum(squared, 0.0)), grown)
        free = np.where(self.log, flat, inner)
        if self._beside is not None:
            # what stands beside a sum is no sum itself
            free = free - (free @ self._beside.T + self._known)
        return np.asarray(free)

    def _curved(self, values: Array) -> Array:
        size = np.where(self._knee > 0.0, np.hypot(values, self._knee), values)
        return np.where(self.log, np.log(np.where(self.log, size, 1.0)), values)


def _sums(hyperparameters: Sequence[Hyperparameter], free: Indices) -> tuple[Array | None, Array]:
    """Factors (F, F) of the free ones that stand beside another, and what known ones add (F,)."""
    factors, known = np.zeros((len(free), len(free))), np.zeros(len(free))
    place = {hyperparameters[k].name: i for i, k in enumerate(free)}
    values = {h.name: h.start for h in hyperparameters}
    for i, k in enumerate(free):
        beside = hyperparameters[k].beside
        for name, factor in beside.terms if beside else ():
            if name in place:
                factors[i, place[name]] = factor
            else:
                known[i] += factor * values[name]
    return (factors, known) if any(hyperparameters[k].beside for k in free) else (None, known)
