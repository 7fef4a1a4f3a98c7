"""What a search climbs: a likelihood whose nodes follow alpha."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from aleator.likelihood.individual.parameters import distance
from aleator.likelihood.individual.toward import toward
from aleator.search.value import LogLikelihood
from aleator.types import Array

if TYPE_CHECKING:
    from aleator.likelihood.individual.likelihood import IndividualLikelihood

VALUE = 0.01
"""Error of a log-likelihood over what its modes are found to."""
REMEMBERED = 8_000_000
"""Nodes, held as parameters, that an objective remembers."""
FARTHEST = 1.0
"""Distance in law (see `Parameters`) that a step may go, and by how much one is made shorter."""
SHORTER = 0.6


class Following:
    """An objective whose nodes are adapted to every alpha that is asked for.

    Its score is exact but for the error of the quadrature. Modes are sought from the last ones, and
    nodes that are held as parameters serve until the laws have moved far: the nearest are taken of
    some that it remembers, and that is all it does. Where an experiment has one mode, the value is
    a function of alpha alone. Modes are found to `arrived` in log-density.
    """

    def __init__(self, likelihood: IndividualLikelihood, arrived: float) -> None:
        self._known, self._arrived = [likelihood], arrived
        self.resolution = VALUE * arrived

    def __call__(self, alpha: Array) -> LogLikelihood:
        """Value and score at alpha (K,)."""
        return self._adapted(alpha)(alpha)

    def values(self, alphas: Array) -> Array:
        """The totals (A,) at alphas (A, K)."""
        return np.array([self._adapted(a).evaluate(a).total for a in np.asarray(alphas)])

    def toward(self, alpha: Array) -> tuple[float, Array]:
        """log L at alpha, and where it may be larger (see `toward`)."""
        return toward(self._adapted(alpha), alpha)

    def reach(self, alpha: Array, ahead: Array) -> float:
        """The share of the way from alpha (K,) to another that a step may go.

        Where nodes are held as parameters a step far beyond them costs new ones, and what made it
        so long was seen here only.
        """
        nearest, share = self.nearest(alpha), 1.0
        while (
            nearest.parameters is not None
            and distance(nearest.inputs, alpha, alpha + share * (ahead - alpha)) > FARTHEST
        ):
            share *= SHORTER
        return share

    def remember(self, adapted: IndividualLikelihood) -> None:
        """Take these nodes where they are the nearest."""
        known = [*self._known, adapted] if adapted.parameters is not None else [adapted]
        while len(known) > 1 and sum(k.nodes.log_weight.size for k in known) > REMEMBERED:
            known = known[1:]
        self._known = known

    def nearest(self, alpha: Array) -> IndividualLikelihood:
        """That with the nodes nearest to alpha, of those that it remembers."""
        return min(self._known, key=lambda known: known.distance(alpha))

    def _adapted(self, alpha: Array) -> IndividualLikelihood:
        nearest = self.nearest(alpha)
        if nearest.distance(alpha) <= 1.0:
            return nearest
        found = nearest.adapted(alpha, self._arrived)
        if np.all(np.isfinite(found.nodes.mode)):
            self.remember(found)
        return found
