"""A probability by a surface, held against runs of the simulator where they matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.inference.decisions.event import Event
from aleator.tasks.decide.near import Near, some_of
from aleator.tasks.decide.points import Points
from aleator.types import Array

CHECKS = 20
LAWS = 32
"""Laws among which the points of the runs are chosen."""
DOUBTED = 0.7
"""Share of the runs that are near the ends of the event; the others are anywhere in it."""
SEED = 11


@dataclass(frozen=True)
class Correction:
    """What `runs` of the simulator change of a probability, and the standard error of that."""

    value: float
    error: float
    runs: int


def corrected(
    near: Near, draws: AlphaDraws, event: Event, points: Points, checks: int
) -> Correction:
    """The difference of simulator and surface, by runs drawn where that is likely.

    1/R sum_r (1_simulator - 1_surface) m_r/q_r over points drawn with probability q, which is
    larger near an end of the event, in errors of the surface; m is the mass of a point. Where all
    agree the correction is zero, and its error is that mass of which one of R + 1 might differ.
    What is in the event far from where the surface sees it is not found.
    """
    assert near.surface is not None
    which = some_of(draws, LAWS)
    alphas, share = draws.alpha[which], draws.weights[which]
    y, found = near.outcomes(alphas, points)
    mass = (share / share.sum())[:, None] * found.weights
    inside = event.holds(y)
    doubt = mass * np.exp(-np.nan_to_num(event.distance(y), nan=np.inf) / _scale(near, y))
    held = mass * inside
    if not doubt.sum() > 0.0:
        return Correction(0.0, 0.0, 0)
    chance = doubt / doubt.sum()
    if held.sum() > 0.0:
        chance = DOUBTED * chance + (1.0 - DOUBTED) * held / held.sum()
    rng = np.random.default_rng(SEED)
    chosen = rng.choice(chance.size, size=checks, p=chance.ravel() / chance.sum())
    law, place = np.unravel_index(chosen, chance.shape)
    run = near.at_runs(alphas[law], found.x[law, place], found.score[place])
    ratio = mass[law, place] / chance[law, place]
    apart = (event.holds(run).astype(float) - inside[law, place]) * ratio
    doubted = float(doubt.sum()) / (checks + 1)
    error = np.hypot(float(np.std(apart, ddof=1)) / np.sqrt(checks), doubted)
    return Correction(float(apart.mean()), float(error), checks)


def _scale(near: Near, y: Array) -> float:
    """The surface's error, or what rounding leaves of it."""
    assert near.surface is not None
    size = float(np.nanmax(np.abs(y)))
    return max(near.surface.error, 1e-12 * size, 1e-300)
