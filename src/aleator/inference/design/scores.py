"""What an experiment that was not made would tell: scores of its virtual outcomes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aleator.inference.fit import Fit
from aleator.progress import Progress
from aleator.types import Array, Indices

NODES = 97
"""Outcomes of one experiment, equally far apart, that its expected information is a sum over."""
DRAWS = 400
"""Virtual data sets where an experiment has several observations."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores (R, C, K) at R virtual outcomes of C experiments; weights (R, C) that sum to one.

    `outcomes` (R, C) rise where they are nodes of a sum over the outcome's density; None where
    each is a draw of several observations. An experiment that cannot be simulated has NaN.
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

    Where each has one observation, and none is censored, by a sum over its density f, exact but
    for the distance of the nodes: I = int s s' f dy. Else by draws, censored as the fit's are.
    Cost: 97 evaluations of the likelihood of the experiments, or 400 draws of them.
    """
    seen = fit.table.observations
    single = np.array_equal(seen.experiment, np.arange(fit.count)) and not np.any(seen.censored)
    return _over_outcomes(fit, progress) if single else _over_draws(fit, rng, progress)


def _over_outcomes(fit: Fit, progress: Progress) -> Scores:
    low, high = fit.span()
    outcomes = low + np.linspace(0.0, 1.0, NODES)[:, None] * (high - low)
    density = np.empty(outcomes.shape)
    scores = np.empty((*outcomes.shape, fit.alpha.size))
    for r, y in enumerate(outcomes):
        progress.update(f"outcome {r + 1} of {NODES}", r, NODES)
        # the next outcome is near: nodes are adapted from those of the last
        seen = replace(fit.table.observations, lower=y, upper=y)
        fit = fit.seeing(fit.table.with_observations(seen))
        found = fit.scored()
        assert found.scores is not None
        density[r], scores[r] = np.exp(found.each), found.scores
    density[[0, -1]] *= 0.5
    with np.errstate(invalid="ignore"):
        weights = density / density.sum(axis=0)
    return Scores(np.where(weights[..., None] > 0.0, scores, 0.0 * weights[..., None]), weights,
                  outcomes)  # fmt: skip


def _over_draws(fit: Fit, rng: np.random.Generator, progress: Progress) -> Scores:
    scores = np.empty((DRAWS, fit.count, fit.alpha.size))
    for r in range(DRAWS):
        progress.update(f"virtual data set {r + 1} of {DRAWS}", r, DRAWS)
        found = fit.drawn(rng).scored()
        assert found.scores is not None
        scores[r] = found.scores
    return Scores(scores, np.full(scores.shape[:2], 1.0 / DRAWS), None)
