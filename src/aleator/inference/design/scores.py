"""What an experiment that was not made would tell: scores of its virtual outcomes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aleator.inference.fit import Fit
from aleator.observations.limits import ends_of, limits_of
from aleator.progress import Progress
from aleator.types import Array, Indices

NODES = 97
"""Outcomes of one experiment, equally far apart, that its expected information is a sum over."""
DRAWS = 400
"""Virtual data sets where an experiment has several observations."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores (R, C, K) at R virtual outcomes of C experiments; weights (R, C) that sum to one.

    `outcomes` (S, C), S <= R, are the first of them where these are nodes of a sum over the
    outcome's density, at equal distances; the others are values beyond a limit of the test. None
    where each is a draw of several observations. An experiment that cannot be simulated has NaN.
    """

    scores: Array
    weights: Array
    outcomes: Array | None

    @cached_property
    def information(self) -> Array:
        """I = E[s s'] (C, K, K), the expected information of each experiment (Fisher, 1925)."""
        return np.asarray(np.einsum("rc,rck,rcl->ckl", self.weights, self.scores, self.scores))

    def of(self, which: Indices) -> Scores:
        """The same by some of the hyperparameters."""
        return Scores(self.scores[:, :, which], self.weights, self.outcomes)

    def error(self, directions: Array) -> Array:
        """The Monte Carlo error (C,) of d' I d for d (C, K); zero for a sum over nodes."""
        if self.outcomes is not None:
            return np.zeros(self.weights.shape[1])
        squares = np.einsum("rck,ck->rc", self.scores, directions) ** 2
        return np.asarray(squares.std(axis=0, ddof=1) / np.sqrt(len(squares)))


def expected_scores(fit: Fit, rng: np.random.Generator, progress: Progress) -> Scores:
    """Scores of experiments under their own law, for any of which nothing need be measured.

    Where each has one observation by a sum over its density f, exact but for the distance of the
    nodes: I = int s s' f dy, values beyond the limits of the test taken together. Else by draws,
    censored as the fit's are. Cost: some 97 evaluations of the likelihood of the experiments, or
    400 draws of them.
    """
    seen = fit.table.observations
    limits = limits_of(seen)
    if limits is None or not np.array_equal(seen.experiment, np.arange(fit.count)):
        return _over_draws(fit, rng, progress)
    return _over_outcomes(fit, *ends_of(seen, limits), progress)


def _over_outcomes(fit: Fit, lowest: Array, highest: Array, progress: Progress) -> Scores:
    low, high = fit.likelihood.span()
    low, high = np.clip(low, lowest, highest), np.clip(high, lowest, highest)
    outcomes = low + np.linspace(0.0, 1.0, NODES)[:, None] * (high - low)
    ends = [*zip(outcomes, outcomes, strict=True)]
    step = [*(simpson(NODES)[:, None] * (high - low) / (NODES - 1))]
    if np.any(np.isfinite(highest)):
        ends.append((np.where(np.isfinite(highest), highest, high), np.full(high.shape, np.inf)))
        step.append(np.isfinite(highest).astype(float))
    if np.any(np.isfinite(lowest)):
        ends.append((np.full(low.shape, -np.inf), np.where(np.isfinite(lowest), lowest, low)))
        step.append(np.isfinite(lowest).astype(float))
    weights = np.empty((len(ends), fit.count))
    scores = np.empty((*weights.shape, fit.alpha.size))
    for r, (lower, upper) in enumerate(ends):
        progress.update(f"outcome {r + 1} of {len(ends)}", r, len(ends))
        # the next outcome is near: nodes are adapted from those of the last
        seen = replace(fit.table.observations, lower=lower, upper=upper)
        fit = fit.seeing(fit.table.with_observations(seen))
        found = fit.scored()
        assert found.scores is not None
        weights[r], scores[r] = step[r] * np.exp(found.each), found.scores
    with np.errstate(invalid="ignore"):
        weights = weights / weights.sum(axis=0)
    known = np.where(weights[..., None] > 0.0, scores, 0.0 * weights[..., None])
    return Scores(known, weights, outcomes)


def simpson(count: int) -> Array:
    """Weights (count,) of Simpson's rule over steps, for an odd number of nodes.

    >>> simpson(5).tolist()
    [0.333, 1.333, 0.667, 1.333, 0.333]
    """
    weights = np.tile([2.0, 4.0], count // 2 + 1)[:count]
    weights[[0, -1]] = 1.0
    return weights / 3.0


def _over_draws(fit: Fit, rng: np.random.Generator, progress: Progress) -> Scores:
    scores = np.empty((DRAWS, fit.count, fit.alpha.size))
    for r in range(DRAWS):
        progress.update(f"virtual data set {r + 1} of {DRAWS}", r, DRAWS)
        found = fit.drawn(rng).scored()
        assert found.scores is not None
        scores[r] = found.scores
    return Scores(scores, np.full(scores.shape[:2], 1.0 / DRAWS), None)
