"""The expected information of an experiment: the mean square of its scores at virtual outcomes.

An outcome beyond the tested conditions may have a kink that no measured one has, where the nodes of
the identification do not serve. Scores of candidates are therefore checked with panels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.integrate import cumulative_simpson, simpson
from scipy.interpolate import CubicSpline

from aleator.core.progress import Progress
from aleator.core.types import Array, Flags, Indices
from aleator.inference.fit import Fit
from aleator.inference.likelihood_at import IndividualsAt
from aleator.observations.responses import ends_of
from aleator.observations.responses import limits_of_test as limits_of_tests


@dataclass(frozen=True)
class ScoreSettings:
    """Settings of scores at virtual outcomes, all chosen by judgement where no reason is given."""

    nodes: int = 97
    """Number of equally spaced outcomes of one experiment over which its information is summed."""
    draws: int = 400
    """Number of virtual data sets, used where an experiment has several observations."""
    largest: int = 1
    """Number of virtual outcomes of each experiment at which scores are checked for each
    hyperparameter: those that contribute most to the information on it.
    """
    spread: int = 8
    """Number of further ones that are checked, evenly spread over all. A fault of one score in five
    is found with a probability of 0.83.
    """
    differs: float = 0.1
    """Difference from a score by panels, relative to it or to the root mean square of the scores if
    that is larger, from which a score counts as wrong. If all were off by so much, a standard error
    would change by a tenth.
    """
    least: float = 1e-3
    """Share of the present information that an experiment's information is taken for at least in
    this comparison, so that rounding errors of a score near zero do not count.
    """
    newton: int = 4
    """Number of Newton steps from an interpolated quantile to the exact one."""


SCORES = ScoreSettings()
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
"""The golden section: the fractional parts of its multiples are evenly spread."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores (R, C, K) at R virtual outcomes of C experiments; weights (R, C) that sum to one.

    With one observation per experiment, `outcomes` (S, C) are the first S of the R outcomes:
    equally spaced nodes of an integral over the outcome's density. The other outcomes stand for all
    values beyond a limit of the test. With several observations each virtual outcome is a random
    draw, and `outcomes` is None. An experiment that cannot be simulated has NaN.
    """

    scores: Array
    weights: Array
    outcomes: Array | None

    @cached_property
    def information(self) -> Array:
        """The expected information I = E[s s'] (C, K, K) of each experiment (Fisher, 1925)."""
        return np.asarray(np.einsum("rc,rck,rcl->ckl", self.weights, self.scores, self.scores))

    def of(self, which: Indices) -> Scores:
        """The scores with respect to the hyperparameters with the indices `which`."""
        return Scores(self.scores[:, :, which], self.weights, self.outcomes)

    def error(self, directions: Array) -> Array:
        """The Monte Carlo error (C,) of d' I d for d (C, K); zero for a sum over nodes."""
        if self.outcomes is not None:
            return np.zeros(self.weights.shape[1])
        squares = np.einsum("rck,ck->rc", self.scores, directions) ** 2
        return np.asarray(squares.std(axis=0, ddof=1) / np.sqrt(len(squares)))


def expected_scores(
    fit: Fit,
    rng: np.random.Generator,
    progress: Progress,
    settings: ScoreSettings = SCORES,
    *,
    measured: bool = False,
) -> Scores:
    """Scores of experiments at virtual outcomes under the experiments' own law.

    With one observation for each experiment the information is an integral over the outcome's
    density f: I = int s s' f dy. It is exact but for the distance of the nodes; values beyond a
    limit of the test count together. With several observations, or where experiments share
    parameters and count together, virtual data sets are drawn and censored as the measured ones
    are. With one or two scattering parameters some of the scores are checked with panels, but not
    those of `measured` experiments, whose nodes were chosen under these very conditions. Cost: some
    97 evaluations of the likelihood of the experiments, or 400 for drawn data sets, and some ten by
    panels, or more where scores are wrong.
    """
    seen = fit.table.observations
    limits, alone = limits_of_tests(seen), np.array_equal(seen.experiment, np.arange(fit.count))
    if limits is None or not alone or fit.inputs.grouping is not None:
        virtual = _drawn(fit, rng, settings)
    else:
        virtual = _spaced(fit, *ends_of(seen, limits), settings)
    found = virtual.scored(fit, progress)
    if not measured:
        found = _checked(fit, virtual, found, progress, settings)
    weights = virtual.weights(found.each)
    known = np.where(weights[..., None] > 0.0, found.scores, 0.0 * weights[..., None])
    return Scores(known, weights, virtual.outcomes)


@dataclass(frozen=True, eq=False)
class _Scored:
    """Log-densities (R, C) and scores (R, C, K) at R virtual outcomes of C experiments."""

    each: Array
    scores: Array


@dataclass(frozen=True, eq=False)
class _Virtual:
    """R virtual outcomes of the experiments, each between `lower` and `upper` (R, M).

    Those of an integral over the outcome's density are steps: `step` (R, C) are their widths, and
    `outcomes` (S, C) the first S of them. They are in order, so that nodes for one are adapted from
    those for the last one. Both are None for random draws.
    """

    lower: Array
    upper: Array
    step: Array | None = None
    outcomes: Array | None = None

    def scored(self, fit: Fit, progress: Progress, what: str = "virtual outcome") -> _Scored:
        """The log-densities and scores of the fit's experiments at these outcomes."""
        count = int(fit.cluster.max()) + 1
        each = np.empty((len(self.lower), count))
        scores = np.empty((*each.shape, fit.alpha.size))
        for r, (lower, upper) in enumerate(zip(self.lower, self.upper, strict=True)):
            progress.update(f"{what} {r + 1} of {len(each)}", r, len(each))
            own = replace(fit.table.observations, lower=lower, upper=upper)
            there = fit.seeing(fit.table.with_observations(own))
            found = there.scored()
            each[r], scores[r] = found.each, found.independent
            fit = fit if self.step is None else there
        return _Scored(each, scores)

    def weights(self, each: Array) -> Array:
        """The weights (R, C) of the outcomes by their log-densities (R, C); they sum to one."""
        if self.step is None:
            return np.full(each.shape, 1.0 / len(each))
        found = self.step * np.exp(each)
        with np.errstate(invalid="ignore"):
            return np.asarray(found / found.sum(axis=0))

    def of_each(self, which: Indices, experiment: Indices) -> _Virtual:
        """Outcomes (R', M) with the numbers `which` (R', C) of each experiment.

        `experiment` (M,) is that of each observation.
        """
        row, column = which[:, experiment], np.arange(experiment.size)
        return _Virtual(self.lower[row, column], self.upper[row, column])


def _checked(
    fit: Fit, virtual: _Virtual, found: _Scored, progress: Progress, settings: ScoreSettings
) -> _Scored:
    """The scores, with those by panels where the scores by the nodes differ from them.

    Nodes about one mode serve a smooth outcome, and are chosen with the measured values. A virtual
    outcome beyond a kink may have the largest part of its density elsewhere. Its score is then
    wrong, often far too large, so that it dominates the information. Of each experiment some
    virtual outcomes are checked, those that contribute most among them, and more of them as long as
    any of the last ones was wrong. This is for one and two scattering parameters.
    """
    panels = fit.likelihood.panels if isinstance(fit.likelihood, IndividualsAt) else None
    if panels is None:
        return found
    check, every = _ScoreCheck(fit, virtual, progress, settings), np.arange(fit.count)
    known, going = np.zeros(found.each.shape, dtype=np.bool_), np.ones(fit.count, dtype=np.bool_)
    while np.any(going) and not np.all(known):
        which = check.chosen(found, known)
        wrong, right = check.compared(found, which, fit.ruled(panels, going))
        wrong &= going
        each, scores = found.each.copy(), found.scores.copy()
        each[which, every] = np.where(wrong, right.each, each[which, every])
        scores[which, every] = np.where(wrong[..., None], right.scores, scores[which, every])
        found, going = _Scored(each, scores), np.any(wrong, axis=0)
    return found


@dataclass(frozen=True, eq=False)
class _ScoreCheck:
    """The comparison of scores at virtual outcomes with those by another node rule."""

    fit: Fit
    virtual: _Virtual
    progress: Progress
    settings: ScoreSettings

    def chosen(self, found: _Scored, known: Flags) -> Indices:
        """The numbers (Q, C) of the outcomes of each experiment to be checked next.

        They are flagged in `known` (R, C) from then on.
        """
        part, settings = self._parts(found), self.settings
        spread = np.modf(np.arange(len(part)) * GOLDEN)[0][:, None]
        orders = [-np.abs(part[..., k]) for k in range(part.shape[2])]
        most = [_first(order, known, settings.largest) for order in orders]
        even = _first(np.broadcast_to(spread, known.shape), known, settings.spread)
        return np.concatenate([*most, even])

    def compared(self, found: _Scored, which: Indices, other: Fit) -> tuple[Flags, _Scored]:
        """Whether scores at the outcomes `which` (Q, C) differ from those of another fit (Q, C).

        The other fit's scores there are returned, too.
        """
        every, settings = np.arange(self.fit.count), self.settings
        own = self.virtual.of_each(which, self.fit.table.observations.experiment)
        again = own.scored(other, self.progress, "check of virtual outcome")
        part = self._parts(found)
        present = np.maximum(np.diag(self.fit.inference.information), 0.0)
        counted = np.maximum(np.sum(part**2, axis=0), settings.least * present)
        share = np.sqrt(self.virtual.weights(found.each))[which, every]
        if self.virtual.step is not None:
            share = share * np.exp(0.5 * (again.each - found.each[which, every]))
        right = share[..., None] * again.scores[..., self._free]
        size = np.maximum(np.abs(right), np.sqrt(counted / len(part)) + np.finfo(float).tiny)
        wrong = np.abs(right - part[which, every]) > settings.differs * size
        return np.any(wrong, axis=2), again

    def _parts(self, found: _Scored) -> Array:
        """The scores (R, C, F) by the free hyperparameters, times the roots of their weights."""
        share = np.sqrt(self.virtual.weights(found.each))
        return np.nan_to_num(share[..., None] * found.scores[..., self._free])

    @property
    def _free(self) -> Indices:
        return self.fit.inference.identified


def _first(order: Array, known: Flags, count: int) -> Indices:
    """The numbers (count, C) of outcomes that are first in `order` (R, C) and not yet `known`.

    They are known from then on. Where too few are left, known ones follow.
    """
    found = np.argsort(np.where(known, np.inf, order), axis=0, kind="stable")[:count]
    np.put_along_axis(known, found, True, axis=0)
    return found


def _drawn(fit: Fit, rng: np.random.Generator, settings: ScoreSettings) -> _Virtual:
    drawn = [fit.likelihood.drawn(fit.table.observations, rng) for _ in range(settings.draws)]
    return _Virtual(np.array([one.lower for one in drawn]), np.array([one.upper for one in drawn]))


def _spaced(fit: Fit, lowest: Array, highest: Array, settings: ScoreSettings) -> _Virtual:
    """Equally spaced outcomes, and those beyond each limit of the test as one more outcome."""
    low, high = fit.likelihood.span()
    low, high = np.clip(low, lowest, highest), np.clip(high, lowest, highest)
    outcomes = low + np.linspace(0.0, 1.0, settings.nodes)[:, None] * (high - low)
    lower, upper = [*outcomes], [*outcomes]
    step = [*(_simpson(settings.nodes)[:, None] * (high - low) / (settings.nodes - 1))]
    if np.any(np.isfinite(highest)):
        lower.append(np.where(np.isfinite(highest), highest, high))
        upper.append(np.full(high.shape, np.inf))
        step.append(np.isfinite(highest).astype(float))
    if np.any(np.isfinite(lowest)):
        lower.append(np.full(low.shape, -np.inf))
        upper.append(np.where(np.isfinite(lowest), lowest, low))
        step.append(np.isfinite(lowest).astype(float))
    return _Virtual(np.array(lower), np.array(upper), np.array(step), outcomes)


def _simpson(count: int) -> Array:
    """Weights (count,) of Simpson's rule over steps of length one."""
    return np.asarray(simpson(np.eye(count)))


def quantile_gradients(
    found: Scores, probability: float, settings: ScoreSettings = SCORES
) -> tuple[Array, Array]:
    """Quantiles q (C,) of the outcomes, and gradients dq/dalpha (C, K) = -(dF/dalpha)(q) / f(q).

    F is the distribution function and f the density; dF/dalpha = int_{-inf}^q s f dy, with the
    scores s. Both integrals use the nodes of the scores. Each experiment must have one observation
    only.
    """
    y, below, slopes, density = _distribution(found)
    rising = np.maximum.accumulate(below, axis=0)
    q = np.array([np.interp(probability, F, nodes) for F, nodes in zip(rising.T, y.T, strict=True)])
    for _ in range(settings.newton):
        error = _at(y, below[..., None], q) - probability
        q = np.clip(q - (error / _at(y, density[..., None], q))[:, 0], y[0], y[-1])
    return q, -_at(y, slopes, q) / _at(y, density[..., None], q)


def _distribution(found: Scores) -> tuple[Array, Array, Array, Array]:
    """Nodes y (R, C) with F (R, C), dF/dalpha (R, C, K) and density f (R, C), without censoring."""
    assert found.outcomes is not None
    y = found.outcomes
    step = np.diff(y, axis=0).mean(axis=0)
    density = found.weights / (_simpson(len(y))[:, None] * step)
    moved = density[..., None] * found.scores
    below = cumulative_simpson(density, dx=1.0, axis=0, initial=0.0) * step
    slopes = cumulative_simpson(moved, dx=1.0, axis=0, initial=0.0) * step[:, None]
    return y, below, slopes, density


def _at(nodes: Array, values: Array, y: Array) -> Array:
    """Values (R, C, K) at nodes (R, C), interpolated at y (C,) by cubic splines."""
    each = [CubicSpline(nodes[:, c], values[:, c])(point) for c, point in enumerate(y)]
    return np.array(each).reshape(y.size, values.shape[2])
