"""The highest of the maxima that a search found, by the nodes of the answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.likelihood.individual import Following, IndividualLikelihood
from aleator.search import Ascent, Optimum, SearchResult
from aleator.search.interface import RULED_OUT, one_hill
from aleator.search.newton import outer
from aleator.tasks.individual.settle import Settled, climbed, settled
from aleator.types import Array

LOOKED = 3
"""Optima besides the best that are looked at with the nodes of the answer."""
HIGHER = 2e-3
"""A log-likelihood that is higher by so much is that of a better maximum."""
SAME = 0.3
"""Standard errors, by the outer product of the scores, within which two maxima are one."""


@dataclass(frozen=True, eq=False)
class Highest:
    """An answer, and other optima (K,) that a drop of 1.92 does not rule out, by the same nodes.

    `found` is the search with the answer as its first optimum, and the others after it.
    """

    settled: Settled
    found: SearchResult
    others: tuple[Array, ...]

    @classmethod
    def of(
        cls, end: Settled, found: SearchResult, looked: Sequence[Optimum], rest: Sequence[Optimum]
    ) -> Highest:
        """With the optima that were looked at, and the `rest` that were not."""
        lower = [replace(o, log_likelihood=min(o.log_likelihood, end.value)) for o in looked]
        lower.sort(key=lambda optimum: -optimum.log_likelihood)
        optima = (Optimum(end.alpha, end.value, found.optima[0].starts), *lower, *rest)
        moved = replace(found, alpha=end.alpha, log_likelihood=end.value, optima=optima)
        return cls(end, moved, tuple(o.alpha for o in lower if _possible(o, end)))


def told(end: Settled, found: SearchResult) -> Highest:
    """An answer as it is, and what the next optima are by its nodes."""
    looked = _looked_at(end.likelihood.continued, found)
    return Highest.of(end, found, looked, found.optima[1 + LOOKED :])


def highest(end: Settled, found: SearchResult) -> Highest:
    """Climb from the next optima of the search too, and take the highest end.

    A search has few nodes: with those of the answer another optimum than its best may be the
    highest. One that is ruled out by these is not climbed from.
    """
    looked, climbs, ascents = [], list[Optimum](), found.ascents
    following = end.likelihood.continued
    for optimum in _looked_at(following, found):
        if not _possible(optimum, end):
            looked.append(optimum)
            continue
        climbs.append(_climbed(following.nearest(optimum.alpha), optimum))
        ascents = tuple(_moved(ascent, optimum, climbs[-1]) for ascent in ascents)
    best = max(climbs, key=lambda one: one.log_likelihood, default=None)
    if best is not None and best.log_likelihood > end.value + HIGHER:
        climbs.append(Optimum(end.alpha, end.value, found.optima[0].starts))
        end = max(settled(end.likelihood, best.alpha), end, key=lambda one: one.value)
        found = replace(found, once=_reached(end, ascents) < 2)
    known = [end.alpha]
    for climb in sorted(climbs, key=lambda one: -one.log_likelihood):
        if not any(_same(climb.alpha, alpha, end) for alpha in known):
            known.append(climb.alpha)
            looked.append(climb)
    return Highest.of(end, replace(found, ascents=ascents), looked, found.optima[1 + LOOKED :])


def _looked_at(objective: Following, found: SearchResult) -> list[Optimum]:
    """The next optima of a search with log-likelihoods by other nodes."""
    return [
        replace(optimum, log_likelihood=objective(optimum.alpha).total)
        for optimum in found.optima[1 : 1 + LOOKED]
    ]


def _possible(optimum: Optimum, end: Settled) -> bool:
    return end.value - optimum.log_likelihood < RULED_OUT


def _climbed(likelihood: IndividualLikelihood, optimum: Optimum) -> Optimum:
    held, alpha = climbed(likelihood, optimum.alpha)
    return replace(optimum, alpha=alpha, log_likelihood=held.evaluate(alpha).total)


def _moved(ascent: Ascent, optimum: Optimum, climb: Optimum) -> Ascent:
    """An ascent that ended at an optimum, ended where a climb from there did."""
    if not np.array_equal(ascent.alpha, optimum.alpha):
        return ascent
    return replace(ascent, alpha=climb.alpha, log_likelihood=climb.log_likelihood)


def _reached(end: Settled, ascents: Sequence[Ascent]) -> int:
    """How many starts ended on the hill of the answer."""
    scores = end.likelihood(end.alpha).scores
    assert scores is not None
    free = np.flatnonzero([h.free for h in end.likelihood.hyperparameters])
    return sum(one_hill(a.alpha - end.alpha, scores, free) for a in ascents)


def _same(alpha: Array, other: Array, end: Settled) -> bool:
    scores = end.likelihood(end.alpha).scores
    assert scores is not None
    step = alpha - other
    return float(step @ outer(scores) @ step) < SAME**2
