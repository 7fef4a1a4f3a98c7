"""A probability by a surface, held against runs of the simulator where they matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.inference.decisions.event import Event
from aleator.tasks.decide.near import REACH, Exploration, Near
from aleator.tasks.decide.points import Points, normal_points
from aleator.tasks.decide.predictors import MOST
from aleator.tasks.decide.sample import LAWS, chosen_laws, points_at, variates
from aleator.types import Array, Flags

CHECKS = 20
DOUBTED = 0.7
"""Share of the runs that are near the ends of the event; the others are anywhere in it."""
SEED = 11
POOL = 4096
"""Points by which the probability of an unseen region, and of a surface's mistakes, is computed."""
MISSED = 0.05
"""Chance that a region is missed which is said to be excluded."""


@dataclass(frozen=True, eq=False)
class Explored:
    """Fresh runs x (R, n), and whether each contradicts a surface.

    `unseen` is the largest probability of a region that runs like these had missed by more than
    5 % chance.
    """

    x: Array
    contrary: Flags
    unseen: float


@dataclass(frozen=True, eq=False)
class Doubt:
    """What a surface has of an event at points x (L, J, n), of probabilities `mass` (L, J).

    `within` says which are in the event; `away` (L, J) are the distances of the outcomes from its
    ends, and `apart` (L, J) the outcomes' standard deviations that the runs leave.
    """

    x: Array
    score: Array
    alphas: Array
    mass: Array
    within: Flags
    away: Array
    apart: Array

    @classmethod
    def of(cls, near: Near, draws: AlphaDraws, event: Event, points: Points, count: int) -> Doubt:
        """By some of the points and so many laws."""
        laws, share = chosen_laws(draws, count)
        y, apart, found = near.possible(laws, points.thinned(POOL // len(laws)))
        mass = share[:, None] * found.weights
        away = np.nan_to_num(event.distance(y), nan=np.inf)
        return cls(found.x, found.score, laws, mass, event.holds(y), away, apart)

    @property
    def wrong(self) -> Array:
        """The probability (L, J) of points on the other side of an end than the surface says.

        m Phi(-d/s), m the mass, d the distance and s the standard deviation (Echard, Gayton and
        Lemaire, 2011).
        """
        return self.mass * _beyond(self.away, self.apart)

    @property
    def probability(self) -> float:
        """That of the event, by the surface."""
        return float(np.sum(self.mass, where=self.within))


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
    y, sd, found = near.possible(laws, points_at(near, u))
    mass = (share[:, None] * found.weights).reshape(-1, len(u)).cumsum(axis=0)
    row = (mass < rng.uniform(size=len(u)) * mass[-1]).sum(axis=0)
    law, place = np.unravel_index(row * len(u) + np.arange(len(u)), y.shape)
    x, y, sd = found.x[law, place], y[law, place], sd[law, place]
    run = near.at_runs(laws[law], x, found.score[place])
    usual = near.outcomes(laws, points_at(near, normal_points(POOL // 16, d, SEED)))[0]
    scale = np.nan_to_num(event.distance(y)) + float(np.nanstd(usual))
    sure = stats.norm.isf(0.5 * MISSED / choice.runs)
    apart = np.abs(run - y) > choice.share * scale + sure * sd
    apart |= np.isnan(run) & event.holds(y)
    return Explored(x, apart, float(unseen))


def settling(near: Near, doubt: Doubt, count: int) -> Array:
    """Points (count, n) of runs that leave the least probability on the wrong side of an end.

    A run lowers the variances of all outcomes by their covariances with its own. Each point is the
    best one after those before (stepwise uncertainty reduction; Bect et al., 2012), among those of
    which the surface has most wrong.
    """
    assert near.surface is not None
    wrong = doubt.wrong.ravel()
    top = np.argsort(-wrong, kind="stable")[:MOST]
    x, mass, away, apart = (
        part.reshape(wrong.size, -1)[top] for part in (doubt.x, doubt.mass, doubt.away, doubt.apart)
    )
    surface = near.surface.kriged
    joint, noise = surface.joint(x), surface.missed.noise
    # measurement errors may stretch deviations
    unit = apart / np.sqrt(np.maximum(np.diag(joint), noise))[:, None]
    chosen: list[int] = []
    for _ in range(count):
        variance = np.diag(joint) + noise
        left = np.sqrt(np.maximum(np.diag(joint)[:, None] - joint**2 / variance, 0.0))
        lowered = np.sum(mass * _beyond(away, unit * left), axis=0)
        lowered[chosen] = np.inf
        chosen.append(int(np.argmin(lowered)))
        best = joint[chosen[-1]]
        joint = joint - np.outer(best, best) / variance[chosen[-1]]
    return np.asarray(x[chosen])


def _beyond(away: Array, apart: Array) -> Array:
    """Phi(-d/s) of distances and standard deviations."""
    return np.asarray(special.ndtr(-_deviations(away, apart)))


def _deviations(away: Array, apart: Array) -> Array:
    with np.errstate(over="ignore"):
        return np.asarray(away / np.maximum(apart, np.finfo(float).tiny))


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
    larger near an end of the event, in standard deviations of the surface; m is the mass of a
    point. Where all agree the correction is zero, and its error is that mass of which one of R + 1
    might differ. What is in the event far from where the surface sees it is not found.
    """
    known = Doubt.of(near, draws, event, points, LAWS)
    doubt = known.mass * np.exp(-_deviations(known.away, known.apart))
    parts = ((DOUBTED, doubt), (1.0 - DOUBTED, known.mass * known.within))
    chance = np.sum(
        [share * part / part.sum() for share, part in parts if part.sum() > 0.0], axis=0
    )
    if not np.sum(chance) > 0.0:
        return Correction(0.0, 0.0, 0)
    chance = chance / chance.sum()
    rng = np.random.default_rng(SEED)
    chosen = rng.choice(chance.size, size=checks, p=chance.ravel())
    law, place = np.unravel_index(chosen, chance.shape)
    run = near.at_runs(known.alphas[law], known.x[law, place], known.score[place])
    ratio = known.mass[law, place] / chance[law, place]
    apart = (event.holds(run).astype(float) - known.within[law, place]) * ratio
    doubted = float(known.wrong.sum()) / (checks + 1)
    error = np.hypot(float(np.std(apart, ddof=1)) / np.sqrt(checks), doubted)
    return Correction(float(apart.mean()), float(error), checks)
