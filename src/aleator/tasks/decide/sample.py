"""Points of the variates at which an event, rare or not, is looked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.inference.decisions.design_points import about, design_points, kept_points
from aleator.inference.decisions.event import Event
from aleator.tasks.decide.near import Near, some_of
from aleator.tasks.decide.points import Points, normal_points
from aleator.types import Array

REPLICATES = 8
"""Independent samples, whose scatter is the error that is told."""
EACH = 512
"""Points of each."""
FAR = 2.5
"""By how much pilot points are farther out than the law says."""
PILOT = 512
LAWS = 8
"""Laws whose most probable points are sought, the estimate's among them."""
ROUNDS = 6
STILL = 0.02
"""A change of the distance of the most probable point that is none."""
BEHIND = 1.5
"""How far behind the most probable point a surface is made exact, in standard deviations."""
PLACED = 24
"""Points for each law by which a surface is sharpened near the event."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Replicates of points; `reached` says whether a point of the event was found.

    `distance` is that of the most probable point under the estimate, `nearest` the least under any
    of the laws that were asked; both NaN for points of the law itself.
    """

    replicates: tuple[Points, ...]
    distance: float = float("nan")
    nearest: float = float("nan")
    reached: bool = True

    @property
    def plain(self) -> bool:
        """Whether the points are those of the law itself."""
        return bool(np.isnan(self.nearest))

    @property
    def joined(self) -> Points:
        """The points of all replicates."""
        return Points.joined(self.replicates)


def of_law(near: Near) -> Sample:
    """Points of the law itself."""
    s = near.ground.inputs.scattering
    return Sample(tuple(Points.standard(EACH, s, seed) for seed in range(REPLICATES)))


def about_event(near: Near, draws: AlphaDraws, event: Event) -> Sample:
    """Points about the most probable points of a rare event, under the estimate and other laws.

    A surface is made exact there first: runs are placed about the points that it tells, and they
    are sought again, until they stay where they are. The laws of all draws share the points: the
    variates of an event move little with alpha.
    """
    chosen = np.concatenate([draws.estimate[None], draws.alpha[some_of(draws, LAWS - 1)]])
    if near.surface is not None:
        near.surface.follow(near.wide(chosen, FAR, PLACED))
    before, found = np.inf, Sample((), reached=False)
    for _ in range(ROUNDS):
        own = _centers(near, chosen[:1], event)
        others = _centers(near, chosen[1:], event)
        centers = np.concatenate([own, others])
        if not len(centers):
            return Sample(of_law(near).replicates, reached=False)
        centers = kept_points(centers)
        nearest = float(np.linalg.norm(centers[0]))
        distance = float(np.linalg.norm(own[0])) if len(own) else float("nan")
        found = Sample(_points(near, centers), distance, nearest)
        if near.surface is None or abs(nearest - before) < STILL:
            break
        before = nearest
        near.surface.follow(_where(near, chosen, found))
    return found


def _centers(near: Near, alphas: Array, event: Event) -> Array:
    """Design points (M, s + 1) of all laws and classes, the nearest first."""
    s = near.ground.inputs.scattering
    pilot = normal_points(PILOT, s + 1, 9)
    pilot[: PILOT // 2] *= FAR
    if near.ground.errors is None:
        pilot[:, s] = 0.0
    classes = range(len(near.ground.inputs.classes))
    found = [
        design_points(near.response(alpha, kind), event, pilot)
        for alpha in alphas
        for kind in classes
    ]
    every = np.concatenate(found)
    return kept_points(every) if len(every) else every


def _points(near: Near, centers: Array) -> tuple[Points, ...]:
    s = near.ground.inputs.scattering
    found = []
    for seed in range(REPLICATES):
        u, weights = about(centers, normal_points(EACH, s + 2, 100 + seed))
        found.append(Points(u[:, :s], u[:, s], weights))
    return tuple(found)


def _where(near: Near, alphas: Array, sample: Sample) -> Array:
    """Parameters (D, n) near the event, under some laws; what is far behind it has no mass."""
    first = sample.replicates[0]
    out = np.hypot(np.linalg.norm(first.xi, axis=1), first.score)
    chosen = np.flatnonzero(out < sample.nearest + BEHIND)[::4]
    few = Points(first.xi[chosen], first.score[chosen], first.weights[chosen])
    x = near.outcomes(alphas, few)[1].x
    return x.reshape(-1, x.shape[2])
