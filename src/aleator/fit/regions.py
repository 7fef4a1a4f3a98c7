"""Draws of the parameters under their laws, and the regions of parameters that contain them.

On a region much wider than the laws, a response surface would spend its runs, and measure its
error, where no experiment lies. An identification begins with the region of the parameters' ranges,
or of the limits of the locations. After each search it decides whether another region fits better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.core.types import Array, Flags, Indices
from aleator.inference.information import Inference
from aleator.inference.profile import Profile
from aleator.laws import Hyperparameter
from aleator.laws.hyperparameter import limits_of
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import IndividualLikelihood
from aleator.likelihood.problem import Problem
from aleator.simulators.response_functions import moving_parameters


@dataclass(frozen=True)
class RegionSettings:
    """Settings for the region of parameters that contains the laws; chosen by judgement."""

    alphas: int = 32
    """The number of values of alpha that represent its uncertainty."""
    spread: float = 1.5
    """The factor by which these values scatter more than the uncertainty of alpha."""
    draws: int = 512
    """The number of draws of the parameters, under one law or under several plausible laws."""
    far: float = 5.2
    """The standard normal quantile where the identified law is cut off (1e-7 in each tail)."""
    plausible: float = 3.1
    """The standard normal quantile where other plausible laws are cut off (1e-3 in each tail)."""
    pad: float = 0.05
    """The share of its width by which a region is widened on either side."""
    least: float = 1e-3
    """The least widening on either side, as a share of the parameter's whole range."""
    slack: float = 0.02
    """The share of its width by which a region may be too narrow before it is replaced."""


REGIONS = RegionSettings()


def draws(
    inputs: Inputs,
    alphas: Sequence[Array],
    experiments: int,
    wide: float = 1.0,
    count: int = REGIONS.draws,
) -> Array:
    """`count` draws (D, n) of the experiments' parameters, equally many under each alpha.

    Their standard normal variates are multiplied by `wide`, to draw beyond the laws. The points
    are quasi-random (Sobol').
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
    """The smallest region (n, 2) of parameters with standard normal variates up to `far`.

    It contains the laws of all experiments under each of the `alphas`.
    """
    n, s, laws = len(inputs.names), inputs.scattering, _laws(inputs, experiments)
    low, high = np.full(n, np.inf), np.full(n, -np.inf)
    for alpha in alphas:
        own = alpha[: inputs.size]
        nothing = np.zeros((laws, len(inputs.classes), s))
        mixing = inputs.individual(own, nothing, slice(0, laws)).mixing
        # A row of the Cholesky factor has length one, so this point has the largest theta of it.
        xi = far * np.concatenate([np.zeros((1, s)), mixing, -mixing])
        all_of = np.tile(xi, (laws, len(inputs.classes), 1))
        x = inputs.individual(own, all_of, slice(0, laws)).x
        low, high = np.minimum(low, x.min(axis=(0, 1))), np.maximum(high, x.max(axis=(0, 1)))
    return np.stack([low, high], axis=1)


def first_region(
    inputs: Inputs, hyperparameters: Sequence[Hyperparameter], experiments: int
) -> Array:
    """The region (n, 2) of parameters with which an identification begins.

    It is the parameters' ranges if all are finite. Otherwise it is what the laws cover when their
    locations and constants are at their limits, and their standard deviations at their starts.
    """
    if inputs.bounded:
        return inputs.box
    ends = _location_ends(hyperparameters)
    return within(inputs.box, region_of(inputs, ends, experiments, REGIONS.plausible))


def _location_ends(hyperparameters: Sequence[Hyperparameter]) -> list[Array]:
    """alpha (K,) with locations and constants at either limit, standard deviations at starts."""
    lower = np.array([h.start if h.log else h.lower for h in hyperparameters])
    upper = np.array([h.start if h.log else h.upper for h in hyperparameters])
    return [lower, upper]


def widest_region(
    inputs: Inputs, hyperparameters: Sequence[Hyperparameter], experiments: int
) -> Array:
    """The region (n, 2) of parameters that a first look covers.

    It is the first region, and of a law with a known location all that its limits of the standard
    deviation allow: no limits of a location widen the region there.
    """
    region = first_region(inputs, hyperparameters, experiments)
    located = region_of(inputs, _location_ends(hyperparameters), experiments, 0.0)
    known = located[:, :1] == located[:, 1:]
    _, upper = limits_of(hyperparameters)
    widest = within(inputs.box, region_of(inputs, [upper], experiments, REGIONS.plausible))
    return np.where(known, hull(region, widest), region)


def plausible_alphas(
    alpha: Array, inference: Inference, hyperparameters: tuple[Hyperparameter, ...]
) -> Array:
    """Quasi-random values (32, K) of alpha that represent its uncertainty, within its limits.

    They scatter 1.5 times as much as the information matrix says, and in no direction more than
    the limits admit. Hyperparameters that are only bounded are at one of their bounds.
    """
    free = inference.identified
    lower, upper = limits_of(hyperparameters)
    u = qmc.Sobol(max(free.size, 1), rng=2).random_base2(int(np.log2(REGIONS.alphas)))[
        :, : free.size
    ]
    width = (upper - lower)[free]
    size, vectors = within_limits(inference.information, width)
    root = vectors / size
    out = np.tile(alpha, (REGIONS.alphas, 1))
    out[:, free] += REGIONS.spread * width * (special.ndtri(np.clip(u, 1e-9, 1.0)) @ root.T)
    bounded = np.flatnonzero([h.bounded for h in hyperparameters])
    if bounded.size:
        corner = qmc.Sobol(bounded.size, rng=3).random(len(out)) > 0.5
        out[:, bounded] = np.where(corner, upper[bounded], lower[bounded])
    return np.clip(out, lower, upper)


def within_limits(information: Array, width: Array) -> tuple[Array, Array]:
    """The information (F, F) in units of the limits' widths (F,), as V diag(size^2) V'.

    It is at least 4 / width^2 in every direction, which is what the limits give. Returned are the
    sizes (F,) and the eigenvectors V (F, F).
    """
    scaled = information * np.outer(width, width)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    return np.sqrt(np.maximum(values, 4.0)), vectors


def roots_of(
    inference: Inference, hyperparameters: tuple[Hyperparameter, ...], largest: float
) -> tuple[Array, Array] | None:
    """Roots (F, F) of covariance and information of the free hyperparameters, R R' each.

    No standard error exceeds what the limits admit. None where the information is not a number, or
    where it is `largest` or more in units of the limits, so that the surfaces cannot be right.
    """
    inside = np.isin(inference.identified, inference.free)
    information = inference.information[np.ix_(inside, inside)]
    lower, upper = limits_of(hyperparameters, inference.free)
    width = upper - lower
    if not np.isfinite(information * np.outer(width, width)).all():
        return None
    size, vectors = within_limits(information, width)
    if size.max(initial=0.0) ** 2 > largest:
        return None
    return width[:, None] * vectors / size, vectors * size / width[:, None]


def interval_alphas(profile: Profile) -> list[Array]:
    """alpha (K,) at both ends of each interval that was found.

    The others have the values that are most likely there, also where an end is at a limit.
    """
    points = profile.points.reshape(-1, profile.points.shape[-1])
    return [*points[np.isfinite(points).all(axis=1)]]


def reaching_out(region: Array, box: Array, other: Array) -> Flags:
    """Which parameters (n,) of the region `other` extend beyond `region` by over 2 % of its width.

    A single value in `other` counts wherever it lies beyond: a surface says nothing of a constant
    outside of its region, so that no search would bring it back. A side where `region` ends at the
    end of the parameter's range does not count, nor does a fixed parameter.

    >>> box, region = np.array([[0.0, 2.0]]), np.array([[0.5, 1.0]])
    >>> [reaching_out(region, box, np.array([o])).item() for o in ([0.495, 0.9], [0.495, 0.495])]
    [False, True]
    """
    slack = REGIONS.slack * np.diff(region, axis=1)[:, 0] * (other[:, 1] > other[:, 0])
    low = (other[:, 0] < region[:, 0] - slack) & (region[:, 0] > box[:, 0])
    high = (other[:, 1] > region[:, 1] + slack) & (region[:, 1] < box[:, 1])
    return np.asarray((low | high) & (box[:, 1] > box[:, 0]))


def hull(region: Array, other: Array) -> Array:
    """The smallest region (n, 2) that contains two regions."""
    return np.stack(
        [np.minimum(region[:, 0], other[:, 0]), np.maximum(region[:, 1], other[:, 1])], axis=1
    )


def padded(region: Array, box: Array) -> Array:
    """The region widened by a twentieth on either side, at least by a thousandth of the range.

    It is widened at most half of the way to the end of the parameter's range in `box` (n, 2), so
    that it does not touch an end that no law touches.
    """
    pad = np.maximum(REGIONS.pad * np.diff(region, axis=1), REGIONS.least * np.diff(box, axis=1))
    room = 0.5 * np.abs(box - region)
    return within(box, region + np.minimum(pad, room) * np.array([-1.0, 1.0]))


def within(box: Array, region: Array) -> Array:
    """The part of a region (n, 2) that lies within the parameters' ranges `box` (n, 2)."""
    return np.stack(
        [np.maximum(region[:, 0], box[:, 0]), np.minimum(region[:, 1], box[:, 1])], axis=1
    )


def next_region(
    inputs: Inputs, region: Array, alpha: Array, likely: Array, experiments: int, shrink: float
) -> Array:
    """The region (n, 2) of the next surfaces: a new one for the plausible laws, or the present.

    The region changes if the law alpha (K,) extends beyond it, or if the new region has less than
    the share `shrink` of its volume. `likely` (A, K) are plausible laws.
    """
    certain = region_of(inputs, [alpha], experiments, REGIONS.far)
    possible = region_of(inputs, [*likely], experiments, REGIONS.plausible)
    wanted = padded(hull(certain, possible), inputs.box)
    if reaching_out(region, inputs.box, certain).any():
        way = np.diff(region, axis=1) * np.array([-1.0, 1.0])
        return np.clip(wanted, region[:, :1] + way[:, :1], region[:, 1:] + way[:, 1:])
    moving = moving_parameters(region)
    width = np.diff(region, axis=1)[moving, 0]
    share = np.prod(np.diff(wanted, axis=1)[moving, 0] / width)
    return wanted if share < shrink else region


def _laws(inputs: Inputs, experiments: int) -> int:
    """The number of distinct laws: one for each experiment if laws have covariates, else one."""
    return experiments if inputs.regressed else 1


def agreeing(
    likelihood: Problem | IndividualLikelihood,
    alpha: Array,
    of: Indices,
    x: Array,
    values: Array,
    near: int,
) -> Indices:
    """The numbers (N, near) of the draws x (D, n) that agree best with each experiment.

    `values` (U, D) are the values of all outputs at the draws, and `of` (M,) is the output of each
    observation.
    """
    if isinstance(likelihood, Problem):
        lower, upper = likelihood.ends[..., None]
        off = np.maximum(np.maximum(lower - values[of], values[of] - upper), 0.0)
        return np.argsort(off, axis=1, kind="stable")[:, :near]
    out = np.empty((likelihood.count, min(near, len(x))), dtype=np.intp)
    for block in likelihood.layout.blocks(len(x)):
        sums = likelihood.sums_of(alpha, block, values[of[block.rows]])
        order = np.argsort(-np.nan_to_num(sums, nan=-np.inf), axis=1, kind="stable")
        out[block.experiments] = order[:, :near]
    return out
