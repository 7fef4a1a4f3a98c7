"""The log-likelihood at one alpha, with what was believed of it beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aleator.laws.hyperparameter import Hyperparameter, has_prior, log_prior, prior_score
from aleator.types import Array


@dataclass(frozen=True)
class LogLikelihood:
    """Value at one alpha: `each` (N,) log-densities, `scores` (N, K) or None, `status` (N,).

    Where hyperparameters have priors, `prior` is the sum of the logarithms of their densities and
    `prior_score` (K,) its derivative. The `total` and its `score` are of both, which is what is
    maximized; the prior is no experiment, and belongs to none of the N.
    """

    each: Array
    scores: Array | None
    status: NDArray[np.int64]
    prior: float = 0.0
    prior_score: Array | None = None

    @property
    def total(self) -> float:
        """The log-likelihood, summed over experiments, and the log prior."""
        return self.likelihood + self.prior

    @property
    def likelihood(self) -> float:
        """The log-likelihood alone."""
        return float(self.each.sum())

    @property
    def score(self) -> Array:
        """The derivative of the total by alpha, (K,)."""
        assert self.scores is not None
        score = np.asarray(self.scores.sum(axis=0))
        return score if self.prior_score is None else score + self.prior_score

    def believed(self, hyperparameters: Sequence[Hyperparameter], alpha: Array) -> LogLikelihood:
        """The same with the priors of the hyperparameters at this alpha (K,)."""
        if not has_prior(hyperparameters):
            return self
        slope = None if self.scores is None else prior_score(hyperparameters, alpha)
        return replace(self, prior=log_prior(hyperparameters, alpha), prior_score=slope)
