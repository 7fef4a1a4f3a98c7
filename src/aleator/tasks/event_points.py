"""Sample points for the probability of an event, rare or not, and simulator runs that check it.

An event is an outcome in an interval. `event_sample` computes an importance density of the event
on a response surface, which gets more runs there. `explored` compares new runs with the surface
everywhere. `settling` chooses runs where the surface is uncertain about the event. `corrected`
computes by how much runs near the interval's ends change the probability.
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
    """Settings of the points that sample an event, and of the runs that check its probability.

    The values are chosen by judgement; `benchmarks limit_states` measures the result.
    """

    laws: int = 32
    """The number of plausible laws, with the estimated one, that share an importance density."""
    far: float = 2.5
    """The factor by which the first points of a surface scatter more than the law."""
    placed: int = 24
    """The number of first points of a surface for each law."""
    sure: float = 2.0
    """The number of kriging standard deviations within which an outcome is possible."""
    rounds: int = 6
    """The largest number of rounds in which a surface is refined at the points of the event."""
    still: float = 0.02
    """The relative change of the probability by a refined surface that counts as zero."""
    searches: int = 40
    """The number of random steps in the search for the most probable point of an event."""
    doubted: float = 0.7
    """The share of the checking runs that lie near the ends of the event's interval; the others are
    anywhere in the event."""
    checks: int = 20
    """The number of checking runs, by which the probability from a surface is corrected."""
    usual: int = 16
    """The divisor of `pool` that gives the number of points for the scatter of the outcome."""
    seed: int = 11
    """The seed of the new runs and of the checking runs."""
    pool: int = 4096
    """The number of points from which two probabilities are computed: that of a region without
    runs, and that of a surface's mistakes.
    """
    missed: float = 0.05
    """The chance of missing a region that the report calls excluded."""
    replicates: int = 16
    """The number of independent samples, whose scatter gives the standard error."""
    each: int = 256
    """The number of points of each sample."""
    followed: int = 8
    """The number of plausible laws from which the runs of a surface are placed."""


SAMPLE = SampleSettings()


@dataclass(frozen=True, eq=False)
class Sample:
    """Independent samples of points, drawn from the law or from an importance `density`.

    `density` is None for points of the law. `reached` is true if a point of the event was found.
    """

    replicates: tuple[Points, ...]
    density: ImportanceDensity | None = None
    reached: bool = True

    @property
    def joined(self) -> Points:
        """The points of all samples together."""
        return Points.joined(self.replicates)


def of_law(predicted: PredictedValue) -> Sample:
    """Independent samples of points drawn from the law itself, without importance density."""
    s = predicted.context.inputs.scattering
    return Sample(tuple(Points.standard(SAMPLE.each, s, seed) for seed in range(SAMPLE.replicates)))


def event_sample(
    predicted: PredictedValue,
    draws: AlphaDraws,
    event: Event,
    choice: CrossEntropy | None = None,
    settings: SampleSettings = SAMPLE,
) -> Sample:
    """Points of an importance density of the event, by the simulator or a refined surface.

    A response surface is refined where the points lie. The density is then computed again, until
    the probability of the event stays. All plausible laws share the points, because the standard
    normal variates of an event change little with alpha.
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
    """Points that cover the possible event: outcomes in it within two kriging deviations."""
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
    """The quarter of the points with the most weight in the event, or else nearest to it."""
    mass = np.sum(weights, axis=0, where=away == 0.0)
    order = np.lexsort((np.min(away, axis=0), -mass))[: len(mass) // 4]
    return Points(points.xi[order], points.score[order], points.weights[order])


def drawn(predicted: PredictedValue, density: ImportanceDensity, count: int, seed: int) -> Points:
    """Points drawn from an importance density, with weights; `count` is a power of two."""
    u = density.drawn(uniform_points(count, variates(predicted) + 1, seed))
    return points_at(predicted, u, density.weights(u))


def points_at(predicted: PredictedValue, u: Array, weights: Array | None = None) -> Points:
    """Points from standard normal variates u (J, d): of the parameters, then of the error."""
    s = predicted.context.inputs.scattering
    score = np.zeros(len(u)) if predicted.context.errors is None else u[:, s]
    return Points(u[:, :s], score, np.ones(len(u)) if weights is None else weights)


def variates(predicted: PredictedValue) -> int:
    """The number of standard normal variates of the parameters and the error, at least one."""
    return max(predicted.context.inputs.scattering + (predicted.context.errors is not None), 1)


def chosen_laws(draws: AlphaDraws, count: int = SAMPLE.laws) -> tuple[Array, Array]:
    """Plausible laws (L, K) with weights (L,): the estimate, and evenly chosen draws of alpha."""
    if draws.certain:
        return draws.alpha, np.ones(1)
    which = some_of(draws, count - 1)
    alphas = np.concatenate([draws.estimate[None], draws.alpha[which]])
    weights = np.concatenate([[draws.weights[which].mean()], draws.weights[which]])
    return alphas, weights / weights.sum()


def missed(
    predicted: PredictedValue, laws: tuple[Array, Array], event: Event, points: Points
) -> tuple[Array, Array]:
    """The distances (L, J) of outcomes from the event, for points under each law, and weights."""
    y, found = predicted.outcomes(laws[0], points)
    return _by_law(event.missed(y), found, laws[1], points)


def _by_law(
    away: Array, found: DrawnParameters, share: Array, points: Points
) -> tuple[Array, Array]:
    """Distances and weights (L, J) with a row for each law and class of a mixture."""
    shape = (-1, len(points.score))
    weights = found.weights * share[:, None] * len(points.score)
    return away.reshape(shape), weights.reshape(shape)


def by_some(predicted: PredictedValue, draws: AlphaDraws, event: Event, points: Points) -> float:
    """The probability of an event from these points, averaged over some plausible laws."""
    away, weights = missed(predicted, chosen_laws(draws), event, points)
    return float(np.sum(weights, where=away == 0.0)) / len(points.score)


def often(predicted: PredictedValue, draws: AlphaDraws, event: Event) -> bool:
    """Whether the event is more probable than its complement."""
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
    """The distance of the event's most probable point from the centre of the law.

    It is the length of the shortest vector of standard normal variates that leads to the event. The
    search begins at the shortest of the points and takes random steps, which are halved when none
    of them is shorter. NaN if no point is in the event.
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
    """New runs at parameters x (R, n), and which of them contradict the surface (`contrary`).

    Half of them lie in a ball of standard normal variates with this `radius`.
    """

    x: Array
    contrary: Flags
    radius: float


@dataclass(frozen=True, eq=False)
class SurfaceDoubt:
    """A surface's uncertainty about an event, at points x (L, J, n) of probability `mass` (L, J).

    L is the number of plausible laws `alphas` (L, K), and `score` (J,) the standard normal variate
    of the measurement error. `within` (L, J) marks points in the event by the surface. `away` are
    the distances of the outcomes from the event's ends, `apart` their kriging standard deviations.
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
        """The surface's uncertainty at some of the points, under `count` plausible laws."""
        laws, share = chosen_laws(draws, count)
        y, apart, found = predicted.possible(laws, points.thinned(SAMPLE.pool // len(laws)))
        mass = share[:, None] * found.weights
        away = np.nan_to_num(event.distance(y), nan=np.inf)
        return cls(found.x, found.score, laws, mass, event.holds(y), away, apart)

    @property
    def wrong(self) -> Array:
        """The expected probability (L, J) that the surface puts on the wrong side of an end.

        It is m Phi(-d/s) with mass m, distance d and standard deviation s (Echard, Gayton and
        Lemaire, 2011).
        """
        return self.mass * _beyond(self.away, self.apart)

    @property
    def probability(self) -> float:
        """The probability of the event if the surface were exact."""
        return float(np.sum(self.mass, where=self.within))


@dataclass(frozen=True)
class Correction:
    """The change `value` of a probability by checking `runs`, with its standard error `error`."""

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
    """New runs of the simulator all over the law and its tails, compared with the surface.

    They lie at Sobol' points of the standard normal variates, each under a drawn plausible law.
    """
    assert predicted.surface is not None
    d = variates(predicted)
    farthest = stats.chi.isf(max(choice.beyond * probability, np.finfo(float).tiny), d)
    radius = float(min(farthest, CONTEXT.reach))
    u = _all_over(choice.runs, d, radius, settings.seed + seed, settings)
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
    return Explored(x, apart, radius)


def settling(predicted: PredictedValue, doubt: SurfaceDoubt, count: int) -> Array:
    """Parameters (count, n) of the runs that most reduce the surface's expected mistakes.

    A run lowers the kriging variance of every outcome that is correlated with it. The points are
    chosen one after the other, each as the best one given those before (stepwise uncertainty
    reduction; Bect et al., 2012). Candidates are the points with the largest expected mistake.
    """
    assert predicted.surface is not None
    wrong = doubt.wrong.ravel()
    top = np.argsort(-wrong, kind="stable")[: CONTEXT.places]
    x, mass, away, apart = (
        part.reshape(wrong.size, -1)[top] for part in (doubt.x, doubt.mass, doubt.away, doubt.apart)
    )
    surface = predicted.surface.kriged
    joint, noise = surface.joint(x), surface.missed.noise
    # Measurement errors may change the scale of deviations from the event's limit.
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
    """The probability Phi(-d/s) of an error beyond d, from distances and standard deviations."""
    return np.asarray(special.ndtr(-_deviations(away, apart)))


def _deviations(away: Array, apart: Array) -> Array:
    with np.errstate(over="ignore"):
        return np.asarray(away / np.maximum(apart, np.finfo(float).tiny))


def _all_over(count: int, d: int, radius: float, seed: int, settings: SampleSettings) -> Array:
    """Points (J, d), half drawn from the law and half from a ball.

    In the ball the points are uniform for one or two variates; for more they are denser near the
    centre.
    """
    flat = min(d, 2)
    u, z = normal_points(count // 2, d, seed), normal_points(count // 2, d, seed + settings.pool)
    length = np.linalg.norm(z, axis=1, keepdims=True)
    return np.concatenate([u, z / length * radius * stats.chi.cdf(length, d) ** (1.0 / flat)])


def unseen_after(
    radii: Sequence[float], runs: int, d: int, settings: SampleSettings = SAMPLE
) -> float:
    """The largest probability of a region that all rounds of so many `runs` miss (`unseen_by`).

    The `radii` are those of the balls of each round. If each run of round k meets a region with the
    chance q_k, all runs of R rounds miss it with the chance prod_k (1 - q_k)^runs, which is at most
    (1 - mean q)^(runs R). They thus exclude no less than as many runs of the mean density.
    """
    u = np.concatenate([
        _all_over(settings.pool, d, radius, settings.seed + k, settings)
        for k, radius in enumerate(radii)
    ])  # fmt: skip
    r, flat = np.linalg.norm(u, axis=1), min(d, 2)
    balls = [np.where(r < end, flat * r ** (flat - 1) / end**flat, 0.0) for end in radii]
    law = stats.chi.pdf(r, d)
    return unseen_by(law / (0.5 * law + 0.5 * np.mean(balls, axis=0)), runs * len(radii))


def unseen_by(weights: Array, runs: int, settings: SampleSettings = SAMPLE) -> float:
    """The largest probability of a region that all of `runs` runs miss with a chance of 5 %.

    Under the density from which the runs are drawn, such a region has the probability
    1 - 0.05^(1/runs), about 3/runs. Its probability under the law is largest if it has the points
    with the largest `weights` (J,), the ratios of the two densities. The bound holds for
    independent runs; for evenly spread points the true value is somewhat smaller.
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
    """The difference of an event's probability by simulator and by surface, from R `checks` runs.

    It is 1/R sum_r (1_simulator - 1_surface) m_r/q_r, where 1 indicates the event and m is the mass
    of a point. Points are drawn with probabilities q, which are larger near an end of the event, in
    standard deviations of the surface. If all runs agree with the surface the correction is zero.
    Its error then assumes that one of R + 1 runs differs. A part of the event far from where the
    surface has it is not found.
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
