"""What a rule of nodes is asked: where they lie, and whether more are needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from aleator.likelihood.individual.modes import NEAR, Curved, Modes, Valued
from aleator.types import Array


class Rule(Protocol):
    """Nodes of the integral over the s standard normal variates of an experiment."""

    @property
    def name(self) -> str:
        """Name for reports."""

    @property
    def centers(self) -> int:
        """M, the modes of an experiment that the nodes lie about."""

    @property
    def arrived(self) -> float:
        """What the steps to these modes may have left to gain in log-density, at least."""

    @property
    def holds_parameters(self) -> bool:
        """Whether its nodes are held as parameters, and not as variates (see `Parameters`)."""

    @property
    def rough(self) -> Rule:
        """One with few nodes that serves for statistics of many replicates."""

    def size(self, dimensions: int) -> int:
        """J, the number of nodes."""

    def finer(self, dimensions: int) -> tuple[Rule, ...]:
        """The rules that tell how exact this one is."""

    def refined(self, gaps: Sequence[float], enough: float, dimensions: int) -> Rule | None:
        """One with more nodes, where the finer rules change more than enough by these gaps.

        None where they do not, and where more nodes would be too many.
        """

    def told(self, gaps: Sequence[float], dimensions: int) -> float:
        """What more nodes change altogether, by what each of the finer rules changes."""

    def about(
        self, curved: Curved, valued: Valued, found: Modes, first: int
    ) -> tuple[Array, Array]:
        """Nodes xi (B, C J, s) of experiments first, ..., first + B - 1, and log weights (B, C J).

        About the M modes (B, C, M, s) of each of C classes, the highest first, under a log-density
        that is known with and without its slopes.
        """


class AsManyAsNeeded:
    """What rules have in common whose panels are halved until they are enough."""

    @property
    def arrived(self) -> float:
        """A mode only says where panels begin, or how they lie."""
        return NEAR

    @property
    def holds_parameters(self) -> bool:
        """Yes: they are where an outcome is not smooth."""
        return True

    @property
    def centers(self) -> int:
        """One mode is known; the panels look for others themselves."""
        return 1

    def refined(
        self,
        gaps: Sequence[float],  # noqa: ARG002
        enough: float,  # noqa: ARG002
        dimensions: int,  # noqa: ARG002
    ) -> Rule | None:
        """None: panels are as many as are needed."""
        return None

    def told(self, gaps: Sequence[float], dimensions: int) -> float:  # noqa: ARG002
        """What more nodes in each panel change."""
        return float(sum(gaps))
