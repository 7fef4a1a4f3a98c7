"""Whether Markov chains have told what they were asked: R-hat and effective sample sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.inference.chains import installed
from aleator.types import Array

LARGEST_R_HAT = 1.01
LEAST_ESS = 400.0
"""Both by Vehtari, Gelman, Simpson, Carpenter and Burkner (2021)."""
TAILS = (0.05, 0.95)


@dataclass(frozen=True, eq=False)
class Convergence:
    """Of G quantities: rank-normalized split R-hat (G,), and effective sample sizes (G,).

    `bulk` is that of the middle of the posterior, `tail` the smaller of those of the quantiles of
    5 % and 95 %.
    """

    r_hat: Array
    bulk: Array
    tail: Array

    @property
    def converged(self) -> bool:
        """Whether every R-hat is below 1.01 and every effective sample size above 400."""
        return bool(np.all(self.r_hat < LARGEST_R_HAT) and self.least > LEAST_ESS)

    @property
    def least(self) -> float:
        """The smallest effective sample size; zero where one is not known."""
        return float(np.min(np.nan_to_num(np.concatenate([self.bulk, self.tail]))))


def convergence(draws: Array) -> Convergence:
    """That of draws (C, D, G) of C chains, by ArviZ.

    Raises AleatorError where ArviZ is not installed.
    """
    stats = installed("arviz_stats")
    axes = {"chain_axis": 0, "draw_axis": 1}
    return Convergence(
        np.asarray(stats.rhat(draws, **axes)),
        np.asarray(stats.ess(draws, method="bulk", **axes)),
        np.asarray(stats.ess(draws, method="tail", prob=TAILS, **axes)),
    )
