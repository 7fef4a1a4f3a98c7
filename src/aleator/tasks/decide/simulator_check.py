"""A probability by a surface, held against runs of the simulator where they matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.inference.decisions.event import Event
from aleator.tasks.decide.near import REACH, Near, some_of
from aleator.tasks.decide.points import Points, normal_points
from aleator.tasks.decide.sample import chosen_laws, points_at, variates
from aleator.types import Array, Flags

CHECKS = 20
LAWS = 32
"""Laws among which the points of the runs are chosen."""
DOUBTED = 0.7
"""Share of the runs that are near the ends of the event; the others are anywhere in it."""
SEED = 11
POOL = 4096
"""Points by which the probability of an unseen region is computed."""
MISSED = 0.05
"""Chance that a region is missed which is said to be excluded."""


@dataclass(frozen=True)
class Exploration:
    """How a surface is tested where nothing is known of it.

    Chosen by trials with three hills off the design point; `benchmarks limit_states` measures it.

    Each of at most `rounds` rounds makes `runs` fresh runs, half of them by the law and half
    evenly over a ball, so large that `beyond` of the probability lies farther. A run
    contradicts the surface that misses it by more than `share` of its distance from the event's
    end and the outcome's standard deviation together. The surface then goes through all of them.
    """

    runs: int = 96
    rounds: int = 3
    beyond: float = 0.1
    share: float = 0.1


@dataclass(frozen=True, eq=False)
class Explored:
    """Fresh runs x (R, n), and whether each contradicts a surface.

    `unseen` is the largest probability of a region that runs like these had missed by more than
    5 % chance.
    """

    x: Array
    contrary: Flags
    unseen: float


@dataclass(frozen=True)
class Correction:
    """What `runs` of the simulator change of a probability, and the standard error of that."""

    value: float
    error: float
    runs: int


def explored(
    near: Near, draws: AlphaDraws, event: Event, probability: float, choice: Exploration, seed: int
) -> Explored:
    """Runs of the simulator all over the law and its tails, against the surface.

    Sobol' points of the variates, each under a law of its own.
    """
    assert near.surface is not None
    d = variates(near)
    farthest = stats.chi.isf(max(choice.beyond * probability, 1e-300), d)
    u, _ = _all_over(choice.runs, d, min(farthest, REACH), SEED + seed)
    _, weights = _all_over(POOL, d, min(farthest, REACH), SEED + seed)
    unseen = unseen_by(weights, choice.runs)
    rng = np.random.default_rng([SEED, seed])
    laws, share = chosen_laws(draws)
    y, found = near.outcomes(laws, points_at(near, u))
    mass = (share[:, None] * found.weights).reshape(-1, len(u)).cumsum(axis=0)
    row = (mass < rng.uniform(size=len(u)) * mass[-1]).sum(axis=0)
    law, place = np.unravel_index(row * len(u) + np.arange(len(u)), y.shape)
    x, y = found.x[law, place], y[law, place]
    run = near.at_runs(laws[law], x, found.score[place])
    usual = near.outcomes(laws, points_at(near, normal_points(POOL // 16, d, SEED)))[0]
    scale = np.nan_to_num(event.distance(y)) + float(np.nanstd(usual))
    apart = np.abs(run - y) > choice.share * scale
    apart |= np.isnan(run) & event.holds(y)
    return Explored(x, apart, float(unseen))


def _all_over(count: int, d: int, radius: float, seed: int) -> tuple[Array, Array]:
    """Points (J, d), half of the law and half over a ball, and the law over their density (J,).

    Over the ball they are even in one or two variates, and nearer to the middle in more.
    """
    flat = min(d, 2)
    u, z = normal_points(count // 2, d, seed), normal_points(count // 2, d, seed + POOL)
    length = np.linalg.norm(z, axis=1, keepdims=True)
    u = np.concatenate([u, z / length * radius * stats.chi.cdf(length, d) ** (1.0 / flat)])
    r = np.linalg.norm(u, axis=1)
    ball = np.where(r < radius, flat * r ** (flat - 1) / radius**flat, 0.0)
    law = stats.chi.pdf(r, d)
    return u, law / (0.5 * law + 0.5 * ball)


def unseen_by(weights: Array, runs: int) -> float:
    """The largest probability of a region that so many runs miss by more than 5 % chance.

    It would have 1 - 0.05^(1/runs) of the density that they were drawn by, about 3/runs; of that
    share of the points (J,) the law's `weights` over this density are the largest where the
    region has the most. As of independent runs: of points that are spread evenly it is
    somewhat less.
    """
    share = 1.0 - MISSED ** (1.0 / runs)
    largest = np.sort(weights)[::-1][: int(np.ceil(share * len(weights)))]
    return float(np.sum(largest) / len(weights))


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
