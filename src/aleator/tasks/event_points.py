"""Points by which the probability of an event, rare or not, is computed; and runs that check it.

`event_sample` seeks an importance density of the event, on a surface that is made exact there.
`explored` are fresh runs against a surface, `settling` those where it doubts, and `corrected` is
what runs near the ends of the event change of its probability.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from aleator.core.types import Array, Flags
from aleator.inference.alpha_draws import AlphaDraws
from aleator.inference.rare_events import (
    CrossEntropy,
    Event,
    ImportanceDensity,
    importance_density,
    uniform_points,
)
from aleator.tasks.new_experiments import (
    CONTEXT,
    DrawnParameters,
    Exploration,
    Points,
    PredictedValue,
    normal_points,
    some_of,
)


@dataclass(frozen=True)
class SampleSettings:
    """Points of an event and runs that check it: by judgement, see `benchmarks limit_states`."""

    laws: int = 32
    """Laws that an importance density is sought for, the estimate's among them."""
    far: float = 2.5
    """By how much points that a surface is first made exact at are farther out than the law says.
    """
    placed: int = 24
    """Such points for each law."""
    sure: float = 2.0
    """Standard deviations of kriging within which an outcome is possible."""
    rounds: int = 6
    """Rounds in which a surface follows the points of the event, at most."""
    still: float = 0.02
    """A relative change of the probability by a surface that is none."""
    searches: int = 40
    """Rounds of the search for the point of an event that is nearest to the middle of the law."""
    doubted: float = 0.7
    """Share of the runs that are near the ends of the event; the others are anywhere in it."""
    checks: int = 20
    """Runs near the ends of the event that correct a surface."""
    usual: int = 16
    """The outcome's scatter is by one in so many points of the pool."""
    seed: int = 11
    """Seed of fresh runs and of checks."""
    pool: int = 4096
    """Points by which the probability of an unseen region, and of a surface's mistakes, is
    computed.
    """
    missed: float = 0.05
    """Chance that a region is missed which is said to be excluded."""
    replicates: int = 16
    """Independent samples, whose scatter is the error."""
    each: int = 256
    """Points of each."""
    followed: int = 8
    """Laws by which a surface is placed."""


SAMPLE = SampleSettings()


@dataclass(frozen=True, eq=False)
class Sample:
    """Replicates of points, of the law itself or of an importance `density`.

    `reached` says whether a point of the event was found.
    """

    replicates: tuple[Points, ...]
    density: ImportanceDensity | None = None
    reached: bool = True

    @property
    def joined(self) -> Points:
        """The points of all replicates."""
        return Points.joined(self.replicates)


def of_law(predicted: PredictedValue) -> Sample:
    """Points drawn from the law itself."""
    s = predicted.context.inputs.scattering
    return Sample(tuple(Points.standard(SAMPLE.each, s, seed) for seed in range(SAMPLE.replicates)))


def event_sample(
    predicted: PredictedValue,
    draws: AlphaDraws,
    event: Event,
    choice: CrossEntropy | None = None,
    settings: SampleSettings = SAMPLE,
) -> Sample:
    """Points of an importance density of the event, on a surface made exact there.

    A surface is made exact there first: where the points of the density lie, and again where those
    of the next one do, until the probability that it tells stays. The laws of all draws share the
    points: the variates of an event move little with alpha.
    """
    laws, choice = chosen_laws(draws), choice or CrossEntropy()
    if predicted.surface is not None:
        predicted.surface.follow(
            predicted.wide(laws[0][: settings.followed], settings.far, settings.placed)
        )
    before, found = np.nan, sought(predicted, draws, event, choice)
    for _ in range(settings.rounds if predicted.surface is not None and found.reached else 0):
        assert predicted.surface is not None
        points = found.replicates[0]
        away, weights = missed(predicted, laws, event, points)
        now = float(np.sum(weights, where=away == 0.0))
        if abs(now - before) < settings.still * now:
            break
        before = now
        x = predicted.outcomes(laws[0][: settings.followed], _heavy(points, away, weights))[1].x
        predicted.surface.follow(x.reshape(-1, x.shape[2]))
        found = sought(predicted, draws, event, choice)
    return found


def sought(
    predicted: PredictedValue, draws: AlphaDraws, event: Event, choice: CrossEntropy
) -> Sample:
    """Points of an importance density of the event, by the present surface or the simulator."""
    laws = chosen_laws(draws)
    return _sought(predicted, lambda points: missed(predicted, laws, event, points), choice)


def possible(
    predicted: PredictedValue,
    draws: AlphaDraws,
    event: Event,
    choice: CrossEntropy,
    settings: SampleSettings = SAMPLE,
) -> Sample:
    """Points about all that may be in the event, within two kriging standard deviations."""
    laws = chosen_laws(draws, settings.followed)

    def away(points: Points) -> tuple[Array, Array]:
        y, apart, found = predicted.possible(laws[0], points)
        least = np.maximum(event.missed(y) - settings.sure * apart, 0.0)
        return _by_law(least, found, laws[1], points)

    return _sought(predicted, away, choice)


def _sought(
    predicted: PredictedValue, away: Callable[[Points], tuple[Array, Array]], choice: CrossEntropy
) -> Sample:
    if predicted.context.measured is not None:
        return of_law(predicted)
    density, reached = importance_density(
        lambda u: away(points_at(predicted, u)), variates(predicted), choice
    )
    seeds = range(100, 100 + SAMPLE.replicates)
    return Sample(
        tuple(drawn(predicted, density, SAMPLE.each, seed) for seed in seeds), density, reached
    )


def _heavy(points: Points, away: Array, weights: Array) -> Points:
    """The quarter of the points with the most weight in the event, then the nearest ones."""
    mass = np.sum(weights, axis=0, where=away == 0.0)
    order = np.lexsort((np.min(away, axis=0), -mass))[: len(mass) // 4]
    return Points(points.xi[order], points.score[order], points.weights[order])


def drawn(predicted: PredictedValue, density: ImportanceDensity, count: int, seed: int) -> Points:
    """Points of a density, with their weights; `count` is a power of two."""
    u = density.drawn(uniform_points(count, variates(predicted) + 1, seed))
    return points_at(predicted, u, density.weights(u))


def points_at(predicted: PredictedValue, u: Array, weights: Array | None = None) -> Points:
    """Points from variates u (J, d): those of parameters first, then that of the error."""
    s = predicted.context.inputs.scattering
    score = np.zeros(len(u)) if predicted.context.errors is None else u[:, s]
    return Points(u[:, :s], score, np.ones(len(u)) if weights is None else weights)


def variates(predicted: PredictedValue) -> int:
    """The number of variates of parameters and errors, at least one."""
    return max(predicted.context.inputs.scattering + (predicted.context.errors is not None), 1)


def chosen_laws(draws: AlphaDraws, count: int = SAMPLE.laws) -> tuple[Array, Array]:
    """Some laws (L, K) with weights (L,): the estimate, and draws along the sequence."""
    if draws.certain:
        return draws.alpha, np.ones(1)
    which = some_of(draws, count - 1)
    alphas = np.concatenate([draws.estimate[None], draws.alpha[which]])
    weights = np.concatenate([[draws.weights[which].mean()], draws.weights[which]])
    return alphas, weights / weights.sum()


def missed(
    predicted: PredictedValue, laws: tuple[Array, Array], event: Event, points: Points
) -> tuple[Array, Array]:
    """How far (L, J) outcomes miss the event at the points under each law, with weights."""
    y, found = predicted.outcomes(laws[0], points)
    return _by_law(event.missed(y), found, laws[1], points)


def _by_law(
    away: Array, found: DrawnParameters, share: Array, points: Points
) -> tuple[Array, Array]:
    """Misses and weights with a row for each law and class of a mixture."""
    shape = (-1, len(points.score))
    weights = found.weights * share[:, None] * len(points.score)
    return away.reshape(shape), weights.reshape(shape)


def by_some(predicted: PredictedValue, draws: AlphaDraws, event: Event, points: Points) -> float:
    """The probability of an event by points, under some of the laws."""
    away, weights = missed(predicted, chosen_laws(draws), event, points)
    return float(np.sum(weights, where=away == 0.0)) / len(points.score)


def often(predicted: PredictedValue, draws: AlphaDraws, event: Event) -> bool:
    """Whether the event is more likely than its contrary."""
    laws = chosen_laws(draws)
    away, weights = missed(
        predicted, laws, event, Points.standard(SAMPLE.each, predicted.context.inputs.scattering)
    )
    return bool(np.sum(weights, where=away == 0.0) > 0.5 * np.sum(weights, where=away < np.inf))


def distance_of(
    predicted: PredictedValue,
    alpha: Array,
    event: Event,
    samples: Sequence[Points],
    settings: SampleSettings = SAMPLE,
) -> float:
    """The distance of the event from the middle of the law, in standard deviations.

    From the shortest of the points, by random steps that are halved where none is shorter. NaN
    where no point leads there.
    """

    def inside(points: Points) -> Flags:
        away = missed(predicted, (alpha[None], np.ones(1)), event, points)[0]
        return np.asarray(np.any(away == 0.0, axis=0))

    s = predicted.context.inputs.scattering
    points = Points.joined(samples)
    u = np.column_stack([points.xi, points.score])[:, : variates(predicted)]
    u = u[inside(points)]
    if not len(u) or variates(predicted) > u.shape[1]:
        return float("nan")
    best = u[np.argmin(np.sum(u**2, axis=1))]
    rng, step = np.random.default_rng(s), 0.5
    for _ in range(settings.searches):
        tried = best + step * rng.normal(size=(settings.each, best.size))
        tried = tried[np.sum(tried**2, axis=1) < np.sum(best**2)]
        tried = tried[inside(points_at(predicted, tried))] if len(tried) else tried
        if not len(tried):
            step *= 0.5
        else:
            best = tried[np.argmin(np.sum(tried**2, axis=1))]
    return float(np.linalg.norm(best))


@dataclass(frozen=True, eq=False)
class Explored:
    """Fresh runs x (R, n), and which of them contradict a surface.

    `unseen` is the largest probability of a region that runs like these had missed by more than
    5 % chance.
    """

    x: Array
    contrary: Flags
    unseen: float


@dataclass(frozen=True, eq=False)
class SurfaceDoubt:
    """What a surface knows of an event at points x (L, J, n) with probabilities `mass` (L, J).

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
    def of(
        cls, predicted: PredictedValue, draws: AlphaDraws, event: Event, points: Points, count: int
    ) -> SurfaceDoubt:
        """What the surface knows at some of the points, under `count` laws."""
        laws, share = chosen_laws(draws, count)
        y, apart, found = predicted.possible(laws, points.thinned(SAMPLE.pool // len(laws)))
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
        """The probability of the event by the surface."""
        return float(np.sum(self.mass, where=self.within))


@dataclass(frozen=True)
class Correction:
    """The change of a probability by `runs` of the simulator, with its standard error."""

    value: float
    error: float
    runs: int


def explored(
    predicted: PredictedValue,
    draws: AlphaDraws,
    event: Event,
    probability: float,
    choice: Exploration,
    seed: int,
    settings: SampleSettings = SAMPLE,
) -> Explored:
    """Fresh runs of the simulator all over the law and its tails, compared with the surface.

    Sobol' points of the variates, each under a law of its own.
    """
    assert predicted.surface is not None
    d = variates(predicted)
    farthest = stats.chi.isf(max(choice.beyond * probability, np.finfo(float).tiny), d)
    u, _ = _all_over(choice.runs, d, min(farthest, CONTEXT.reach), settings.seed + seed, settings)
    _, weights = _all_over(
        settings.pool, d, min(farthest, CONTEXT.reach), settings.seed + seed, settings
    )
    unseen = unseen_by(weights, choice.runs, settings=settings)
    rng = np.random.default_rng([settings.seed, seed])
    laws, share = chosen_laws(draws)
    y, sd, found = predicted.possible(laws, points_at(predicted, u))
    mass = (share[:, None] * found.weights).reshape(-1, len(u)).cumsum(axis=0)
    row = (mass < rng.uniform(size=len(u)) * mass[-1]).sum(axis=0)
    law, place = np.unravel_index(row * len(u) + np.arange(len(u)), y.shape)
    x, y, sd = found.x[law, place], y[law, place], sd[law, place]
    run = predicted.at_runs(laws[law], x, found.score[place])
    usual = predicted.outcomes(
        laws, points_at(predicted, normal_points(settings.pool // settings.usual, d, settings.seed))
    )[0]
    scale = np.nan_to_num(event.distance(y)) + float(np.nanstd(usual))
    sure = stats.norm.isf(0.5 * settings.missed / choice.runs)
    apart = np.abs(run - y) > choice.share * scale + sure * sd
    apart |= np.isnan(run) & event.holds(y)
    return Explored(x, apart, float(unseen))


def settling(predicted: PredictedValue, doubt: SurfaceDoubt, count: int) -> Array:
    """Points (count, n) of runs that most reduce the surface's expected mistakes.

    A run lowers the variances of all outcomes by their covariances with its own. Each point is the
    best one after those before (stepwise uncertainty reduction; Bect et al., 2012), among those of
    which the surface has most wrong.
    """
    assert predicted.surface is not None
    wrong = doubt.wrong.ravel()
    top = np.argsort(-wrong, kind="stable")[: CONTEXT.places]
    x, mass, away, apart = (
        part.reshape(wrong.size, -1)[top] for part in (doubt.x, doubt.mass, doubt.away, doubt.apart)
    )
    surface = predicted.surface.kriged
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


def _all_over(
    count: int, d: int, radius: float, seed: int, settings: SampleSettings
) -> tuple[Array, Array]:
    """Points (J, d), half of the law and half over a ball, and their weights (J,).

    A weight is the density of the law over that of the points. Over the ball points are even in one
    or two variates, and nearer to the middle in more.
    """
    flat = min(d, 2)
    u, z = normal_points(count // 2, d, seed), normal_points(count // 2, d, seed + settings.pool)
    length = np.linalg.norm(z, axis=1, keepdims=True)
    u = np.concatenate([u, z / length * radius * stats.chi.cdf(length, d) ** (1.0 / flat)])
    r = np.linalg.norm(u, axis=1)
    ball = np.where(r < radius, flat * r ** (flat - 1) / radius**flat, 0.0)
    law = stats.chi.pdf(r, d)
    return u, law / (0.5 * law + 0.5 * ball)


def unseen_by(weights: Array, runs: int, settings: SampleSettings = SAMPLE) -> float:
    """The largest probability of a region that `runs` runs may have missed.

    It would have 1 - 0.05^(1/runs) of the density that they were drawn by, about 3/runs; of that
    share of the points (J,) the law's `weights` over this density are the largest where the
    region has the most. As of independent runs: of points that are spread evenly it is
    somewhat less.
    """
    share = 1.0 - settings.missed ** (1.0 / runs)
    largest = np.sort(weights)[::-1][: int(np.ceil(share * len(weights)))]
    return float(np.sum(largest) / len(weights))


def corrected(
    predicted: PredictedValue,
    draws: AlphaDraws,
    event: Event,
    points: Points,
    checks: int,
    settings: SampleSettings = SAMPLE,
) -> Correction:
    """The difference of the probability by simulator and by surface, from a sample of runs.

    1/R sum_r (1_simulator - 1_surface) m_r/q_r over points drawn with probability q, which is
    larger near an end of the event, in standard deviations of the surface; m is the mass of a
    point. Where all agree the correction is zero, and its error is that mass of which one of R + 1
    might differ. What is in the event far from where the surface sees it is not found.
    """
    known = SurfaceDoubt.of(predicted, draws, event, points, settings.laws)
    doubt = known.mass * np.exp(-_deviations(known.away, known.apart))
    parts = ((settings.doubted, doubt), (1.0 - settings.doubted, known.mass * known.within))
    chance = np.sum(
        [share * part / part.sum() for share, part in parts if part.sum() > 0.0], axis=0
    )
    if not np.sum(chance) > 0.0:
        return Correction(0.0, 0.0, 0)
    chance = chance / chance.sum()
    rng = np.random.default_rng(settings.seed)
    chosen = rng.choice(chance.size, size=checks, p=chance.ravel())
    law, place = np.unravel_index(chosen, chance.shape)
    run = predicted.at_runs(known.alphas[law], known.x[law, place], known.score[place])
    ratio = known.mass[law, place] / chance[law, place]
    apart = (event.holds(run).astype(float) - known.within[law, place]) * ratio
    doubted = float(known.wrong.sum()) / (checks + 1)
    error = np.hypot(float(np.std(apart, ddof=1)) / np.sqrt(checks), doubted)
    return Correction(float(apart.mean()), float(error), checks)
