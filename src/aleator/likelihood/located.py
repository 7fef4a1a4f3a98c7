"""The densities of the outcomes at one alpha: what all replicates of the data share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aleator.densities.interface import FittedDensity, FittedMomentDensity, FittedNodeDensity
from aleator.densities.moments import Moments
from aleator.densities.outcomes import Outcomes
from aleator.search.value import LogLikelihood
from aleator.types import Array


class Located(Protocol):
    """N densities at one alpha (K,) with their derivatives by it."""

    @property
    def alpha(self) -> Array:
        """Where they are."""

    @property
    def fitted(self) -> FittedDensity:
        """The densities."""

    def scored(self, y: Array) -> LogLikelihood:
        """Their smooth continuation at y (N,) with its scores (N, K).

        It is the log-density itself wherever there is one.
        """


@dataclass(frozen=True, eq=False)
class OfMoments:
    """Densities fitted to moments that carry their derivatives."""

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


@dataclass(frozen=True, eq=False)
class OfNodes:
    """Densities fitted to outcomes at nodes that carry their derivatives."""

    alpha: Array
    fitted: FittedNodeDensity
    outcomes: Outcomes

    def scored(self, y: Array) -> LogLikelihood:
        """By the chain rule over the nodes' outcomes and weights."""
        s, outcomes = self.fitted.node_sensitivity(y), self.outcomes
        assert outcomes.dy is not None
        assert outcomes.dweights is not None
        scores = (s.d_y[:, None, :] @ outcomes.dy)[:, 0, :] + s.d_weights @ outcomes.dweights
        return LogLikelihood(s.value, scores, s.status)
