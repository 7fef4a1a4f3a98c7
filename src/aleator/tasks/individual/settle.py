"""From a maximum that a search found to one that neither nodes nor further steps move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.laws import Hyperparameter
from aleator.likelihood.individual import IndividualLikelihood
from aleator.search.newton import ascended
from aleator.types import Array, Indices

ROUNDS = 30
"""Times that nodes are adapted before the answer is taken as it is."""
STILL = 1e-5
"""A gain in log-likelihood with nodes adapted again that is none."""
ENOUGH = 2e-3
"""A change of the log-likelihood with more nodes that is none; a hundred-thousandth an experiment
if that is more."""
MOST = 3000
"""Nodes of an experiment beyond which no more are tried."""
FINEST = 250
"""Nodes of a variate beyond which no more are tried: their weights leave the floating numbers."""


@dataclass(frozen=True, eq=False)
class Settled:
    """A maximum alpha (K,), the likelihood with nodes adapted there, and what more nodes change."""

    likelihood: IndividualLikelihood
    alpha: Array
    gap: float

    @property
    def value(self) -> float:
        """The log-likelihood, nodes held."""
        return self.likelihood.evaluate(self.alpha).total


def settled(likelihood: IndividualLikelihood, alpha: Array) -> Settled:
    """Climb with nodes held, adapt them, take more where they are too few, until nothing moves."""
    while True:
        held, alpha = climbed(likelihood, alpha)
        finer = held.by(held.rule.finer, alpha)
        gap = finer.evaluate(alpha).total - held.evaluate(alpha).total
        enough = abs(gap) <= max(ENOUGH, 1e-5 * held.count)
        if enough or finer.nodes.xi.shape[1] > MOST or finer.rule.per_dimension > FINEST:
            return Settled(held, alpha, gap)
        likelihood = finer


def climbed(likelihood: IndividualLikelihood, alpha: Array) -> tuple[IndividualLikelihood, Array]:
    """The nearest maximum, with nodes held while alpha moves and adapted where it comes to."""
    hyperparameters = likelihood.hyperparameters
    free = np.array([k for k, h in enumerate(hyperparameters) if h.free], dtype=np.intp)
    held = likelihood.adapted(alpha)
    information = None
    for _ in range(ROUNDS if free.size else 0):
        before = held(alpha)
        if information is None:
            information = _outer(before.scores, free, hyperparameters)
        end = ascended(held, alpha, hyperparameters, free, information)
        again = held.adapted(end.alpha)
        gain = again.evaluate(end.alpha).total - before.total
        if gain < 0.0 and end.value > before.total:
            # nodes that were held too far from where they were adapted promised what is not there
            return held, alpha
        held, alpha, information = again, end.alpha, end.information
        if abs(gain) < STILL:
            break
    return held, alpha


def _outer(scores: Array | None, free: Indices, hyperparameters: Sequence[Hyperparameter]) -> Array:
    """The information by outer products of the scores, never less than the limits tell."""
    assert scores is not None
    own = scores[:, free]
    width = np.array([hyperparameters[k].upper - hyperparameters[k].lower for k in free])
    return np.asarray(own.T @ own + np.diag(width**-2.0))
