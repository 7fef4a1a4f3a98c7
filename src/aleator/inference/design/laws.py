"""Values of alpha for which experiments are planned: a design is good for one alpha only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.inference.information import Inference
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.types import Array

SEED = 5


def possible_laws(
    alpha: Array, inference: Inference, hyperparameters: Sequence[Hyperparameter], count: int
) -> Array:
    """Values (A, K) that the experiments leave possible: alpha itself, or `count` spread about it.

    Normal with the covariance of the estimates, quasi-random, moved within their limits.
    """
    if count < 2 or not inference.positive or not inference.free.size:
        return alpha[None]
    power = int(np.ceil(np.log2(count)))
    uniform = qmc.Sobol(inference.free.size, rng=SEED).random_base2(power)[:count]
    root = np.linalg.cholesky(inference.covariance)
    found = np.tile(alpha, (count, 1))
    found[:, inference.free] += special.ndtri(np.clip(uniform, 1e-6, 1.0 - 1e-6)) @ root.T
    return np.asarray(np.clip(found, *limits_of(hyperparameters)))
