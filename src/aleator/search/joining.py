"""Starts that come to an optimum that another start has climbed to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.search.value import LogLikelihood
from aleator.types import Array

NEAR = 0.5
"""Standard errors (outer product of scores) within which no one could tell two optima apart."""
AGREES = 0.05
"""... if the log-likelihood between them rises as the slopes at both ends say, to this."""


@dataclass(frozen=True, eq=False)
class Reached:
    """An optimum alpha (K,) that an ascent came to, with the log-likelihood there."""

    alpha: Array
    at: LogLikelihood

    def joins(self, alpha: Array, at: LogLikelihood) -> bool:
        """Whether a climb from alpha, with this log-likelihood, would only end here again.

        The scores must tell the distance: more experiments than hyperparameters that move.
        """
        step = self.alpha - alpha
        scores = self.at.scores
        assert scores is not None
        if len(scores) <= np.count_nonzero(np.any(scores != 0.0, axis=0)):
            return False
        gain, along = self.at.total - at.total, scores @ step
        predicted = 0.5 * float((self.at.score + at.score) @ step)
        return bool(along @ along < NEAR**2 and abs(gain - predicted) < AGREES)


def joined(reached: Sequence[Reached], alpha: Array, at: LogLikelihood) -> Reached | None:
    """The optimum that a climb from alpha joins, if any."""
    return next((one for one in reached if one.joins(alpha, at)), None)
