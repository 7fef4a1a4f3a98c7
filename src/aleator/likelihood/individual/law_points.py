"""Points of the law itself, whatever was observed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.likelihood.individual.importance import shifted_points
from aleator.likelihood.individual.modes import Curved, Modes, Valued
from aleator.likelihood.individual.rule import AsManyAsNeeded
from aleator.types import Array


@dataclass(frozen=True)
class LawPoints(AsManyAsNeeded):
    """Quasi-random points of the law, those of each experiment its own.

    int g phi dxi = 1/J sum_j g(xi_j). What was simulated there serves for any observations, each
    with an error that is the larger the less of the law is likely under it.
    """

    count: int

    @property
    def name(self) -> str:
        """Name for reports."""
        return "points of the law"

    @property
    def rough(self) -> LawPoints:
        """The same."""
        return self

    def size(self, dimensions: int) -> int:  # noqa: ARG002  one interface for all rules
        """J, the number of points."""
        return self.count

    def finer(self, dimensions: int) -> tuple[LawPoints, ...]:  # noqa: ARG002
        """None is asked."""
        return ()

    def about(
        self,
        curved: Curved,  # noqa: ARG002
        valued: Valued,  # noqa: ARG002
        found: Modes,
        first: int,
    ) -> tuple[Array, Array]:
        """Points xi (B, C J, s) of B experiments with C classes, and log weights."""
        experiments, classes, _, s = found.z.shape
        own = shifted_points(self.count, s, first + np.arange(experiments))
        xi = np.tile(own, (1, classes, 1))
        return xi, np.full(xi.shape[:2], -np.log(self.count))
