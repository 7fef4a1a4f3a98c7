"""Status of the density of one experiment, and the value for a search if there is no density."""

from __future__ import annotations

import enum

DEGENERATE_VALUE = -1e8
"""Log-density for a search where there is no density; finite, and far below any honest value."""


class Status(enum.IntEnum):
    """Status of the density of one experiment; every one but SOLVED has a remedy.

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
        """One sentence: what happened, and what to do about it."""
        return _EXPLANATIONS[self]


_EXPLANATIONS = {
    Status.SOLVED: "the density has the moments asked for",
    Status.NOT_REALIZABLE: (
        "no density on the support has these moments: "
        "use more nodes ([propagation] nodes) or fewer moments ([density] order)"
    ),
    Status.NOT_CONVERGED: (
        "the fitted density misses the moments that it should have: "
        "use fewer moments ([density] order) or more nodes ([propagation] nodes)"
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
        "too few nodes for an outcome that changes this fast: use more nodes ([propagation] nodes)"
    ),
}
