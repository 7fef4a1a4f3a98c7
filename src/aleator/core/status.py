"""How the computation of an experiment's density ended, and the value for a search without one."""

from __future__ import annotations

import enum

DEGENERATE_VALUE = -1e8
"""The log-density for a search where no density exists: finite, and far below any real value."""


class Status(enum.IntEnum):
    """How the computation of the density of one experiment ended; SOLVED is the only success.

    >>> Status.SOLVED.explanation
    'the density has the moments asked for'
    """

    SOLVED = 0
    NOT_REALIZABLE = 1
    NOT_CONVERGED = 2
    OUTSIDE_SUPPORT = 3
    DEGENERATE = 4
    TOO_COARSE = 5

    @property
    def explanation(self) -> str:
        """One sentence for the user: what happened, and what to do about it."""
        return _EXPLANATIONS[self]


_EXPLANATIONS = {
    Status.SOLVED: "the density has the moments asked for",
    Status.NOT_REALIZABLE: (
        "no density on the support has these moments: "
        "use more nodes of the law, or fewer moments (the order of the density)"
    ),
    Status.NOT_CONVERGED: (
        "the fitted density misses the moments that it should have: "
        "use fewer moments (the order of the density) or more nodes of the law"
    ),
    Status.OUTSIDE_SUPPORT: (
        "the outcome lies outside the support of the density: "
        "widen the box or the laws, or add measurement noise"
    ),
    Status.DEGENERATE: (
        "the outcome has no scatter or its moments are not finite: "
        "add measurement noise or leave the experiment out"
    ),
    Status.TOO_COARSE: (
        "too few nodes for an outcome that changes this fast: use more nodes of the law"
    ),
}
