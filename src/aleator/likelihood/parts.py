"""Densities of many experiments, some of them at a time: memory does not grow with N times J.

A part is made when it is asked for, and forgotten: to make it again costs less than to keep it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aleator.densities.interface import Codes, FittedDensity, by_experiment, probabilities
from aleator.likelihood.located import Located
from aleator.search.value import LogLikelihood
from aleator.types import Array


@dataclass(frozen=True, eq=False)
class FittedInParts:
    """The densities of all experiments, `rows` of them in each part; see `FittedDensity`."""

    rows: tuple[slice, ...]
    parts: tuple[Callable[[], FittedDensity], ...]

    @property
    def status(self) -> Codes:
        """(N,) `Status` codes."""
        return np.concatenate([make().status for make in self.parts])

    def log_pdf(self, y: ArrayLike) -> Array:
        """Logarithm of the density at y (N,) or (N, G)."""
        return self._joined(lambda fitted, at: fitted.log_pdf(at), y)

    def pdf(self, y: ArrayLike) -> Array:
        """The density at y (N,) or (N, G)."""
        return self._joined(lambda fitted, at: fitted.pdf(at), y)

    def cdf(self, y: ArrayLike) -> Array:
        """Probability of an outcome not above y (N,) or (N, G)."""
        return self._joined(lambda fitted, at: fitted.cdf(at), y)

    def quantile(self, p: ArrayLike) -> Array:
        """Outcomes (N, P) that are not exceeded with probabilities p (P,)."""
        level = probabilities(p)
        return np.concatenate([make().quantile(level) for make in self.parts])

    def _joined(self, asked: Callable[[FittedDensity, Array], Array], y: ArrayLike) -> Array:
        at = np.asarray(y, dtype=float)
        by_experiment(at, self.rows[-1].stop, "the outcome")
        parts = zip(self.rows, self.parts, strict=True)
        return np.concatenate([asked(make(), at[rows]) for rows, make in parts])


@dataclass(frozen=True, eq=False)
class InParts:
    """N densities at one alpha (K,) with their derivatives by it, `rows` of them in each part."""

    alpha: Array
    rows: tuple[slice, ...]
    parts: tuple[Callable[[], Located], ...]
    fitted: FittedInParts

    def scored(self, y: Array) -> LogLikelihood:
        """The continuation at y (N,) with its scores (N, K)."""
        parts = zip(self.rows, self.parts, strict=True)
        found = [make().scored(y[rows]) for rows, make in parts]
        scores = [one.scores for one in found if one.scores is not None]
        return LogLikelihood(
            np.concatenate([one.each for one in found]),
            np.concatenate(scores),
            np.concatenate([one.status for one in found]),
        )
