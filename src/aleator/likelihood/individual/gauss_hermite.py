"""Gauss-Hermite nodes about the mode of what an experiment's observations leave open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np

from aleator.likelihood.individual.modes import ARRIVED, NEAR, Curved, Modes, Valued, modes
from aleator.likelihood.individual.panels import Panels
from aleator.polynomials import hermite_recurrence, polished_rule
from aleator.types import Array

MOST = 3000
"""Nodes of an experiment beyond which no more are taken."""
FINEST = 250
"""Nodes of a variate beyond which no more are taken: their weights leave the floating numbers."""
TIE = 1e-6
"""Information that each variate is given more than the one before: directions that are informed
alike are else what rounding errors make of them."""


@dataclass(frozen=True)
class GaussHermite:
    """Gauss-Hermite nodes in each of s coordinates: `first` in the first, `others` in the others.

    Exact where the integrand is the normal density it is adapted to, times a polynomial of degree
    2 q - 1 in each coordinate of q nodes. The first coordinate is the one of which the
    observations tell least, and wants most nodes. What has several modes it takes for one.

    >>> GaussHermite(5, 3).nodes(2)[0].shape
    (15, 2)
    """

    first: int
    others: int | None = None

    @property
    def name(self) -> str:
        """Name for reports."""
        return "Gauss-Hermite"

    @property
    def centers(self) -> int:
        """The modes of an experiment that the nodes lie about."""
        return 1

    @property
    def arrived(self) -> float:
        """The nodes are as good as the mode is exact."""
        return ARRIVED

    @property
    def holds_parameters(self) -> bool:
        """No: nodes about a mode are where an outcome is smooth."""
        return False

    @property
    def rough(self) -> GaussHermite:
        """The same: its nodes are few, or the experiments need many."""
        return self

    def at_least(self, count: int) -> GaussHermite:
        """The same with so many nodes or more in every coordinate."""
        others = None if self.others is None else max(self.others, count)
        return GaussHermite(max(self.first, count), others)

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

    def finer(self, dimensions: int) -> tuple[GaussHermite | Panels, ...]:
        """The rules that tell how exact this one is.

        Of one variate somewhat finer, and panels; else finer in the first, finer in the others.
        """
        others = self.others or self.first
        whole = replace(self, others=others)
        in_first = replace(whole, first=_more(self.first))
        if dimensions < 2:
            return (in_first, Panels())[: 2 * dimensions]
        return (in_first, replace(whole, others=_more(others)))

    def refined(
        self, gaps: Sequence[float], enough: float, dimensions: int
    ) -> GaussHermite | Panels | None:
        """As many nodes as those finer rules have whose gaps are not small enough.

        None where all are, or where that would be too many nodes. Of the rules of one variate that
        tell the same as panels the first has the fewest nodes.
        """
        pairs = list(zip(self.finer(dimensions), gaps, strict=True))
        if dimensions < 2:
            whole = self.told(gaps, dimensions)
            same = (rule for rule, gap in pairs if abs(gap - whole) <= enough)
            return next(same) if abs(whole) > enough else None
        found = self
        for more, gap in pairs:
            if isinstance(more, GaussHermite) and abs(gap) > enough / len(gaps):
                found = GaussHermite(
                    max(found.first, more.first),
                    max(found.others or found.first, more.others or 0),
                )
        most = max(found.first, found.others or 0)
        fits = found.size(dimensions) <= MOST and most <= FINEST
        return found if found != self and fits else None

    def told(self, gaps: Sequence[float], dimensions: int) -> float:
        """All that panels change, who leave nothing out; else what more nodes change together."""
        return float(gaps[-1] if dimensions == 1 else sum(gaps))

    def about(
        self,
        curved: Curved,
        valued: Valued,  # noqa: ARG002
        found: Modes,
        first: int,  # noqa: ARG002
    ) -> tuple[Array, Array]:
        """Nodes xi (B, C J, s) about the highest mode of each class, and their log weights.

        The coordinates w = Q' xi are those of the eigenvectors Q of the information at the mode,
        the least informed first; where several are informed alike, as all but one are by a single
        observation, `TIE` chooses them, so that they move with alpha. Each has a Gauss-Hermite rule
        in turn, about its conditional mode given those before it and as wide as the information
        there says:

            w_i = w_i*(t_1 .. t_(i-1)) + c_i(t_1 .. t_(i-1)) t_i,
            weight = w_j prod_i c_i phi(xi)/phi(t).

        So the nodes follow a curved ridge, which is what fewer observations than parameters leave.
        Where the log-density is quadratic they are those of Liu and Pierce (1994).
        """
        z, information = found.z[:, :, 0], found.information[:, :, 0]
        s = z.shape[2]
        basis = np.linalg.eigh(information + TIE * np.diag(np.arange(s)))[1]
        log_weight = np.zeros(z.shape[:2])
        for i in range(s):
            # those of one mode are next to each other
            rest = np.repeat(basis, z.shape[1] // basis.shape[1], axis=1)[..., i:]
            left = np.linalg.inv(np.swapaxes(rest, -1, -2) @ information @ rest)
            scale = np.sqrt(left[..., 0, 0])
            # the others go along as the conditional normal law says
            along = (rest @ (left[..., :, :1] / scale[..., None, None]))[..., 0]
            t, log_w = self.coordinate(i)
            z = _spread(z[:, :, None] + t[:, None] * along[:, :, None])
            of_rule = log_w + 0.5 * t**2
            log_weight = _spread((log_weight + np.log(scale))[:, :, None] + of_rule)
            if i < s - 1:
                whole = np.repeat(rest, t.size, axis=1)[..., 1:]
                again = modes(curved, z, whole, NEAR, found.z.shape[1])
                z, information = again.z, again.information
        return z, log_weight - 0.5 * np.sum(z**2, axis=2)


def _more(nodes: int) -> int:
    """Half as many again, and two."""
    return nodes + nodes // 2 + 2


@lru_cache(maxsize=32)
def _line(count: int) -> tuple[Array, Array]:
    # weights with all their digits: those far out are multiplied by exp(t^2/2)
    t, weights, _ = polished_rule(*hermite_recurrence(count), 2 * count - 2)
    return t[weights > 0.0], np.log(weights[weights > 0.0])


def _spread(values: Array) -> Array:
    """(B, P, q, ...) as (B, P q, ...)."""
    return values.reshape(values.shape[0], -1, *values.shape[3:])
