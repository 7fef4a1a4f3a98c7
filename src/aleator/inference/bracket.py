"""The search for the value at which a root that grows away from a maximum reaches a target."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class BracketSettings:
    """How the next value is chosen, and when a root jumps; by judgement.

    Distances are those from the maximum, enclosures the distance of the inner and the outer value.

    farthest: times the distance so far that a step outward may reach. nearest: times the distance
    so far that it reaches at least. outward: the same of a step without the help of a slope.
    beyond: times the target at which such a step aims, so that it passes it. least: the root is
    taken to be at least so large there.
    near, jump: share of the distance and growth of the root; a smaller enclosure over which the
    root grows by more is odd. closed: share of the distance; a smaller enclosure is one point, and
    there is a jump. tiny: a value closer to the maximum than this is the maximum.
    newton: share of the enclosure at either end in which Newton's step is not trusted.
    margin: share of the enclosure that the next value stays away from either end.
    """

    farthest: float = 3.0
    nearest: float = 1.02
    outward: float = 1.2
    beyond: float = 1.1
    least: float = 0.3
    near: float = 0.05
    jump: float = 0.5
    closed: float = 1e-3
    tiny: float = 1e-300
    newton: float = 0.02
    margin: float = 0.05


BRACKET = BracketSettings()


@dataclass(frozen=True)
class Bracket:
    """One side of a maximum at `center`, up to a `limit`; what encloses the end so far.

    `inner` and `outer` are values with their roots below and above the target; `outer` is NaN
    until one was found. `stalled` counts the steps that did not halve the enclosure.
    """

    target: float
    center: float
    limit: float
    inner: tuple[float, float]
    outer: tuple[float, float] = (float("nan"), float("nan"))
    stalled: int = 0
    settings: BracketSettings = BRACKET

    @classmethod
    def around(cls, center: float, limit: float, target: float) -> Bracket:
        """Nothing known but the maximum."""
        return cls(target, center, limit, (center, 0.0))

    @property
    def closed(self) -> bool:
        """Whether no value is left between the two: the root jumps over its target."""
        gap = abs(self.outer[0] - self.inner[0])
        least = self.settings.closed * abs(self.outer[0] - self.center)
        return bool(gap <= max(least, self.settings.tiny))

    @property
    def jumps(self) -> bool:
        """Whether the root seems to jump: its outer value may be that of a lower maximum."""
        gap = abs(self.outer[0] - self.inner[0])
        near = gap < self.settings.near * abs(self.outer[0] - self.center)
        grown = self.outer[1] - self.inner[1]
        return bool(grown < np.inf and (self.closed or (near and grown > self.settings.jump)))

    @property
    def without_outer(self) -> Bracket:
        """The same, nothing known beyond the inner value."""
        return replace(self, outer=(float("nan"), float("nan")), stalled=0)

    def with_root(self, value: float, root: float) -> Bracket:
        """The same when the root at a value is known, inf where it has none."""
        if root < self.target:
            found = replace(self, inner=(value, root))
        else:
            found = replace(self, outer=(value, root))
        before, after = (abs(b.outer[0] - b.inner[0]) for b in (self, found))
        return replace(found, stalled=found.stalled + 1 if after > 0.5 * before else 0)

    def next(self, value: float, root: float, slope: float) -> float:
        """Where to look next; `slope` is that of the root's half square, downward, at the value.

        Newton's step on the root, which grows about linearly with the distance. Where its slope is
        of no use a secant, a middle, or a step outward, at most threefold.
        """
        # the profile's slope is the score of what is held (envelope theorem); root^2/2 is its drop
        steep = -slope / root if 0.0 < root < np.inf else 0.0
        newton = value + (self.target - root) / steep if steep else float("nan")
        if not np.isfinite(self.outer[0]):
            return self._outward(newton)
        gap = self.outer[0] - self.inner[0]
        share = (newton - self.inner[0]) / gap if gap else float("nan")
        if not self.settings.newton <= share <= 1.0 - self.settings.newton:
            share = (self.target - self.inner[1]) / (self.outer[1] - self.inner[1])
        if self.stalled > 1 or not np.isfinite(self.outer[1]):
            share = 0.5
        margin = self.settings.margin
        return float(self.inner[0] + min(max(share, margin), 1.0 - margin) * gap)

    def _outward(self, newton: float) -> float:
        reach, chosen = self.inner[0] - self.center, self.settings
        aim = chosen.beyond * self.target / max(self.inner[1], chosen.least)
        factor = min(chosen.farthest, aim)
        nearest = self.center + chosen.nearest * reach
        farthest = self.center + chosen.farthest * reach
        if not min(nearest, farthest) <= newton <= max(nearest, farthest):
            newton = self.center + max(factor, chosen.outward) * reach
        return self.within(newton)

    def within(self, value: float) -> float:
        """The value, or the limit where it lies beyond."""
        return float(
            max(value, self.limit) if self.limit <= self.center else min(value, self.limit)
        )
