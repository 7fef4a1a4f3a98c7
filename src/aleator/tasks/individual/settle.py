"""From a maximum that a search found to one that neither nodes nor further steps move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.laws import Hyperparameter
from aleator.likelihood.individual import GaussHermite, IndividualLikelihood, Panels, Rule
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
SAMPLE = 300
"""Experiments by which panels are tried, where there are many."""
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
        gap = _whole(gaps)
        coarse = held if coarse is None and abs(gap) < HARDLY else coarse
        finer = _finer(held, gaps, max(enough, 1e-5 * held.count))
        if finer is None:
            return Settled(held, alpha, gap, coarse or held)
        likelihood = finer


def _gaps(held: IndividualLikelihood, alpha: Array) -> dict[Rule, float]:
    """What each of the finer rules changes of the log-likelihood.

    Panels are many nodes: of many experiments they are tried on a sample.
    """
    return {
        rule: _change(held, rule, alpha, isinstance(rule, Panels) and held.count > 2 * SAMPLE)
        for rule in held.rule.finer(held.inputs.scattering)
    }


def _change(held: IndividualLikelihood, rule: Rule, alpha: Array, on_sample: bool) -> float:
    tried = held.sampled(SAMPLE) if on_sample else held
    change = tried.by(rule, alpha).evaluate(alpha).total - tried.evaluate(alpha).total
    return float(change * held.count / sum(len(block) for block in tried.blocks))


def _whole(gaps: Mapping[Rule, float]) -> float:
    """What more nodes change altogether: panels leave nothing out, other rules are a part each."""
    panels = [gap for rule, gap in gaps.items() if isinstance(rule, Panels)]
    return float(panels[0] if panels else sum(gaps.values()))


def _finer(
    held: IndividualLikelihood, gaps: Mapping[Rule, float], enough: float
) -> IndividualLikelihood | None:
    """With more nodes where they change something, or None where all do enough or are too many."""
    whole = _whole(gaps)
    if any(isinstance(rule, Panels) for rule in gaps):
        if not abs(whole) > enough:
            return None
        # of the rules that tell the same as panels the first has the fewest nodes
        return replace(held, rule=next(r for r, gap in gaps.items() if abs(gap - whole) <= enough))
    wanted = [rule for rule, gap in gaps.items() if abs(gap) > enough / len(gaps)]
    return _with_more(held, [rule for rule in wanted if isinstance(rule, GaussHermite)])


def _with_more(
    held: IndividualLikelihood, wanted: Sequence[GaussHermite]
) -> IndividualLikelihood | None:
    """With as many nodes in the first variate and in the others as the rules that are wanted."""
    if not wanted:
        return None
    first = max(rule.first for rule in wanted)
    rule = GaussHermite(first, max(rule.others or rule.first for rule in wanted))
    fits = rule.size(held.inputs.scattering) <= MOST and first <= FINEST
    return replace(held, rule=rule) if fits else None


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
