"""The log-likelihood at one alpha."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.types import Array


@dataclass(frozen=True)
class LogLikelihood:
    """Value at one alpha: `each` (N,) log-densities, `scores` (N, K) or None, `status` (N,)."""

    each: Array
    scores: Array | None
    status: NDArray[np.int64]

    @property
    def total(self) -> float:
        """The log-likelihood, summed over experiments."""
        return float(self.each.sum())

    @property
    def score(self) -> Array:
        """The derivative of the total by alpha, (K,)."""
        assert self.scores is not None
        return np.asarray(self.scores.sum(axis=0))
