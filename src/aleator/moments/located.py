"""The densities of the outcomes at one alpha: what all replicates of the data share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.moments.densities.interface import FittedMomentDensity
from aleator.moments.densities.moments import Moments
from aleator.search.value import LogLikelihood
from aleator.types import Array


@dataclass(frozen=True, eq=False)
class Located:
    """N densities at one alpha (K,), fitted to moments that carry their derivatives by it."""

    alpha: Array
    fitted: FittedMomentDensity
    moments: Moments

    def scored(self, y: Array) -> LogLikelihood:
        """By the chain rule over the moments."""
        s, moments = self.fitted.sensitivity(y), self.moments
        assert moments.mean_jac is not None
        assert moments.sd_jac is not None
        assert moments.standardized_jac is not None
        scores = (
            s.d_mean[:, None] * moments.mean_jac
            + s.d_sd[:, None] * moments.sd_jac
            + (s.d_standardized[:, None] @ moments.standardized_jac)[:, 0]
        )
        return LogLikelihood(s.value, np.asarray(scores), s.status)
