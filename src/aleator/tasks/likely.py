"""Laws that the experiments leave possible, and draws of them at which surfaces are to be exact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.inference.information import Inference
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.laws.inputs import Inputs
from aleator.surrogates.responses import moving_parameters
from aleator.types import Array

ALPHAS = 32
"""Laws that represent alpha's uncertainty."""
DRAWS = 512
"""Draws of one law, or of all that are likely."""
SPREAD, TAILS = 1.5, 1.3
"""By how much the draws that place the runs are wider than alpha's uncertainty, and the law."""


def law_draws(inputs: Inputs, alpha: Array, region: Array) -> Array:
    """Draws (512, moving) of the law alpha, moved into the region (n, 2)."""
    u = qmc.Sobol(len(inputs.names), rng=0).random_base2(int(np.log2(DRAWS)))
    return _inside(inputs.sample(alpha[: inputs.size], u), region)


def wide_draws(inputs: Inputs, alphas: Sequence[Array], region: Array, count: int = DRAWS) -> Array:
    """Draws (count, moving) of several laws, with somewhat wider tails; both are powers of two."""
    u = qmc.Sobol(len(inputs.names), rng=1).random_base2(int(np.log2(count)))
    u = special.ndtr(TAILS * special.ndtri(np.clip(u, 1e-12, 1.0 - 1e-12)))
    parts = zip(alphas, np.split(u, len(alphas)), strict=True)
    return _inside(
        np.concatenate([inputs.sample(a[: inputs.size], part) for a, part in parts]), region
    )


def likely_alphas(
    alpha: Array, inference: Inference, hyperparameters: tuple[Hyperparameter, ...]
) -> Array:
    """Values (32, K) of alpha that its uncertainty leaves open: normal, within the limits.

    1.5 times as wide as the information says, and no wider than the limits in any direction.
    """
    free = inference.identified
    lower, upper = limits_of(hyperparameters)
    u = qmc.Sobol(max(free.size, 1), rng=2).random_base2(int(np.log2(ALPHAS)))[:, : free.size]
    width = (upper - lower)[free]
    # a direction that the experiments leave open ends at the limits: information of 4 / width^2
    scaled = inference.information * np.outer(width, width)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    root = vectors / np.sqrt(np.maximum(values, 4.0))
    out = np.tile(alpha, (ALPHAS, 1))
    out[:, free] += SPREAD * width * (special.ndtri(np.clip(u, 1e-9, 1.0)) @ root.T)
    return np.clip(out, lower, upper)


def interval_alphas(
    alpha: Array,
    inference: Inference,
    intervals: Array,
    hyperparameters: tuple[Hyperparameter, ...],
) -> list[Array]:
    """alpha at both ends of every interval (K, 2), the others gone along as the covariance says."""
    lower, upper = limits_of(hyperparameters)
    free = inference.free.tolist()
    out = []
    for place, k in enumerate(free):
        column = inference.covariance[:, place]
        if not (inference.positive and column[place] > 0.0):
            continue
        for end in intervals[k][np.isfinite(intervals[k])]:
            moved = alpha.copy()
            moved[inference.free] += column / column[place] * (end - alpha[k])
            out.append(np.clip(moved, lower, upper))
    return out


def _inside(x: Array, region: Array) -> Array:
    return np.clip(x, *region.T)[:, moving_parameters(region)]
