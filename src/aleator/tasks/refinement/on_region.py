"""The way by surfaces that are exact all over a region."""

from __future__ import annotations

from dataclasses import dataclass, replace

from aleator.inference.information import Inference
from aleator.surrogates import AdaptiveSurfaces
from aleator.tasks.refinement.interface import SURFACE, Refined, Refinement, moving
from aleator.tasks.region import interval_region, next_region
from aleator.types import Array

REGIONS = 6
"""Regions that an identification with a tolerance may try before it takes what it has."""


@dataclass(frozen=True)
class OnRegion(Refinement):
    """Surfaces exact all over a region, to the user's tolerance; the region follows the answer."""

    def search(self, seed: int) -> Refined:
        """The answer on a region that fits it."""
        with self.stage(SURFACE):
            surfaces, problem = self._first(seed)
        return self._followed(Refined(problem, self.full(problem, []), surfaces), surfaces)

    def hold(self, refined: Refined, _: Inference, intervals: Array) -> Refined | None:
        """The answer on a region that holds the laws at the ends of the intervals."""
        region = interval_region(refined.problem, refined.found.alpha, intervals)
        if region is None or refined.surfaces is None:
            return None
        return self._moved(refined, refined.surfaces, region)

    def _followed(self, refined: Refined, surfaces: AdaptiveSurfaces) -> Refined:
        for _ in range(REGIONS - 1):
            region = next_region(refined.problem, refined.found.alpha)
            if region is None:
                break
            refined = self._moved(refined, surfaces, region)
        return refined

    def _moved(self, refined: Refined, surfaces: AdaptiveSurfaces, region: Array) -> Refined:
        with self.stage(SURFACE):
            surfaces.move(moving(region))
            problem = self._problem(surfaces, region)
        return replace(refined, problem=problem, found=self.full(problem, [refined.found.alpha]))
