"""Whether the identified law and noise tell the truth: the probabilities of the observations.

The probability of a smaller observation than the measured one, given the earlier ones of its
experiment; and whether such probabilities look uniform, by their histogram and cumulative share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binom, kstwo

from aleator.core.types import Array
from aleator.inference.information import INTERVALS
from aleator.likelihood.individual import IndividualLikelihood
from aleator.likelihood.individual.likelihood import mean_of
from aleator.likelihood.individual.predictors import Block
from aleator.likelihood.individual.rules import proposed
from aleator.observations.responses import Observations


@dataclass(frozen=True)
class CalibrationSettings:
    """How probabilities of observations are computed and counted.

    Each experiment has `points` of its parameters, fewer where all would take more than `values`
    simulated ones; a probability with fewer than `effective` of them, or than the share `least`
    where points are few, is not reported. Points lie about `stages` individual laws, from that of
    no observation to that of nearly all; `pytest tests/inference/test_fit.py` measures what they
    miss of the normal law. A bin of a histogram should have `each` values, of `bins` at least and
    at most.
    """

    points: int = 1024
    values: int = 20_000_000
    effective: float = 20.0
    impossible: float = -1e5
    """Log-density that stands for an impossible observation."""
    stages: int = 4
    seed: int = 20
    """Seed of the points and of the values that are drawn between bounds."""
    bins: tuple[int, int] = (2, 20)
    each: int = 10
    least: float = 0.0625


CALIBRATION = CalibrationSettings()


def sequential_pit(
    likelihood: IndividualLikelihood,
    alpha: Array,
    seen: Observations,
    points: int | None = None,
    settings: CalibrationSettings = CALIBRATION,
) -> Array:
    """P(y_k below what was measured | y_1, ..., y_(k-1), alpha) of the M observations, (M,).

    Rosenblatt's transform (1952): under the right law the probabilities of all observations are
    independent and uniform, however strongly those of an experiment depend on each other. A
    censored value gets a random one between those of its bounds. By importance points of the
    experiments' parameters, half of the law itself and half of the individual law; NaN where
    hardly any is near. `points` are those of an experiment, or
    those of the settings; fewer where observations are many.
    """
    rng = np.random.default_rng(settings.seed)
    share = rng.random(len(seen))
    found = np.full(len(seen), np.nan)
    count = _points(len(seen), points, settings)
    for block in likelihood.layout.blocks(count):
        part = share[block.rows]
        found[block.rows] = _of_block(likelihood, alpha, seen, block, part, count, settings)
    return found


def _points(observations: int, points: int | None, settings: CalibrationSettings) -> int:
    most = points or settings.points
    return int(np.clip(settings.values // observations, 2 * settings.effective, most))


def _of_block(
    likelihood: IndividualLikelihood,
    alpha: Array,
    seen: Observations,
    block: Block,
    share: Array,
    count: int,
    settings: CalibrationSettings,
) -> Array:
    rows, part = block.rows, block.experiments
    xi, log_weight = proposed(*_stages(likelihood, alpha, block, settings.stages), count)
    inputs, of_errors = likelihood.inputs, alpha[likelihood.inputs.size :]
    with np.errstate(all="ignore"):
        individual = inputs.individual(alpha[: inputs.size], xi, part)
        eta = likelihood.predictor.values(block, individual.x)
        terms = likelihood.errors.terms(of_errors, eta, rows).value
        lower, upper = seen.lower[rows], seen.upper[rows]
        below = above = _cdf(likelihood, of_errors, lower, eta, rows)
        if not np.array_equal(lower, upper):
            above = _cdf(likelihood, of_errors, upper, eta, rows)
    prior = individual.log_weight + log_weight
    least = settings.impossible
    possible = np.where(np.isnan(terms), least, np.maximum(terms, least))
    known = mean_of(_before(possible, block) + prior[block.owner])[1]
    effective = 1.0 / np.maximum(np.sum(known**2, axis=1), np.finfo(float).tiny)
    low, high = np.sum(known * below, axis=1), np.sum(known * above, axis=1)
    enough = effective > min(settings.effective, settings.least * count)
    return np.where(enough, low + share * (high - low), np.nan)


def _stages(
    likelihood: IndividualLikelihood, alpha: Array, block: Block, stages: int
) -> tuple[Array, Array]:
    """Centers (B, C, M, s) and information of individual laws as observations come in.

    Of the laws after none, one, two, ... observations some are chosen, whose information grows
    evenly in the logarithm of its determinant. About each mode the center is a Newton step away.
    """
    modes = likelihood.nodes.modes[block.experiments]
    experiments, classes, centers, s = modes.shape
    z = modes.reshape(experiments, classes * centers, s)
    with np.errstate(all="ignore"):
        _, scores, outer = likelihood.of_observations(alpha, block, z)
    known = np.isfinite(outer.sum(axis=(2, 3)) + scores.sum(axis=2))
    scores = _before(np.where(known[..., None], scores, 0.0), block) - z[block.owner]
    information = _before(np.where(known[..., None, None], outer, 0.0), block) + np.eye(s)
    size = np.linalg.slogdet(information)[1]
    count = np.bincount(block.owner, minlength=experiments)
    rows = block.starts[:, None] + np.minimum(np.arange(count.max()), count[:, None] - 1)
    size = size[rows]
    shares = np.arange(1, stages + 1) / stages
    gap = np.abs(size[..., None] - shares * size[:, -1:, :, None])
    chosen = np.take_along_axis(rows[..., None], np.argmin(gap, axis=1), axis=1)
    at = chosen, np.arange(z.shape[1])[None, :, None]
    stage = information[at]
    step = np.linalg.solve(stage, scores[at][..., None])[..., 0]
    whole = (experiments, classes, centers * stages, s)
    return (z[:, :, None] + step).reshape(whole), stage.reshape(*whole, s)


def _before(terms: Array, block: Block) -> Array:
    """Sums (m, ...) of the terms of the earlier observations of the same experiment."""
    running = np.cumsum(terms, axis=0) - terms
    return np.asarray(running - running[block.starts[block.owner]])


def _cdf(
    likelihood: IndividualLikelihood, of_errors: Array, y: Array, eta: Array, rows: slice
) -> Array:
    """P(value <= y) (m, J) at eta (m, J); y may be infinite. Zero where eta is NaN."""
    inside = np.where(np.isfinite(y), y, 0.0)
    found = likelihood.errors.cdf(of_errors, inside[:, None], eta, rows)
    found = np.where(np.isfinite(y)[:, None], found, (y > 0.0)[:, None])
    return np.where(np.isnan(found), 0.0, found)


@dataclass(frozen=True, eq=False)
class Histogram:
    """Counts (B,) between `edges` (B + 1,); 95 % of uniform counts lie in [`low`, `high`]."""

    edges: Array
    counts: Array
    low: float
    high: float
    expected: float


@dataclass(frozen=True, eq=False)
class Cumulated:
    """The empirical minus the uniform distribution as a line, with a 95 % band of it."""

    x: Array
    difference: Array
    band_x: Array
    band_low: Array
    band_high: Array


def counted(pit: Array, settings: CalibrationSettings = CALIBRATION) -> Histogram:
    """The histogram of probabilities (N,), with the binomial 95 % range of a bin.

    >>> found = counted(np.array([0.1, 0.2, 0.7]))
    >>> found.counts.tolist(), found.expected
    ([2, 1], 1.5)
    """
    bins = int(np.clip(pit.size // settings.each, *settings.bins))
    counts, edges = np.histogram(pit, bins, (0.0, 1.0))
    low, high = binom.ppf(INTERVALS.ends, pit.size, 1.0 / bins)
    return Histogram(edges, counts, float(low), float(high), pit.size / bins)


def cumulated(pit: Array) -> Cumulated:
    """The empirical distribution of probabilities (N,) minus the uniform one.

    The band holds the whole curve in 95 % of all uniform samples (Kolmogorov).

    >>> cumulated(np.array([0.25])).difference.tolist()
    [0.0, -0.25, 0.75, 0.0]
    """
    reach = float(kstwo.ppf(INTERVALS.level, pit.size))
    x = np.sort([0.0, reach, 1.0 - reach, 1.0])
    share = np.arange(pit.size + 1) / pit.size
    # from each jump of the share straight down to the next: two points for each probability
    ends = np.concatenate([[0.0], np.repeat(np.sort(pit), 2), [1.0]])
    difference = np.repeat(share, 2) - ends
    return Cumulated(ends, difference, x, np.maximum(-reach, -x), np.minimum(reach, 1.0 - x))
