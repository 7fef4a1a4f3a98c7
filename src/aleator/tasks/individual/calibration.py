"""Whether the identified law and noise tell the truth: the probabilities of the observations."""

from __future__ import annotations

import numpy as np

from aleator.likelihood.individual import IndividualLikelihood
from aleator.likelihood.individual.importance import proposed
from aleator.likelihood.individual.layout import Block
from aleator.likelihood.individual.likelihood import mean_of
from aleator.observations.responses import Observations
from aleator.types import Array

POINTS = 1024
"""Points of the parameters of each experiment; fewer where there are many observations."""
MOST = 20_000_000
"""Simulated values that all probabilities may take."""
FEWEST = 20.0
"""Effective points below which a probability is not told; a sixteenth of few."""
IMPOSSIBLE = -1e5
"""A logarithm of a density below this is as good as none."""
STAGES = 4
"""Individual laws, from that of no observation to that of nearly all, that points lie about."""
SEED = 20


def sequential_pit(
    likelihood: IndividualLikelihood, alpha: Array, seen: Observations, points: int = POINTS
) -> Array:
    """P(y_k below what was measured | y_1, ..., y_(k-1), alpha) of the M observations, (M,).

    Rosenblatt's transform (1952): under the right law the probabilities of all observations are
    independent and uniform, however strongly those of an experiment depend on each other. A
    censored value gets a random one between those of its bounds. By importance points of the
    experiments' parameters, half of the law itself and half of the individual law; NaN where
    hardly any is near. `points` are those of an experiment; fewer where observations are many.
    """
    rng = np.random.default_rng(SEED)
    share = rng.random(len(seen))
    found = np.full(len(seen), np.nan)
    count = int(np.clip(MOST // len(seen), 2 * FEWEST, points))
    for block in likelihood.layout.blocks(count):
        found[block.rows] = _of_block(likelihood, alpha, seen, block, share[block.rows], count)
    return found


def _of_block(
    likelihood: IndividualLikelihood,
    alpha: Array,
    seen: Observations,
    block: Block,
    share: Array,
    count: int,
) -> Array:
    rows, part = block.rows, block.experiments
    xi, log_weight = proposed(*_stages(likelihood, alpha, block), count)
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
    possible = np.where(np.isnan(terms), IMPOSSIBLE, np.maximum(terms, IMPOSSIBLE))
    known = mean_of(_before(possible, block) + prior[block.owner])[1]
    effective = 1.0 / np.maximum(np.sum(known**2, axis=1), 1e-300)
    low, high = np.sum(known * below, axis=1), np.sum(known * above, axis=1)
    return np.where(effective > min(FEWEST, count / 16), low + share * (high - low), np.nan)


def _stages(likelihood: IndividualLikelihood, alpha: Array, block: Block) -> tuple[Array, Array]:
    """Centers (B, C, M, s) and information of the individual laws as observations come in.

    Of those after none, one, two, ... observations some are chosen, whose information grows evenly
    from the law's own to that before the last observation: by the logarithm of its determinant.
    About each mode the center is a Newton step away.
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
    shares = np.arange(1, STAGES + 1) / STAGES
    gap = np.abs(size[..., None] - shares * size[:, -1:, :, None])
    chosen = np.take_along_axis(rows[..., None], np.argmin(gap, axis=1), axis=1)
    at = chosen, np.arange(z.shape[1])[None, :, None]
    stage = information[at]
    step = np.linalg.solve(stage, scores[at][..., None])[..., 0]
    whole = (experiments, classes, centers * STAGES, s)
    return (z[:, :, None] + step).reshape(whole), stage.reshape(*whole, s)


def _before(terms: Array, block: Block) -> Array:
    """The sums (m, ...) of the terms of the same experiment before each observation."""
    running = np.cumsum(terms, axis=0) - terms
    return np.asarray(running - running[block.starts[block.owner]])


def _cdf(
    likelihood: IndividualLikelihood, of_errors: Array, y: Array, eta: Array, rows: slice
) -> Array:
    """P(value <= y) (m, J) at eta (m, J); y may be infinite. No value where eta is none."""
    inside = np.where(np.isfinite(y), y, 0.0)
    found = likelihood.errors.cdf(of_errors, inside[:, None], eta, rows)
    found = np.where(np.isfinite(y)[:, None], found, (y > 0.0)[:, None])
    return np.where(np.isnan(found), 0.0, found)
