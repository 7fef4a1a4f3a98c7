"""Whether the identified law and the noise are right: the probabilities of the observations.

For each observation, the probability of a smaller value than the measured one is computed, given
the earlier observations of the same experiment. Under the right law these probabilities are
uniform; a histogram and an empirical distribution function show whether they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binom, kstwo

from aleator.core.types import Array, Indices
from aleator.inference.information import INTERVALS
from aleator.likelihood.individual import GaussHermite, IndividualLikelihood, LevelRule
from aleator.likelihood.individual.clusters import Clusters
from aleator.likelihood.individual.levels import Eliminated
from aleator.likelihood.individual.likelihood import mean_of
from aleator.likelihood.individual.predictors import Block
from aleator.likelihood.individual.rules import proposed
from aleator.observations.responses import Observations


@dataclass(frozen=True)
class CalibrationSettings:
    """Settings of the probability of a value below each observation, and of their histogram.

    Each experiment has `points` values of its parameters, or fewer where all experiments together
    would need more than `values` simulated values. A probability is not reported where its
    effective number of points is below `effective`, or below the share `least` of the points where
    these are few. Half of the points are drawn from the law, half from normal approximations of the
    parameters' law given the first, more, and finally all observations (`stages` approximations);
    `pytest tests/inference/test_fit.py` measures the error. Where experiments share parameters,
    `within` Gauss-Hermite nodes of each variate integrate over the parameters of the earlier
    experiments of a group, at `group_points` points of the group's parameters; the `points` of an
    experiment are divided among these. `pytest tests/likelihood/individual/test_levels.py` measures
    this error. A bin of the histogram should hold `each` values; `bins` are the least and the
    largest number of bins.
    """

    points: int = 1024
    values: int = 20_000_000
    effective: float = 20.0
    impossible: float = -1e5
    """The log-density that is used for an impossible observation."""
    stages: int = 4
    within: int = 3
    group_points: int = 64
    seed: int = 20
    """Seed of the random values that censored observations get between their bounds."""
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
    """P(y_k below the measured value | y_1, ..., y_(k-1), alpha) of each of M observations, (M,).

    This is Rosenblatt's transform (1952): under the right law the probabilities of all observations
    are independent and uniform, however strongly the observations of one experiment depend on each
    other. A censored observation gets a random probability between those of its bounds. Computed by
    importance sampling of each experiment's parameters: half of the points are drawn from the law,
    half from its normal approximations given the observations. The earlier observations are those
    of the experiment; with one level also those of the earlier experiments of the group. The result
    is NaN where hardly any point agrees with the earlier observations. `points` is the number of
    points of each experiment (None: that of the settings); it is reduced where there are many
    observations.
    """
    rng = np.random.default_rng(settings.seed)
    share = rng.random(len(seen))
    found = np.full(len(seen), np.nan)
    count = _points(len(seen), points, settings)
    nested = likelihood.layout.grouping is not None
    for block in likelihood.layout.blocks(count * (1 + settings.within * nested)):
        part = share[block.rows]
        found[block.rows] = _of_block(likelihood, alpha, seen, block, part, count, settings)
    return found


def censored_pit(low: Array, high: Array, settings: CalibrationSettings = CALIBRATION) -> Array:
    """Random probabilities (M,) between those of the bounds of each observation, `low` and `high`.

    They are those of `sequential_pit`, so that both ways to a likelihood give the same ones.
    """
    share = np.random.default_rng(settings.seed).random(low.size)
    return low + share * (high - low)


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
    if block.clusters is not None and block.clusters.plain:
        xi, log_weight = _in_clusters(likelihood, alpha, block, block.clusters, count, settings)
    else:
        xi, log_weight = _alone(likelihood, alpha, block, count, settings)
    inputs, of_errors = likelihood.inputs, alpha[likelihood.inputs.size :]
    with np.errstate(all="ignore"):
        individual = inputs.individual(alpha[: inputs.size], xi, part)
        eta = likelihood.predictor.values(block, individual.x)
        terms, below, above = _ranks(likelihood, of_errors, seen, eta, rows)
    prior = individual.log_weight + log_weight
    least = settings.impossible
    possible = np.where(np.isnan(terms), least, np.maximum(terms, least))
    order = _order(likelihood, block)
    known = mean_of(_before(possible, block, order) + prior[block.owner])[1]
    effective = 1.0 / np.maximum(np.sum(known**2, axis=1), np.finfo(float).tiny)
    low, high = np.sum(known * below, axis=1), np.sum(known * above, axis=1)
    enough = effective > min(settings.effective, settings.least * count)
    return np.where(enough, low + share * (high - low), np.nan)


def _alone(
    likelihood: IndividualLikelihood,
    alpha: Array,
    block: Block,
    count: int,
    settings: CalibrationSettings,
) -> tuple[Array, Array]:
    """Points xi (B, J, s) of experiments that share no parameters, and log weights (B, J)."""
    modes = likelihood.nodes.modes[block.experiments]
    experiments, classes, centers, s = modes.shape
    z = modes.reshape(experiments, classes * centers, s)
    center, information = _stages(likelihood, alpha, block, z, np.arange(s), settings.stages)
    whole = (experiments, classes, centers * center.shape[2], s)
    return proposed(center.reshape(whole), information.reshape(*whole, s), count)


def _stages(
    likelihood: IndividualLikelihood,
    alpha: Array,
    block: Block,
    z: Array,
    own: Indices,
    stages: int,
) -> tuple[Array, Array]:
    """Centers (B, P, M, k) and information of M normal approximations of the parameters' law.

    They are those of the k variates `own` about P modes z (B, P, s) of each of B experiments, given
    the other variates. Each approximation uses the observations up to some point. These points are
    chosen such that the logarithm of the determinant of the information grows in equal steps. Each
    center is one Newton step away from the mode that belongs to all observations.
    """
    with np.errstate(all="ignore"):
        _, scores, outer = likelihood.of_observations(alpha, block, z)
    z, scores, outer = z[..., own], scores[..., own], outer[..., own[:, None], own]
    known = np.isfinite(outer.sum(axis=(2, 3)) + scores.sum(axis=2))
    order = _order(likelihood, block)
    scores = _before(np.where(known[..., None], scores, 0.0), block, order) - z[block.owner]
    information = _before(np.where(known[..., None, None], outer, 0.0), block, order)
    information += np.eye(own.size)
    size = np.linalg.slogdet(information)[1]
    count = np.bincount(block.owner, minlength=len(block))
    rows = block.starts[:, None] + np.minimum(np.arange(count.max()), count[:, None] - 1)
    size = size[rows]
    shares = np.arange(1, stages + 1) / stages
    gap = np.abs(size[..., None] - shares * size[:, -1:, :, None])
    chosen = np.take_along_axis(rows[..., None], np.argmin(gap, axis=1), axis=1)
    at = chosen, np.arange(z.shape[1])[None, :, None]
    stage = information[at]
    step = np.linalg.solve(stage, scores[at][..., None])[..., 0]
    return z[:, :, None] + step, stage


def _in_clusters(
    likelihood: IndividualLikelihood,
    alpha: Array,
    block: Block,
    clusters: Clusters,
    count: int,
    settings: CalibrationSettings,
) -> tuple[Array, Array]:
    """Points xi (B, J, s) of experiments in groups, and log weights (B, J) by earlier experiments.

    The parameters of a group have the same points in all its experiments, and each of these has
    points of the experiment's own parameters, given the group's. A weight has the likelihood of the
    group's earlier experiments at the point, integrated over their own parameters.
    """
    laws = likelihood.laws(alpha, block)
    (stage,), own, members = clusters.stages, clusters.alone, clusters.top(0)
    z, information = laws.modes.z[:, 0], laws.modes.information[:, 0]
    each = max(2 * settings.stages, count // settings.group_points) if own.size else 1
    about = Eliminated.of(clusters, 0, np.zeros_like(z), information).information
    mode = z[np.unique(members, return_index=True)[1], 0][:, stage.variates]
    b, log_b = proposed(*_approximations(mode, about[:, 0], settings.stages), count // each)
    xi = np.repeat(z, b.shape[1], axis=1)
    xi[..., stage.variates] = b[members]
    inner = LevelRule(
        GaussHermite(settings.within), (stage.width,), own.size, crossed=True, outer=b.shape[1]
    )
    given, total = inner.at_points(laws, clusters, xi)
    total = np.maximum(total, settings.impossible)
    order, before = np.argsort(members, kind="stable"), np.empty_like(total)
    running = np.cumsum(total[order], axis=0) - total[order]
    before[order] = running - running[np.searchsorted(members[order], members[order])]
    log_weight = log_b[members] + before
    if own.size:
        center, about = _stages(likelihood, alpha, block, given, own, settings.stages)
        whole = (-1, 1, settings.stages, own.size)
        about, shift = about.reshape(*whole, own.size), np.arange(total.size)
        x, log_x = proposed(center.reshape(whole), about, each, shift)
        xi = np.repeat(xi, x.shape[1], axis=1)
        xi[..., own] = x.reshape(*xi.shape[:2], own.size)
        log_weight = np.repeat(log_weight, x.shape[1], axis=1) + log_x.reshape(xi.shape[:2])
    return xi, np.asarray(log_weight)


def _approximations(mode: Array, information: Array, stages: int) -> tuple[Array, Array]:
    """Normal approximations of laws with a mode (B, s) and information (B, s, s) there.

    They are those given a growing share of the observations: the determinant of the information
    grows by equal factors. The centers are (B, 1, M, s), the information (B, 1, M, s, s).
    """
    eye = np.eye(mode.shape[1])
    size = np.exp(np.linalg.slogdet(information)[1] / mode.shape[1])[:, None]
    known = np.maximum(size - 1.0, np.finfo(float).eps)
    share = np.minimum((size ** (np.arange(1, stages + 1) / stages) - 1.0) / known, 1.0)
    share = np.where(size > 1.0 + 1e-6, share, 1.0)[..., None, None]
    stage = eye + share * (information[:, None] - eye)
    pull = share * (information @ mode[..., None])[:, None]
    return np.asarray(np.linalg.solve(stage, pull)[:, None, ..., 0]), stage[:, None]


def _order(likelihood: IndividualLikelihood, block: Block) -> Indices:
    """The observations (m,) of a block in the order in which they are given each other."""
    sequence = likelihood.errors.sequence
    if sequence is None:
        return np.arange(block.owner.size)
    return np.asarray(sequence[block.rows] - block.rows.start)


def _before(terms: Array, block: Block, order: Indices) -> Array:
    """For each observation (m, ...) the sum of the terms of the earlier ones of its experiment."""
    straight = np.array_equal(order, np.arange(order.size))
    ordered = terms if straight else terms[order]
    running = np.cumsum(ordered, axis=0)
    running -= ordered
    running -= running[block.starts][block.owner]
    if straight:
        return running
    found = np.empty_like(running)
    found[order] = running
    return found


def _ranks(
    likelihood: IndividualLikelihood, of_errors: Array, seen: Observations, eta: Array, rows: slice
) -> tuple[Array, Array, Array]:
    """log p, and the probabilities of values up to the lower and the upper bound, (m, J) each.

    Errors that hang together are whitened once for all three.
    """
    tied = likelihood.errors.ranks(of_errors, eta, rows)
    if tied is not None:
        return tied[0], tied[1], tied[1]
    terms = likelihood.errors.log_density(of_errors, eta, rows)
    lower, upper = seen.lower[rows], seen.upper[rows]
    below = above = _cdf(likelihood, of_errors, lower, eta, rows)
    if not np.array_equal(lower, upper):
        above = _cdf(likelihood, of_errors, upper, eta, rows)
    return terms, below, above


def _cdf(
    likelihood: IndividualLikelihood, of_errors: Array, y: Array, eta: Array, rows: slice
) -> Array:
    """P(value <= y | earlier values, eta) (m, J) at eta (m, J); y may be infinite. Zero for NaN."""
    inside = np.where(np.isfinite(y), y, 0.0)
    found = likelihood.errors.conditional_cdf(of_errors, inside[:, None], eta, rows)
    found = np.where(np.isfinite(y)[:, None], found, (y > 0.0)[:, None])
    return np.where(np.isnan(found), 0.0, found)


@dataclass(frozen=True, eq=False)
class Histogram:
    """A histogram: `counts` (B,) between `edges` (B + 1,).

    The number of uniform values in one bin lies in [`low`, `high`] with a probability of 95 %;
    `expected` is its mean.
    """

    edges: Array
    counts: Array
    low: float
    high: float
    expected: float


@dataclass(frozen=True, eq=False)
class Cumulated:
    """The empirical minus the uniform distribution function as a polygon, with its 95 % band."""

    x: Array
    difference: Array
    band_x: Array
    band_low: Array
    band_high: Array


def counted(pit: Array, settings: CalibrationSettings = CALIBRATION) -> Histogram:
    """The histogram of probabilities (N,), with the 95 % range of a bin's count (binomial law).

    >>> found = counted(np.array([0.1, 0.2, 0.7]))
    >>> found.counts.tolist(), found.expected
    ([2, 1], 1.5)
    """
    bins = int(np.clip(pit.size // settings.each, *settings.bins))
    counts, edges = np.histogram(pit, bins, (0.0, 1.0))
    low, high = binom.ppf(INTERVALS.ends, pit.size, 1.0 / bins)
    return Histogram(edges, counts, float(low), float(high), pit.size / bins)


def cumulated(pit: Array) -> Cumulated:
    """The empirical distribution function of probabilities (N,) minus that of the uniform law.

    The band contains the whole curve in 95 % of all uniform samples (Kolmogorov).

    >>> cumulated(np.array([0.25])).difference.tolist()
    [0.0, -0.25, 0.75, 0.0]
    """
    reach = float(kstwo.ppf(INTERVALS.level, pit.size))
    x = np.sort([0.0, reach, 1.0 - reach, 1.0])
    share = np.arange(pit.size + 1) / pit.size
    # The difference falls steadily between two jumps: each probability gives two points of the
    # line.
    ends = np.concatenate([[0.0], np.repeat(np.sort(pit), 2), [1.0]])
    difference = np.repeat(share, 2) - ends
    return Cumulated(ends, difference, x, np.maximum(-reach, -x), np.minimum(reach, 1.0 - x))
