"""Starts that come to an optimum that another start has climbed to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aleator.search.value import LogLikelihood
from aleator.types import Array, Indices

NEAR = 0.5
"""Standard errors (outer product of scores) within which no one could tell two optima apart."""
AGREES = 0.05
"""... if the log-likelihood between them rises as the slopes at both ends say, to this."""


@dataclass(frozen=True, eq=False)
class Reached:
    """An optimum alpha (K,) that an ascent over the `free` (F,) came to, and what is there."""

    alpha: Array
    at: LogLikelihood
    free: Indices

    def joins(self, alpha: Array, at: LogLikelihood) -> bool:
        """Whether a climb from alpha, with this log-likelihood, would only end here again."""
        if not self._tells:
            return False
        step = self.alpha - alpha
        gain, along = self.at.total - at.total, self._scores @ step[self.free]
        predicted = 0.5 * float((self.at.score + at.score) @ step)
        return bool(along @ along < NEAR**2 and abs(gain - predicted) < AGREES)

    @property
    def _scores(self) -> Array:
        assert self.at.scores is not None
        return self.at.scores[:, self.free]

    @cached_property
    def _tells(self) -> bool:
        """Whether the scores tell a distance: of more experiments than F, in every direction."""
        size = np.sqrt(np.sum(self._scores**2, axis=0))
        if len(self._scores) <= self.free.size or not np.all(size > 0.0):
            return False
        return bool(np.linalg.matrix_rank(self._scores / size) == self.free.size)


def joined(reached: Sequence[Reached], alpha: Array, at: LogLikelihood) -> Reached | None:
    """The optimum that a climb from alpha joins, if any."""
    return next((one for one in reached if one.joins(alpha, at)), None)
