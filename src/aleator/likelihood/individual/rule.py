"""The nodes of the integral before they are adapted: those of the standard normal law."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from aleator.polynomials.gauss import polished_rule
from aleator.polynomials.recurrence import hermite_recurrence
from aleator.types import Array


@dataclass(frozen=True)
class GaussHermite:
    """A tensor grid of Gauss-Hermite nodes, `per_dimension` in each of s variates.

    Exact where the integrand is the normal density it is adapted to, times a polynomial of degree
    2 q - 1 in each variate. Cost q^s nodes.

    >>> GaussHermite(3).nodes(2)[0].shape
    (9, 2)
    """

    per_dimension: int

    def nodes(self, dimensions: int) -> tuple[Array, Array]:
        """Nodes t (J, s) and the logarithms (J,) of their weights, which sum to one."""
        return _tensor(self.per_dimension, dimensions)

    @property
    def finer(self) -> GaussHermite:
        """The rule that tells how exact this one is: half as many nodes again, and two."""
        return GaussHermite(self.per_dimension + self.per_dimension // 2 + 2)


@lru_cache(maxsize=32)
def _tensor(per_dimension: int, dimensions: int) -> tuple[Array, Array]:
    # weights with all their digits: those far out are multiplied by exp(t^2/2)
    t, weights, _ = polished_rule(*hermite_recurrence(per_dimension), 2 * per_dimension - 2)
    t, weights = t[weights > 0.0], weights[weights > 0.0]
    if dimensions == 0:
        return np.zeros((1, 0)), np.zeros(1)
    nodes = np.array(list(product(t, repeat=dimensions)))
    logs = np.log(np.array(list(product(weights, repeat=dimensions)))).sum(axis=1)
    return nodes, logs
