"""From a maximum that a search found to one that neither nodes nor further steps move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.laws import Hyperparameter
from aleator.likelihood.individual import GaussHermite, IndividualLikelihood
from aleator.search.newton import ascended
from aleator.types import Array, Indices

ROUNDS = 30
"""Times that nodes are adapted before the answer is taken as it is."""
ROUGHLY = 0.01
"""What may be left to gain in log-likelihood where nodes are held from then on."""
STILL = 1e-5
"""A gain in log-likelihood with nodes adapted again that is none."""
ENOUGH = 2e-3
"""A change of the log-likelihood with more nodes that is none; a hundred-thousandth an experiment
if that is more."""
HARDLY = 0.02
"""A change of the log-likelihood with more nodes that does not matter to an interval."""
MOST = 3000
"""Nodes of an experiment beyond which no more are tried."""
FINEST = 250
"""Nodes of a variate beyond which no more are tried: their weights leave the floating numbers."""


@dataclass(frozen=True, eq=False)
class Settled:
    """A maximum alpha (K,), the likelihood with nodes adapted there, and what more nodes change.

    `coarse` is the likelihood with the fewest nodes of which more hardly change it.
    """

    likelihood: IndividualLikelihood
    alpha: Array
    gap: float
    coarse: IndividualLikelihood

    @property
    def value(self) -> float:
        """The log-likelihood, nodes held."""
        return self.likelihood.evaluate(self.alpha).total


def settled(likelihood: IndividualLikelihood, alpha: Array, enough: float = ENOUGH) -> Settled:
    """Climb with nodes held, adapt them, take more where they are too few, until nothing moves.

    Nodes are enough where more change the log-likelihood by less than `enough`.
    """
    coarse = None
    while True:
        held, alpha = climbed(likelihood, alpha)
        gaps = _gaps(held, alpha)
        gap = float(sum(gaps.values()))
        coarse = held if coarse is None and abs(gap) < HARDLY else coarse
        finer = _finer(held, gaps, max(enough, 1e-5 * held.count))
        if finer is None:
            return Settled(held, alpha, gap, coarse or held)
        likelihood = finer


def _gaps(held: IndividualLikelihood, alpha: Array) -> dict[GaussHermite, float]:
    """What each of the finer rules changes of the log-likelihood."""
    value = held.evaluate(alpha).total
    return {
        rule: held.by(rule, alpha).evaluate(alpha).total - value
        for rule in held.rule.finer(held.inputs.scattering)
    }


def _finer(
    held: IndividualLikelihood, gaps: Mapping[GaussHermite, float], enough: float
) -> IndividualLikelihood | None:
    """With more nodes where they change something, or None where all do enough or are too many."""
    rule, variates = held.rule, held.inputs.scattering
    for more, gap in gaps.items():
        if abs(gap) > enough / len(gaps):
            rule = GaussHermite(
                max(rule.first, more.first), max(rule.others or rule.first, more.others or 0)
            )
    fits = rule.size(variates) <= MOST and max(rule.first, rule.others or 0) <= FINEST
    return replace(held, rule=rule) if rule != held.rule and fits else None


def climbed(likelihood: IndividualLikelihood, alpha: Array) -> tuple[IndividualLikelihood, Array]:
    """The nearest maximum: with nodes that follow alpha until it is near, then with nodes held."""
    hyperparameters = likelihood.hyperparameters
    free = np.array([k for k, h in enumerate(hyperparameters) if h.free], dtype=np.intp)
    held = likelihood.adapted(alpha)
    if not free.size:
        return held, alpha
    information = _outer(held(alpha).scores, free, hyperparameters)
    near = ascended(held.continued, alpha, hyperparameters, free, information, ROUGHLY)
    alpha, information = near.alpha, near.information
    held = held.adapted(alpha)
    for _ in range(ROUNDS):
        before = held.evaluate(alpha).total
        # as a plain function: a search would let the nodes follow
        end = ascended(held.__call__, alpha, hyperparameters, free, information)
        again = held.adapted(end.alpha)
        gain = again.evaluate(end.alpha).total - before
        if gain < 0.0 and end.value > before:
            # nodes that were held too far from where they were adapted promised what is not there
            break
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
