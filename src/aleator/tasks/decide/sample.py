"""Points of the variates by which the probability of an event, rare or not, is computed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.inference.decisions.event import Event
from aleator.inference.decisions.importance import (
    CrossEntropy,
    Mixture,
    importance_density,
    uniform_points,
)
from aleator.tasks.decide.near import Near, some_of
from aleator.tasks.decide.points import Parameters, Points
from aleator.types import Array, Flags

REPLICATES = 16
"""Independent samples, whose scatter is the error."""
EACH = 256
"""Points of each."""
LAWS = 32
"""Laws that an importance density is sought for, the estimate's among them."""
FAR = 2.5
"""By how much points that a surface is first made exact at are farther out than the law says."""
PLACED = 24
"""Such points for each law."""
FOLLOWED = 8
"""Laws by which a surface is placed."""
SURE = 2.0
"""Standard deviations of kriging within which an outcome is possible."""
ROUNDS = 6
STILL = 0.02
"""A relative change of the probability by a surface that is none."""
SEARCHES = 40
"""Rounds of the search for the point of an event that is nearest to the middle of the law."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Replicates of points, of the law itself or of an importance `density`.

    `reached` says whether a point of the event was found.
    """

    replicates: tuple[Points, ...]
    density: Mixture | None = None
    reached: bool = True

    @property
    def joined(self) -> Points:
        """The points of all replicates."""
        return Points.joined(self.replicates)


def of_law(near: Near) -> Sample:
    """Points of the law itself."""
    s = near.ground.inputs.scattering
    return Sample(tuple(Points.standard(EACH, s, seed) for seed in range(REPLICATES)))


def about_event(
    near: Near, draws: AlphaDraws, event: Event, choice: CrossEntropy | None = None
) -> Sample:
    """Points of an importance density of the event, under the estimate and other laws alike.

    A surface is made exact there first: where the points of the density lie, and again where those
    of the next one do, until the probability that it tells stays. The laws of all draws share the
    points: the variates of an event move little with alpha.
    """
    laws, choice = chosen_laws(draws), choice or CrossEntropy()
    if near.surface is not None:
        near.surface.follow(near.wide(laws[0][:FOLLOWED], FAR, PLACED))
    before, found = np.nan, sought(near, draws, event, choice)
    for _ in range(ROUNDS if near.surface is not None and found.reached else 0):
        assert near.surface is not None
        points = found.replicates[0]
        away, weights = missed(near, laws, event, points)
        now = float(np.sum(weights, where=away == 0.0))
        if abs(now - before) < STILL * now:
            break
        before = now
        x = near.outcomes(laws[0][:FOLLOWED], _heavy(points, away, weights))[1].x
        near.surface.follow(x.reshape(-1, x.shape[2]))
        found = sought(near, draws, event, choice)
    return found


def sought(near: Near, draws: AlphaDraws, event: Event, choice: CrossEntropy) -> Sample:
    """The same by the surface as it is, or by the simulator."""
    laws = chosen_laws(draws)
    return _sought(near, lambda points: missed(near, laws, event, points), choice)


def possible(near: Near, draws: AlphaDraws, event: Event, choice: CrossEntropy) -> Sample:
    """Points about all that may be in the event: within two standard deviations of kriging."""
    laws = chosen_laws(draws, FOLLOWED)

    def away(points: Points) -> tuple[Array, Array]:
        y, apart, found = near.possible(laws[0], points)
        least = np.maximum(event.missed(y) - SURE * apart, 0.0)
        return _by_law(least, found, laws[1], points)

    return _sought(near, away, choice)


def _sought(
    near: Near, away: Callable[[Points], tuple[Array, Array]], choice: CrossEntropy
) -> Sample:
    if near.ground.measured is not None:
        return of_law(near)
    density, reached = importance_density(
        lambda u: away(points_at(near, u)), variates(near), choice
    )
    seeds = range(100, 100 + REPLICATES)
    return Sample(tuple(drawn(near, density, EACH, seed) for seed in seeds), density, reached)


def _heavy(points: Points, away: Array, weights: Array) -> Points:
    """A quarter of the points: those of the event that weigh most, and the nearest others."""
    mass = np.sum(weights, axis=0, where=away == 0.0)
    order = np.lexsort((np.min(away, axis=0), -mass))[: len(mass) // 4]
    return Points(points.xi[order], points.score[order], points.weights[order])


def drawn(near: Near, density: Mixture, count: int, seed: int) -> Points:
    """Points of a density, with their weights; `count` is a power of two."""
    u = density.drawn(uniform_points(count, variates(near) + 1, seed))
    return points_at(near, u, density.weights(u))


def points_at(near: Near, u: Array, weights: Array | None = None) -> Points:
    """The points u (J, d): parameters' variates first, then the error's if there is one."""
    s = near.ground.inputs.scattering
    score = np.zeros(len(u)) if near.ground.errors is None else u[:, s]
    return Points(u[:, :s], score, np.ones(len(u)) if weights is None else weights)


def variates(near: Near) -> int:
    """Variates of parameters and errors, one at least."""
    return max(near.ground.inputs.scattering + (near.ground.errors is not None), 1)


def chosen_laws(draws: AlphaDraws, count: int = LAWS) -> tuple[Array, Array]:
    """Some laws (L, K) and their weights (L,): the estimate and draws along the sequence."""
    if draws.certain:
        return draws.alpha, np.ones(1)
    which = some_of(draws, count - 1)
    alphas = np.concatenate([draws.estimate[None], draws.alpha[which]])
    weights = np.concatenate([[draws.weights[which].mean()], draws.weights[which]])
    return alphas, weights / weights.sum()


def missed(
    near: Near, laws: tuple[Array, Array], event: Event, points: Points
) -> tuple[Array, Array]:
    """By how much (L, J) each law and class misses the event at the points, and its weight."""
    y, found = near.outcomes(laws[0], points)
    return _by_law(event.missed(y), found, laws[1], points)


def _by_law(away: Array, found: Parameters, share: Array, points: Points) -> tuple[Array, Array]:
    """A row for each law and class."""
    shape = (-1, len(points.score))
    weights = found.weights * share[:, None] * len(points.score)
    return away.reshape(shape), weights.reshape(shape)


def by_some(near: Near, draws: AlphaDraws, event: Event, points: Points) -> float:
    """The probability of an event by points, under the laws that its density is sought for."""
    away, weights = missed(near, chosen_laws(draws), event, points)
    return float(np.sum(weights, where=away == 0.0)) / len(points.score)


def often(near: Near, draws: AlphaDraws, event: Event) -> bool:
    """Whether the event is more likely than its contrary."""
    laws = chosen_laws(draws)
    away, weights = missed(near, laws, event, Points.standard(EACH, near.ground.inputs.scattering))
    return bool(np.sum(weights, where=away == 0.0) > 0.5 * np.sum(weights, where=away < np.inf))


def distance_of(near: Near, alpha: Array, event: Event, samples: Sequence[Points]) -> float:
    """The length of the shortest variates that lead to the event under one law.

    From the shortest of the points, by random steps that are halved where none is shorter. NaN
    where no point leads there.
    """

    def inside(points: Points) -> Flags:
        away = missed(near, (alpha[None], np.ones(1)), event, points)[0]
        return np.asarray(np.any(away == 0.0, axis=0))

    s = near.ground.inputs.scattering
    points = Points.joined(samples)
    u = np.column_stack([points.xi, points.score])[:, : variates(near)]
    u = u[inside(points)]
    if not len(u) or variates(near) > u.shape[1]:
        return float("nan")
    best = u[np.argmin(np.sum(u**2, axis=1))]
    rng, step = np.random.default_rng(s), 0.5
    for _ in range(SEARCHES):
        tried = best + step * rng.normal(size=(EACH, best.size))
        tried = tried[np.sum(tried**2, axis=1) < np.sum(best**2)]
        tried = tried[inside(points_at(near, tried))] if len(tried) else tried
        if not len(tried):
            step *= 0.5
        else:
            best = tried[np.argmin(np.sum(tried**2, axis=1))]
    return float(np.linalg.norm(best))
