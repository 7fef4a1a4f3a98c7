"""Draws of alpha by its likelihood, where normal draws leave a curved ridge of the likelihood.

Where the experiments hardly tell two hyperparameters apart, the values that agree with them lie on
a narrow curved ridge. Normal draws with the right intervals then lie beside it. `agreement` tells
so, and `draws_by_likelihood` follows the ridge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from aleator.core.types import Array, Flags, Indices
from aleator.inference.alpha_draws import DRAWING, AlphaDraws, Estimated, alpha_draws, inverse_prior
from aleator.results.values import PlausibleLaws
from aleator.search.interface import Scored


@dataclass(frozen=True)
class LikelihoodDrawSettings:
    """Settings of the draws of alpha by its likelihood; `pytest -k ridge` holds them to exact laws.

    Those without another reason are chosen by judgement.
    """

    tested: int = 32
    """Number of normal draws whose likelihood is evaluated."""
    agree: float = 0.4
    """Agreement below which normal draws are replaced. It was 0.71 to 0.85 for the examples
    crack_growth, fatigue_limit and run_outs (three seeds each), and 0.13 to 0.28 on ridges."""
    each: int = 16
    """Number of draws from each new normal approximation."""
    together: int = 2
    """Number of normal approximations that are added in a round. From the first ones, of which
    there may be many, as many draws are made together as in a round, but of each no fewer than
    `each`/`together`."""
    enough: float = 96.0
    """Effective number of draws at which no more are made."""
    least: float = 24.0
    """Effective number of draws below which normal draws are kept, and predictions say so."""
    most: int = 192
    """Number of evaluations of the likelihood after which no more draws are made."""
    longest: float = 0.1
    """Largest standard deviation of a normal approximation, as a share of the width of the limits.
    On the ridge a b = 2 of `tests/inference/test_likelihood_draws.py` the effective number was 116
    after 193 evaluations, with 0.25 and 1 it was 58 and 57."""
    freedom: float = 5.0
    """Degrees of freedom of Student's t, which is drawn from in place of the normal law."""
    tries: int = 64
    """Number of candidates for each draw, because those beyond the limits are left out."""
    negligible: float = 1e-3
    """Weight of a draw, as a share of the mean weight, below which it is left out."""


LIKELIHOOD_DRAWS = LikelihoodDrawSettings()


def agreement(draws: AlphaDraws, objective: Scored) -> float:
    """How well draws of alpha agree with the likelihood, between zero and one.

    mean over a of min(1, L(alpha_a) prior(alpha_a)/(L(alpha*) q(alpha_a))), where q is the density
    of the draws divided by that at the estimate alpha*. It is the acceptance rate of rejection
    sampling (von Neumann, 1951): one where the log-likelihood is a parabola in the normal variates
    of the draws. Cost: one evaluation of the likelihood for each draw, and one.

    >>> from types import SimpleNamespace
    >>> agreement(AlphaDraws.at(np.zeros(1)), lambda alpha: SimpleNamespace(total=-3.0))
    1.0
    """
    value = np.array([objective(alpha).total for alpha in draws.alpha])
    drop = value - objective(draws.estimate).total - draws.log_density
    return float(np.mean(np.exp(np.minimum(np.where(np.isnan(drop), -np.inf, drop), 0.0))))


def plausible_laws(
    known: Estimated,
    objective: Scored,
    near: Sequence[Array],
    settings: LikelihoodDrawSettings = LIKELIHOOD_DRAWS,
) -> PlausibleLaws:
    """The laws that the experiments leave plausible: normal draws of alpha, or draws by likelihood.

    `near` are alphas (K,) along the ridge, such as the conditional maxima at the ends of profiles.
    Where no hyperparameter has a standard error or an interval there are no normal draws. Cost: 33
    evaluations of the likelihood, and some 200 more where normal draws do not agree.
    """
    normal, agree = alpha_draws(known), None
    if normal.certain and not normal.fixed.size:
        return PlausibleLaws("normal")
    if not normal.certain:
        agree = agreement(normal.fewer(settings.tested), objective)
        if agree >= settings.agree:
            return PlausibleLaws("normal", agree)
    drawn = draws_by_likelihood(known, objective, near, settings)
    if drawn is None or drawn.effective < settings.least:
        return PlausibleLaws("poor", agree, None if drawn is None else drawn.effective)
    return PlausibleLaws(
        "by_likelihood", agree, drawn.effective,
        tuple(map(tuple, drawn.alpha.tolist())), tuple(drawn.weights.tolist()),
    )  # fmt: skip


def plausible_draws(
    known: Estimated, plausible: PlausibleLaws | None, count: int = DRAWING.count, seed: int = 0
) -> AlphaDraws:
    """The draws of alpha of plausible laws: those by the likelihood, if there are some, or normal.

    Of draws by the likelihood there are no more than were made, and `seed` has no meaning.
    """
    if plausible is None or not plausible.alpha:
        return alpha_draws(known, count, seed)
    alpha, weights = np.array(plausible.alpha), np.array(plausible.weights)
    return AlphaDraws.weighted(known.alpha, alpha, weights).fewer(count)


def draws_by_likelihood(
    known: Estimated,
    objective: Scored,
    near: Sequence[Array] = (),
    settings: LikelihoodDrawSettings = LIKELIHOOD_DRAWS,
) -> AlphaDraws | None:
    """Weighted draws of alpha along the likelihood; None where no draw has a likelihood.

    Incremental mixture importance sampling (Raftery and Bao, 2010): draws from a mixture of normal
    approximations, with weights L(alpha) prior(alpha)/q(alpha), where q is the density of the whole
    mixture. The first approximations lie at the estimate and at the alphas `near`. Each round adds
    two, at the draws of largest weight, where the mixture lacks most. Their covariance is the
    inverse of the sum of outer products of the scores there, so that no further evaluations are
    needed. The prior is that of `AlphaDraws.reweighted`.
    """
    mixture = _ProposalMixture.on(known, settings)
    limits = known.limits[mixture.moving].T
    for alpha in (known.alpha, *near):
        mixture.add(np.clip(alpha[mixture.moving], *limits), objective)
    if not mixture.parts:
        return None
    in_a_round = settings.each * settings.together
    count = max(settings.each // settings.together, in_a_round // len(mixture.parts))
    new = mixture.parts
    while True:
        before = mixture.evaluations
        for part in new:
            mixture.draw(part, count, objective)
        weights = mixture.weights
        effective = 1.0 / np.sum(weights**2) if np.any(weights) else 0.0
        # No evaluation is added where all candidates lie beyond the limits.
        if effective >= settings.enough or not before < mixture.evaluations < settings.most:
            break
        count, highest = settings.each, np.argsort(-weights)[: settings.together]
        new = [mixture.part_at(k) for k in highest.tolist() if weights[k] > 0.0]
        if not new:
            break
        mixture.parts.extend(new)
    if not np.any(weights):
        return None
    kept = np.flatnonzero(weights > settings.negligible / weights.size)
    kept = np.random.default_rng(0).permutation(kept)
    alpha = np.tile(known.alpha, (kept.size, 1))
    alpha[:, mixture.moving] = np.array(mixture.places)[kept]
    return AlphaDraws.weighted(known.alpha, alpha, weights[kept] / weights[kept].sum())


@dataclass(eq=False)
class _ProposalComponent:
    """A t law of the mixture at `center` (G,), and how many candidates were `tried` from it.

    The rows of `axes` (G, G) are its orthonormal axes, in units of `scale` (G,), and `precision`
    (G,) are the inverse squares of their lengths.
    """

    center: Array
    scale: Array
    axes: Array
    precision: Array
    tried: int = 0

    def places(self, t: Array) -> Array:
        """The places (A, G) that belong to standard variates t (A, G)."""
        return np.asarray(self.center + self.scale * ((t / np.sqrt(self.precision)) @ self.axes))

    def variates(self, places: Array) -> Array:
        """The standard variates (A, G) of places (A, G)."""
        return np.asarray(
            ((places - self.center) / self.scale @ self.axes.T) * np.sqrt(self.precision)
        )


@dataclass(eq=False)
class _ProposalMixture:
    """A growing mixture of t laws of the hyperparameters `moving` (G,), and the draws from it."""

    estimates: Estimated
    moving: Indices
    inverse: Flags
    settings: LikelihoodDrawSettings
    rng: np.random.Generator
    parts: list[_ProposalComponent]
    places: list[Array]
    values: list[float]
    scores: list[Array | None]
    evaluations: int = 0

    @classmethod
    def on(cls, known: Estimated, settings: LikelihoodDrawSettings) -> _ProposalMixture:
        """The mixture without parts; hyperparameters that are free move."""
        moving = np.flatnonzero(known.free)
        inverse = inverse_prior(known)[moving]
        return cls(known, moving, inverse, settings, np.random.default_rng(0), [], [], [], [])

    def add(self, center: Array, objective: Scored) -> None:
        """Add a part at a place (G,), if the likelihood is finite there."""
        _, scores = self._evaluated(center, objective)
        if scores is not None:
            self.parts.append(self._part(center, scores))

    def draw(self, part: _ProposalComponent, count: int, objective: Scored) -> None:
        """Draw `count` places from a part, within the limits, and evaluate the likelihood there."""
        low, high = self.estimates.limits[self.moving].T
        size, freedom = count * self.settings.tries, self.settings.freedom
        z = self.rng.standard_normal((size, low.size))
        t = z / np.sqrt(self.rng.chisquare(freedom, size) / freedom)[:, None]
        places = part.places(t)
        inside = np.flatnonzero(np.all((places >= low) & (places <= high), axis=1))[:count]
        # The density within the limits is larger by tried/found than that of the whole law.
        part.tried = int(inside[-1]) + 1 if inside.size == count else size
        for place in places[inside]:
            value, scores = self._evaluated(place, objective)
            self.places.append(place)
            self.values.append(value)
            self.scores.append(scores)

    def part_at(self, k: int) -> _ProposalComponent:
        """The part at draw number k, with the scores that are known there."""
        scores = self.scores[k]
        assert scores is not None
        return self._part(self.places[k], scores)

    @property
    def weights(self) -> Array:
        """The weights (A,) of the draws, which sum to one; zero for impossible ones."""
        places, value = np.array(self.places), np.array(self.values)
        if not places.size:
            return np.zeros(0)
        parts = [part for part in self.parts if part.tried]
        density = special.logsumexp([self._log_density(part, places) for part in parts], axis=0)
        prior = -np.log(np.maximum(places[:, self.inverse], np.finfo(float).tiny)).sum(axis=1)
        log_weight = value + prior - density
        if not np.any(np.isfinite(log_weight)):
            return np.zeros(len(places))
        weights = np.exp(log_weight - log_weight.max())
        return np.asarray(weights / weights.sum())

    def _log_density(self, part: _ProposalComponent, places: Array) -> Array:
        """The log-density (A,) of a part times its number of candidates, up to a constant."""
        t, freedom = part.variates(places), self.settings.freedom
        tail = 0.5 * (freedom + t.shape[1]) * np.log1p(np.sum(t**2, axis=1) / freedom)
        size = 0.5 * np.log(part.precision).sum() - np.log(part.scale).sum()
        return np.asarray(np.log(part.tried) + size - tail)

    def _part(self, center: Array, scores: Array) -> _ProposalComponent:
        longest = self.settings.longest * np.ptp(self.estimates.limits[self.moving], axis=1)
        unit = scores * longest
        information, vectors = np.linalg.eigh(unit.T @ unit)
        precision = np.maximum(information, 0.0) + 1.0
        return _ProposalComponent(center, DRAWING.wide * longest, vectors.T, precision)

    def _evaluated(self, place: Array, objective: Scored) -> tuple[float, Array | None]:
        """The log-likelihood at a place (G,) with its scores (U, G); -inf, None where unknown."""
        alpha = self.estimates.alpha.copy()
        alpha[self.moving] = place
        self.evaluations += 1
        found = objective(alpha)
        scores = found.independent[:, self.moving]
        if np.isfinite(found.total) and np.all(np.isfinite(scores)):
            return found.total, scores
        return -np.inf, None
