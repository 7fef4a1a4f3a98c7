"""Log-likelihood of alpha and its exact score.

log L(alpha) = sum_l log f_Yl(y_l | alpha)   (paper, eq. (MLE)).
It never sees a simulator: only alpha -> moments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.densities import Density, FittedDensity, FittedMomentDensity
from aleator.laws import Hyperparameter
from aleator.moments import Moments, add_normal_noise
from aleator.propagation import Propagation

Array = NDArray[np.float64]

NOISE_REACH = 8.0
"""Standard deviations of noise added to the outcome's range: mass beyond is below 1e-15."""


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


@dataclass(frozen=True)
class Likelihood:
    """The likelihood of N outcomes as a function of alpha (K,).

    `propagation` gives the moments of U distinct conditions, and `condition` (N,) says which of
    them each experiment was made under: repetitions are propagated once. `lower` and `upper` (N,)
    are the range of the noise-free outcome, possibly infinite. `hyperparameters` (K) are those of
    the inputs, followed by `noise.sd` if `noisy`. Two kinds of value:
    `evaluate` is honest (minus infinity outside a support); `search` is the smooth continuation
    that an optimizer needs while it is still far away, with the exact score.
    """

    propagation: Propagation
    density: Density
    outcomes: Array
    condition: NDArray[np.intp]
    lower: Array
    upper: Array
    hyperparameters: tuple[Hyperparameter, ...]
    noisy: bool

    def moments(self, alpha: Array, *, gradient: bool = False) -> Moments:
        """Moments of the measured outcomes, noise included."""
        order = max(self.density.order, 4)
        law = alpha[:-1] if self.noisy else alpha
        moments = self.propagation.moments(law, order, gradient=gradient)
        if self.noisy:
            moments = add_normal_noise(moments, float(alpha[-1]))
        return moments.take(self.condition)

    def fit(self, alpha: Array) -> FittedDensity:
        """The N fitted densities at alpha."""
        return self._fit(alpha, self.moments(alpha))

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The honest log-likelihood; cost about that of `search` without the score."""
        fitted = self.fit(alpha)
        return LogLikelihood(fitted.log_pdf(self.outcomes), None, fitted.status)

    def search(self, alpha: Array) -> LogLikelihood:
        """The continued log-likelihood with its exact score, by the chain rule over moments."""
        moments = self.moments(alpha, gradient=True)
        assert moments.mean_jac is not None
        assert moments.sd_jac is not None
        assert moments.standardized_jac is not None
        s = self._fit(alpha, moments).sensitivity(self.outcomes)
        scores = (
            s.d_mean[:, None] * moments.mean_jac
            + s.d_sd[:, None] * moments.sd_jac
            + np.einsum("nm,nmk->nk", s.d_standardized, moments.standardized_jac)
        )
        if self.noisy:
            # the range of the outcome is widened by the noise
            scores[:, -1] += NOISE_REACH * (s.d_upper - s.d_lower)
        return LogLikelihood(s.value, scores, s.status)

    def _fit(self, alpha: Array, moments: Moments) -> FittedMomentDensity:
        margin = NOISE_REACH * float(alpha[-1]) if self.noisy else 0.0
        return self.density.fit(moments, self.lower - margin, self.upper + margin)
