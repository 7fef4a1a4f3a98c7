"""Interval ends for few experiments, by Skovgaard's modified signed root of the profile.

The signed root of hyperparameter k is r(v) = sign(estimate - v) sqrt(2 drop(v)), where drop(v) is
the drop of the profile log-likelihood at the value v. An interval from r = -1.96 to r = 1.96 holds
the truth in 95 % of all cases only for many experiments. The modified signed root of
Barndorff-Nielsen (1986) is much nearer to a standard normal variate:

    r* = r + log(u/r)/r,   u = [S^-1 q]_k |S|/|I| sqrt(|J|/|J_o|).

Skovgaard (1996) has q and S as covariances under the estimated model: q is that of the score at the
estimate with the drop of the log-likelihood to the conditional maximum at v, S that of the score at
the estimate with the score at the conditional maximum. I is the covariance of the score at the
estimate. J is the observed information there, and J_o that of the other hyperparameters at the
conditional maximum. The covariances are computed from drawn data sets, without refits (Pierce and
Bellio, 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Flags, Indices
from aleator.inference.information import Inference, observed_information, side_of
from aleator.inference.likelihood_at import LikelihoodAt
from aleator.inference.profile import ENDS, TARGET, Profile
from aleator.laws import Hyperparameter
from aleator.observations.responses import Observations
from aleator.results.values import Diagnostic
from aleator.search.interface import objective_of


@dataclass(frozen=True)
class SmallSampleSettings:
    """Settings of interval ends for few experiments."""

    experiments: int = 300
    """The least number of experiments in all drawn data sets. Over five seeds the root of an end
    then had a standard deviation of at most 0.008, in five studies of 12 experiments of
    `python -m benchmarks small-samples`, and of 0.05 in one with a correlation on its limit; ends
    are found to 0.01."""
    draws: int = 10
    """The least number of drawn data sets, by judgement."""
    share: float = 0.5
    """The least share of the drawn data sets that have a likelihood, by judgement."""
    largest: float = 1.0
    """The largest |r* - r| that is believed, by judgement: an expansion for small corrections."""


SMALL_SAMPLE = SmallSampleSettings()


def modified_targets(
    likelihood: LikelihoodAt,
    seen: Observations,
    inference: Inference,
    profile: Profile,
    seed: int,
    progress: Progress | None = None,
    settings: SmallSampleSettings = SMALL_SAMPLE,
) -> Array:
    """The |r| (K, 2) of interval ends with |r*| = 1.96; NaN where r* is not known.

    `likelihood` is at the maximum, with the observations `seen`. The `profile` has the ends with
    |r| = 1.96, where r* - r is computed; it changes little from there to the new end. The target
    stays 1.96 for an end on a limit, or before a jump, and for an estimate on its limit: r* is for
    maxima inside the limits. Cost: for each drawn data set 1 + E evaluations of the likelihood,
    with E ends, and for the observed information 2 (F - 1) for each end.
    """
    progress, own = progress or Silent(), inference.free
    found = np.full(profile.drops.shape, TARGET)
    if not inference.positive:
        return found
    with np.errstate(invalid="ignore"):
        inner = np.abs(np.sqrt(2.0 * profile.drops) - TARGET) < 2.0 * ENDS.close
    ends = [(k, side) for k, side in np.argwhere(inner).tolist() if k in own]
    points = [profile.points[k, side] for k, side in ends]
    draws = _drawn(likelihood, seen, points, own, seed, progress, settings)
    objective = objective_of(likelihood.objective())
    for (k, side), point, draw in zip(ends, points, draws, strict=True):
        # What lies on its limit at the end counts as known.
        sides = zip(point[own], (likelihood.hyperparameters[j] for j in own), strict=True)
        off = np.array([side_of(value, h) is None for value, h in sides], dtype=np.bool_)
        kept = own[off | (own == k)]
        inside = np.isin(inference.identified, kept)
        at_top, others = inference.information[np.ix_(inside, inside)], kept[kept != k]
        scores = objective(point).scores
        assert scores is not None
        at_end = observed_information(
            objective, point, likelihood.hyperparameters, others, scores[:, others]
        )
        sign = 1.0 if side == 0 else -1.0
        root = sign * float(np.sqrt(2.0 * profile.drops[k, side]))
        draw = draw.of(np.isin(own, kept))
        ratio = draw.u(int(np.flatnonzero(kept == k)[0]), at_top, at_end, settings.share) / root
        moved = np.log(ratio) / root if ratio > 0.0 else np.nan
        found[k, side] = TARGET - sign * moved if abs(moved) < settings.largest else np.nan
    return found


def unadjusted_warnings(
    hyperparameters: Sequence[Hyperparameter], profile: Profile
) -> list[Diagnostic]:
    """A warning about interval ends that should be adjusted, but for which r* is not known."""
    if profile.targets is None:
        return []
    rows = np.flatnonzero(np.any(np.isnan(profile.targets), axis=1)).tolist()
    names = tuple(hyperparameters[k].name for k in rows)
    if not names:
        return []
    return [
        Diagnostic(
            "interval",
            f"the interval of {', '.join(names)} has an end that is not adjusted for few "
            "experiments: the modified signed root could not be computed there, or is far from the "
            "signed root of the profile",
            "hold the interval against a parametric bootstrap",
            names,
        )
    ]


@dataclass(frozen=True, eq=False)
class _ScoreDraws:
    """Scores (R, U, F) of U experiments of R data sets drawn at the estimate: there, and at an end.

    `drops` (R, U) are the drops of their log-likelihoods from the estimate to the end.
    """

    here: Array
    there: Array
    drops: Array

    def of(self, kept: Flags) -> _ScoreDraws:
        """The same of some hyperparameters (F,)."""
        return _ScoreDraws(self.here[..., kept], self.there[..., kept], self.drops)

    def u(self, k: int, at_top: Array, at_end: Array, share: float) -> float:
        """Skovgaard's u of hyperparameter k of F; NaN if too few data sets have a likelihood.

        `at_top` (F, F) is the observed information, `at_end` (F-1, F-1) that of the others at the
        end.
        """
        known = self._known
        if np.count_nonzero(known) < max(2.0, share * known.size):
            return float("nan")
        here, there, drops = (
            part[known] - part[known].mean(axis=0) for part in (self.here, self.there, self.drops)
        )
        expected, s = (np.einsum("rui,ruj->ij", here, part) for part in (here, there))
        q = np.einsum("rui,ru->i", here, drops)
        try:
            direction = np.linalg.solve(s, q)[k]
        except np.linalg.LinAlgError:
            return float("nan")
        (_, of_s), (_, of_expected) = np.linalg.slogdet(s), np.linalg.slogdet(expected)
        (_, of_top), (sign, of_end) = np.linalg.slogdet(at_top), np.linalg.slogdet(at_end)
        size = np.exp(of_s - of_expected + 0.5 * (of_top - of_end)) if sign > 0.0 else np.nan
        return float(direction * size)

    @property
    def _known(self) -> Flags:
        """Which data sets (R,) have a likelihood and scores."""
        parts = (self.here, self.there, self.drops[..., None])
        found: Flags = np.all([np.isfinite(part).all(axis=(1, 2)) for part in parts], axis=0)
        return found


def _drawn(
    likelihood: LikelihoodAt,
    seen: Observations,
    points: list[Array],
    own: Indices,
    seed: int,
    progress: Progress,
    settings: SmallSampleSettings,
) -> list[_ScoreDraws]:
    """Data sets drawn at the estimate, evaluated there and at each of the points (K,)."""
    # Covariances need no more than the coarsest nodes that are accurate enough.
    likelihood, rng = likelihood.rough(), np.random.default_rng(seed)
    each = len(likelihood.scored().each)
    count = max(settings.draws, -(-settings.experiments // each)) if points else 0
    cost = f"{1 + len(points)} evaluations of the log-likelihood each"
    rows = list[list[tuple[Array, Array, Array]]]()
    for number in range(count):
        progress.update(f"{number} of {count} drawn data sets, {cost}", number, count)
        objective = likelihood.seeing(likelihood.drawn(seen, rng)).objective()
        top, there = objective(likelihood.alpha), [objective(point) for point in points]
        here = top.independent[:, own]
        rows.append([(here, one.independent[:, own], top.each - one.each) for one in there])
    return [
        _ScoreDraws(*map(np.array, zip(*column, strict=True))) for column in zip(*rows, strict=True)
    ]
