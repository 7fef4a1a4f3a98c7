"""The nodes of the integral before they are adapted: those of the standard normal law."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np

from aleator.polynomials.gauss import polished_rule
from aleator.polynomials.recurrence import hermite_recurrence
from aleator.types import Array

POINTS = 8
"""Gauss-Legendre nodes of half a panel."""
FINER = 12
"""The same of those that tell how exact these are."""
PANELS = 64
"""Halves of panels that an experiment takes, about."""


@dataclass(frozen=True)
class GaussHermite:
    """Gauss-Hermite nodes in each of s coordinates: `first` in the first, `others` in the others.

    Exact where the integrand is the normal density it is adapted to, times a polynomial of degree
    2 q - 1 in each coordinate of q nodes. The first coordinate is the one of which the
    observations tell least (see `adapted_nodes`), and wants most nodes.

    >>> GaussHermite(5, 3).nodes(2)[0].shape
    (15, 2)
    """

    first: int
    others: int | None = None

    def coordinate(self, i: int) -> tuple[Array, Array]:
        """Nodes t (q,) of coordinate i, and the logarithms (q,) of their weights, of sum one."""
        return _line(self.first if i == 0 or self.others is None else self.others)

    def nodes(self, dimensions: int) -> tuple[Array, Array]:
        """All nodes t (J, s) and the logarithms (J,) of their weights."""
        if dimensions == 0:
            return np.zeros((1, 0)), np.zeros(1)
        lines = [self.coordinate(i) for i in range(dimensions)]
        nodes = np.array(list(product(*(t for t, _ in lines))))
        return nodes, np.array(list(product(*(log_w for _, log_w in lines)))).sum(axis=1)

    def size(self, dimensions: int) -> int:
        """J, the number of all nodes."""
        return int(np.prod([self.coordinate(i)[0].size for i in range(dimensions)]))

    def finer(self, dimensions: int) -> tuple[Rule, ...]:
        """The rules that tell how exact this one is.

        Of one variate somewhat finer, and panels; else finer in the first, finer in the others.
        """
        others = self.others or self.first
        whole = replace(self, others=others)
        in_first = replace(whole, first=_more(self.first))
        if dimensions < 2:
            return (in_first, Panels())[: 2 * dimensions]
        return (in_first, replace(whole, others=_more(others)))


@dataclass(frozen=True)
class Panels:
    """Gauss-Legendre nodes in panels of one variate, halved until they are enough.

    `points` in each half of a panel. For an individual law with several modes, a plateau, a front,
    a kink or a jump. Cost: some hundred nodes an experiment.
    """

    points: int = POINTS

    def size(self, dimensions: int) -> int:  # noqa: ARG002  one interface for all rules
        """Nodes that an experiment takes, about."""
        return PANELS * self.points

    def finer(self, dimensions: int) -> tuple[Rule, ...]:  # noqa: ARG002
        """The rule that tells how exact this one is; none tells it of that."""
        return (Panels(FINER),) if self.points < FINER else ()


Rule = GaussHermite | Panels
"""How the nodes of an experiment are placed."""


def _more(nodes: int) -> int:
    """Half as many again, and two."""
    return nodes + nodes // 2 + 2


@lru_cache(maxsize=32)
def _line(count: int) -> tuple[Array, Array]:
    # weights with all their digits: those far out are multiplied by exp(t^2/2)
    t, weights, _ = polished_rule(*hermite_recurrence(count), 2 * count - 2)
    return t[weights > 0.0], np.log(weights[weights > 0.0])
