"""What a log-likelihood is worth after the hyperparameters that it took: AIC and BIC."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Criteria:
    """A maximum of the likelihood with what it took to reach it.

    Of the free hyperparameters `of_law` belong to parameters that differ between the N
    `experiments`, and `of_rest` to the noise and to constants, of which each of the M
    `observations` tells.

    >>> found = Criteria(-875.970, 5, 1, 18, 180)
    >>> round(found.aic, 2), round(found.aicc, 2), round(found.bic, 2)
    (1763.94, 1771.58, 1771.58)
    """

    log_likelihood: float
    of_law: int
    of_rest: int
    experiments: int
    observations: int

    @property
    def free(self) -> int:
        """K, the number of free hyperparameters."""
        return self.of_law + self.of_rest

    @property
    def aic(self) -> float:
        """-2 log L + 2 K (Akaike 1974)."""
        return -2.0 * self.log_likelihood + 2.0 * self.free

    @property
    def aicc(self) -> float:
        """AIC + 2 K (K + 1) / (N - K - 1) (Hurvich and Tsai 1989); infinite for N <= K + 1.

        The N experiments are the sample: the observations of one are not independent.
        """
        left = self.experiments - self.free - 1
        return self.aic + 2.0 * self.free * (self.free + 1) / left if left > 0 else math.inf

    @property
    def bic(self) -> float:
        """-2 log L + K_law log N + K_rest log M (Delattre, Lavielle and Poursat 2014)."""
        return (
            -2.0 * self.log_likelihood
            + self.of_law * math.log(self.experiments)
            + self.of_rest * math.log(self.observations)
        )
