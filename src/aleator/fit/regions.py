"""Where the laws lie: draws of their parameters, and regions that hold them.

A surface on a region much wider than the laws spends its runs, and measures its error, where no
experiment ever is. So an identification begins on the box, or on what the limits of locations
span, and asks after each search whether another region fits better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.core.types import Array, Flags
from aleator.inference.information import Inference
from aleator.laws import Hyperparameter
from aleator.laws.hyperparameter import limits_of
from aleator.laws.inputs import Inputs


@dataclass(frozen=True)
class RegionSettings:
    """Where laws are taken to lie; by judgement."""

    alphas: int = 32
    """Laws that represent alpha's uncertainty."""
    spread: float = 1.5
    """By how much these laws are wider apart than alpha's uncertainty."""
    draws: int = 512
    """Draws of the laws of one alpha, or of all that are likely."""
    far: float = 5.2
    """Standard normal variates beyond which a law has no mass that counts: 1e-7 at either end."""
    plausible: float = 3.1
    """The same of laws that are only possible: 1e-3."""
    pad: float = 0.05
    """Share of its width by which a region is widened on either side."""
    least: float = 1e-3
    """Width of a region over that of the box, at least."""
    slack: float = 0.02
    """Share of its width by which a region may be too narrow."""


REGIONS = RegionSettings()


def draws(
    inputs: Inputs,
    alphas: Sequence[Array],
    experiments: int,
    wide: float = 1.0,
    count: int = REGIONS.draws,
) -> Array:
    """`count` draws (D, n) of the experiments' parameters, as many under each alpha.

    Variates are `wide` times as far out as the laws say.
    """
    laws = _laws(inputs, experiments)
    each = max(1, count // (laws * len(alphas)))
    power = int(np.ceil(np.log2(each * laws)))
    u = qmc.Sobol(max(inputs.scattering, 1), rng=0).random_base2(power)[: each * laws]
    xi = wide * special.ndtri(np.clip(u[:, : inputs.scattering], 1e-9, 1.0 - 1e-9))
    xi = np.tile(xi.reshape(laws, each, inputs.scattering), (1, len(inputs.classes), 1))
    x = [inputs.individual(a[: inputs.size], xi, slice(0, laws)).x for a in alphas]
    whole = np.concatenate([part.reshape(-1, len(inputs.names)) for part in x])
    return whole[:: max(1, len(whole) // count)]


def region_of(inputs: Inputs, alphas: Sequence[Array], experiments: int, far: float) -> Array:
    """The smallest region (n, 2) of all variates up to `far` under the experiments' laws."""
    n, s, laws = len(inputs.names), inputs.scattering, _laws(inputs, experiments)
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    for alpha in alphas:
        own = alpha[: inputs.size]
        nothing = np.zeros((laws, len(inputs.classes), s))
        mixing = inputs.individual(own, nothing, slice(0, laws)).mixing
        # a row of L has length one: this is where its theta is as far out as it may be
        xi = far * np.concatenate([np.zeros((1, s)), mixing, -mixing])
        all_of = np.tile(xi, (laws, len(inputs.classes), 1))
        x = inputs.individual(own, all_of, slice(0, laws)).x
        low, high = np.minimum(low, x.min(axis=(0, 1))), np.maximum(high, x.max(axis=(0, 1)))
    return np.stack([low, high], axis=1)


def first_region(
    inputs: Inputs, hyperparameters: Sequence[Hyperparameter], experiments: int
) -> Array:
    """The box if every law has one; else what limits of locations and constants span.

    With the standard deviations at their starts.
    """
    if inputs.bounded:
        return inputs.box
    lower = np.array([h.start if h.log else h.lower for h in hyperparameters])
    upper = np.array([h.start if h.log else h.upper for h in hyperparameters])
    return within(inputs.box, region_of(inputs, [lower, upper], experiments, REGIONS.plausible))


def plausible_alphas(
    alpha: Array, inference: Inference, hyperparameters: tuple[Hyperparameter, ...]
) -> Array:
    """32 values (32, K) of alpha within its uncertainty and its limits.

    1.5 times as wide as the information says, and no wider than the limits in any direction.
    """
    free = inference.identified
    lower, upper = limits_of(hyperparameters)
    u = qmc.Sobol(max(free.size, 1), rng=2).random_base2(int(np.log2(REGIONS.alphas)))[
        :, : free.size
    ]
    width = (upper - lower)[free]
    # a direction that the experiments leave open ends at the limits: information of 4 / width^2
    scaled = inference.information * np.outer(width, width)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    root = vectors / np.sqrt(np.maximum(values, 4.0))
    out = np.tile(alpha, (REGIONS.alphas, 1))
    out[:, free] += REGIONS.spread * width * (special.ndtri(np.clip(u, 1e-9, 1.0)) @ root.T)
    return np.clip(out, lower, upper)


def interval_alphas(
    alpha: Array,
    inference: Inference,
    intervals: Array,
    hyperparameters: tuple[Hyperparameter, ...],
) -> list[Array]:
    """alpha at the ends of every interval (K, 2), the others moved by the covariance."""
    lower, upper = limits_of(hyperparameters)
    out = []
    for place, k in enumerate(inference.free.tolist()):
        column = inference.covariance[:, place]
        if not (inference.positive and column[place] > 0.0):
            continue
        for end in intervals[k][np.isfinite(intervals[k])]:
            moved = alpha.copy()
            moved[inference.free] += column / column[place] * (end - alpha[k])
            out.append(np.clip(moved, lower, upper))
    return out


def reaching_out(region: Array, box: Array, other: Array) -> Flags:
    """Which parameters (n,) of another region lie outside this one by 2 % of its width.

    Not those that do only where the box ends too, or that are known.
    """
    slack = REGIONS.slack * np.diff(region, axis=1)[:, 0]
    low = (other[:, 0] < region[:, 0] - slack) & (region[:, 0] > box[:, 0])
    high = (other[:, 1] > region[:, 1] + slack) & (region[:, 1] < box[:, 1])
    return np.asarray((low | high) & (box[:, 1] > box[:, 0]))


def hull(region: Array, other: Array) -> Array:
    """The smallest region (n, 2) that holds two regions."""
    return np.stack(
        [np.minimum(region[:, 0], other[:, 0]), np.maximum(region[:, 1], other[:, 1])], axis=1
    )


def padded(region: Array, box: Array) -> Array:
    """The region wider by a twentieth on either side, at least by a thousandth of the box.

    At most by half of the way to the end of the box: an end that no law reaches is not reached.
    """
    pad = np.maximum(REGIONS.pad * np.diff(region, axis=1), REGIONS.least * np.diff(box, axis=1))
    room = 0.5 * np.abs(box - region)
    return within(box, region + np.minimum(pad, room) * np.array([-1.0, 1.0]))


def within(box: Array, region: Array) -> Array:
    """The part of a region that lies in the box."""
    return np.stack(
        [np.maximum(region[:, 0], box[:, 0]), np.minimum(region[:, 1], box[:, 1])], axis=1
    )


def _laws(inputs: Inputs, experiments: int) -> int:
    """The number of different laws: one for each experiment with covariates, else one."""
    return experiments if inputs.regressed else 1
