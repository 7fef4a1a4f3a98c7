"""Whether statistics contradict the model: their probabilities by replicates, each and together.

Replicates of the experiments are drawn from the fit and fitted by one step. Few of them tell small
probabilities, because each statistic has a law with the mean, scatter and skewness of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import special

from aleator.core.types import Array, Flags
from aleator.inference.consistency.battery import SHARES, Battery, Residuals, Subject, residuals_of
from aleator.inference.fit import Fit, stepped
from aleator.observations.experiments import Experiments
from aleator.results.values import REPORTED, Outlier, Statistic


@dataclass(frozen=True)
class JudgementSettings:
    """How few replicates tell small probabilities: held against the tests of statistics."""

    flattest: float = 1e-12
    """A statistic whose replicates scatter less than this, over its size, tells nothing."""
    straight: float = 1e-3
    """A skewness below this is none."""
    shrunk: float = 20.0
    """The skewness of B replicates is taken B/(B + this) times."""
    many: int = 200
    """Experiments from which one step to the maximum of a replicate does."""
    farthest: float = 1.01
    """A replicate is at most sqrt(B - this) standard deviations away: sqrt(B - 1) is the most that
    one of B values can be.
    """
    certain: float = 1e-15
    """Probabilities stay so far from one."""
    named: int = 5
    """Outliers that are named."""


JUDGEMENT = JudgementSettings()


def probabilities(
    observed: Array,
    replicates: Array,
    skewed: Flags,
    one_sided: Flags,
    least: Array,
    settings: JudgementSettings = JUDGEMENT,
) -> tuple[Array, Array, Array]:
    """p (T,) of observed statistics, p (B, T) of each replicate among the others, and z (T,).

    By the normal law, and where `skewed` by Pearson's third with the skewness of the replicates
    (Wilson and Hilferty, 1931); Student's t with B - 1 degrees of freedom is for their mean and
    scatter, which are estimated. So a few dozen replicates tell small probabilities. They are taken
    to scatter by `least` (T,) more; the probability is one where they do not scatter at all.
    """
    count = len(replicates)
    mean = replicates.mean(axis=0)
    sd = np.hypot(replicates.std(axis=0, ddof=1), least)
    flat = ~(sd > settings.flattest * (1.0 + np.abs(mean)))
    scale = np.where(flat, 1.0, sd)
    third = np.mean(((replicates - mean) / scale) ** 3, axis=0)
    skewness = np.where(skewed, third, 0.0) * count / (count + settings.shrunk)
    z = _normal((observed - mean) / scale, skewness, settings) / np.sqrt(1.0 + 1.0 / count)
    own = _normal((replicates - mean) / scale, skewness, settings)
    most = np.sqrt(count - settings.farthest)
    r = np.clip(own / np.sqrt(1.0 - 1.0 / count), -most, most)
    left_out = r * np.sqrt((count - 2.0) / (count - 1.0 - r**2))
    p = np.where(flat, 1.0, _tail(z, count - 1.0, one_sided))
    return p, np.where(flat, 1.0, _tail(left_out, count - 2.0, one_sided)), np.where(flat, 0.0, z)


def effective(smallest: Array) -> float:
    """How many independent tests have such smallest p (B,): P(p_min < p) = 1 - (1 - p)^m.

    The maximum of the likelihood from the lower half of the replicates, the others counted as
    larger: the tail is what matters.
    """
    limit = float(np.median(smallest))
    low = smallest[smallest < limit]
    told = -np.log1p(-low).sum() - (smallest.size - low.size) * np.log1p(-limit)
    return low.size / told if told > 0.0 else 1.0


def corrected(p: Array, tests: float) -> Array:
    """The probability that the smallest of so many is as small."""
    return np.asarray(-np.expm1(tests * np.log1p(-np.minimum(p, 1.0 - JUDGEMENT.certain))))


def _normal(z: Array, skewness: Array, settings: JudgementSettings) -> Array:
    """Standardized values of a skewed law as normal ones; a skewness near zero changes nothing.

    Only on the side of the long tail: where the short one ends hangs on a skewness that few
    replicates hardly know.
    """
    straight = (np.abs(skewness) < settings.straight) | (z * skewness < 0.0)
    g = np.where(straight, 1.0, skewness)
    inside = np.cbrt(np.maximum(0.5 * g * z + 1.0, 0.0))
    return np.where(straight, z, 6.0 / g * (inside - 1.0) + g / 6.0)


def _tail(z: Array, freedom: float, one_sided: Flags) -> Array:
    upper = special.stdtr(freedom, -z)
    return np.asarray(np.where(one_sided, upper, 2.0 * special.stdtr(freedom, -np.abs(z))))


@dataclass(frozen=True, eq=False)
class Judgement:
    """Tests with their probabilities, that of all `together`, and how many replicates told them."""

    tests: tuple[Statistic, ...]
    together: float
    replicates: int


def judged(
    subjects: tuple[Subject, ...],
    observed: Array,
    replicates: Array,
    settings: JudgementSettings = JUDGEMENT,
) -> Judgement:
    """What B replicates (B, T) of the statistics say of the observed ones (T,).

    First within each group of tests, the smallest p over its weight, then of the groups: each has
    its share of the false alarms, however many columns and hyperparameters there are.
    """
    skewed = np.array([s.skewed for s in subjects])
    one_sided = np.array([s.one_sided for s in subjects])
    least, weight = np.array([[s.least, s.weight] for s in subjects]).T
    p, own, z = probabilities(observed, replicates, skewed, one_sided, least, settings=settings)
    groups = np.array([s.group for s in subjects])
    found, smallest = np.ones(p.size), []
    for name in dict.fromkeys(groups.tolist()):
        inside = groups == name
        strongest = np.min(own[:, inside] / weight[inside], axis=1)
        tests = effective(strongest) / SHARES[name]
        found[inside] = corrected(p[inside] / weight[inside], tests)
        smallest.append(corrected(strongest, tests))
    found = corrected(found, effective(np.min(smallest, axis=0)))
    rows = zip(subjects, z.tolist(), p.tolist(), found.tolist(), strict=True)
    tests_found = tuple(Statistic(s.kind, s.of, s.column, s.where, *values) for s, *values in rows)
    return Judgement(tests_found, float(found.min()), len(replicates))


def replicated(
    fit: Fit,
    battery: Battery,
    points: int,
    rng: np.random.Generator,
    settings: JudgementSettings = JUDGEMENT,
) -> Iterator[Array]:
    """Statistics (T,) of other data under the fitted model, alpha fitted to them; without end.

    Of few experiments alpha takes a second step: after one, replicates miss their maximum by so
    much that the experiments, which do not, look odd (10 instead of 5 % false alarms at N = 15).
    """
    while True:
        other = stepped(fit.drawn(rng))
        fitted = stepped(other) if fit.count < settings.many else other
        yield battery.values(residuals_of(fitted, points))


def outliers_of(
    residuals: Residuals, table: Experiments, settings: JudgementSettings = JUDGEMENT
) -> tuple[Outlier, ...]:
    """The observations that the farthest of M lies beyond once in twenty times, farthest first."""
    seen = table.observations
    p = np.where(residuals.known, 2.0 * special.ndtr(-np.abs(residuals.normal)), 1.0)
    among = corrected(p, float(p.size))
    return tuple(
        Outlier(
            table.ids[seen.experiment[i]],
            int(seen.row[i]) + 1,
            seen.names[seen.response[i]],
            float(p[i]),
            float(among[i]),
        )
        for i in np.argsort(p, kind="stable")[: settings.named]
        if among[i] < REPORTED.level
    )
