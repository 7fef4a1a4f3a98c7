"""Criteria for the comparison of models: fit, number of hyperparameters, and prediction.

These are AIC and BIC (`Criteria`), the likelihood ratio of nested models (`LikelihoodRatio`), and
the log-density of each experiment at the maximum of the others (`leave_one_out`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import stats

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Flags, Indices
from aleator.inference.fit import Fit, refitted
from aleator.inference.information import DIFFERENCES, side_of
from aleator.laws.hyperparameter import Hyperparameter, curvatures, limits_of
from aleator.results.values import InformationCriteria


@dataclass(frozen=True)
class Criteria:
    """A maximal log-likelihood, with the numbers of hyperparameters and data, and its criteria.

    `of_law` free hyperparameters belong to the laws of parameters that differ between the N
    `experiments`. `of_rest` belong to the noise and to constants, about which each of the M
    `observations` has information.

    >>> found = Criteria(-875.970, 5, 1, 18, 180)
    >>> round(found.aic, 2), round(found.aicc, 2), round(found.bic, 2)
    (1763.94, 1771.58, 1771.58)
    """

    log_likelihood: float
    of_law: int
    of_rest: int
    experiments: int
    observations: int

    @classmethod
    def of(cls, fit: Fit) -> Criteria:
        """The criteria of a fit at its maximum.

        Free hyperparameters of scattering laws are counted apart from all others, since BIC relates
        them to the number of experiments.
        """
        laws, identified = fit.inputs.laws, fit.inference.identified.tolist()
        of_law = 0
        for k in identified:
            law = laws.get(fit.hyperparameters[k].name.partition(".")[0])
            of_law += k < fit.inputs.size and (law is None or law.scatters)
        return cls(
            fit.scored().likelihood, of_law, len(identified) - of_law, fit.count,
            len(fit.table.observations),
        )  # fmt: skip

    def reported(self) -> InformationCriteria:
        """The criteria as an answer has them."""
        aicc = self.aicc if math.isfinite(self.aicc) else None
        return InformationCriteria(self.free, self.aic, aicc, self.bic)

    @property
    def free(self) -> int:
        """K, the number of free hyperparameters."""
        return self.of_law + self.of_rest

    @property
    def aic(self) -> float:
        """Akaike's criterion AIC = -2 log L + 2 K (Akaike 1974)."""
        return -2.0 * self.log_likelihood + 2.0 * self.free

    @property
    def aicc(self) -> float:
        """AIC + 2 K (K + 1) / (N - K - 1) (Hurvich and Tsai 1989); infinite for N <= K + 1.

        The sample size N is the number of experiments, since the observations of one experiment are
        not independent.
        """
        left = self.experiments - self.free - 1
        return self.aic + 2.0 * self.free * (self.free + 1) / left if left > 0 else math.inf

    @property
    def bic(self) -> float:
        """BIC = -2 log L + K_law log N + K_rest log M (Delattre, Lavielle and Poursat 2014)."""
        return (
            -2.0 * self.log_likelihood
            + self.of_law * math.log(self.experiments)
            + self.of_rest * math.log(self.observations)
        )


@dataclass(frozen=True)
class LeaveOneOutSettings:
    """Settings of leave-one-out by one Newton step. The values are chosen by judgement."""

    tie: float = 1e-9
    """Differences of likelihood ratios below this count as zero, for ties in the bootstrap."""
    trusted: float = 0.1
    """Largest change of log p(y_l) for which one Newton step is trusted; it is then exact to about
    0.01.
    """
    leverage: float = 0.5
    """Largest share of an experiment in the information, in any direction, for which a Newton step
    is trusted.
    """
    determined: float = 1e-8
    """Eigenvalue of the scaled information below which a direction counts as undetermined."""
    released: float = 1e-3
    """Gain in log-likelihood from leaving a limit above which the Newton step is not trusted."""


LEAVE_ONE_OUT = LeaveOneOutSettings()


@dataclass(frozen=True)
class LikelihoodRatio:
    """The likelihood ratio D = 2 (log L_larger - log L_smaller) with its reference law.

    The larger model has `df` more free hyperparameters; `on_boundary` of them are scales that are
    zero in the smaller model. `bootstrap` (R,) are ratios for data drawn under the smaller model:
    NaN where a search did not arrive, empty without a bootstrap. `regular` is False where the
    bootstrap is the only reference.
    """

    smaller: str
    larger: str
    statistic: float
    df: int
    on_boundary: int
    regular: bool
    bootstrap: Array

    @property
    def p(self) -> float:
        """P(chi-squared >= D) by the reference law; NaN where there is none.

        With a scale of zero in the smaller model the law is half chi2(df - 1) and half chi2(df).
        This is exact for one scale (Self and Liang 1987, case 5; with its correlations Stram and
        Lee 1994, case 3), and an upper bound for several (Perlman 1969).
        """
        if not self.regular or self.df < 1:
            return float("nan")
        return ratio_p(self.statistic, self.df, boundary=self.on_boundary > 0)

    @property
    def bootstrap_p(self) -> float:
        """The bootstrap p value (1 + number of ratios >= D) / (1 + R); NaN without a bootstrap."""
        drawn = self.bootstrap[np.isfinite(self.bootstrap)]
        if not drawn.size:
            return float("nan")
        return float((1 + np.sum(drawn >= self.statistic - LEAVE_ONE_OUT.tie)) / (1 + drawn.size))

    @property
    def reference(self) -> str:
        """The name of the reference law, such as chi2(1)."""
        if not self.regular or self.df < 1:
            return "bootstrap"
        if not self.on_boundary:
            return f"chi2({self.df})"
        bound = "<= " if self.on_boundary > 1 else ""
        return f"{bound}1/2 chi2({self.df - 1}) + 1/2 chi2({self.df})"


def ratio_p(
    statistic: float, df: int, *, boundary: bool, settings: LeaveOneOutSettings = LEAVE_ONE_OUT
) -> float:
    """P(chi2(df) >= statistic); on a `boundary` the law is half chi2(df - 1) and half chi2(df).

    chi2(0) is zero with certainty. A negative statistic, which only a wrong maximum gives, has p =
    1.

    >>> round(ratio_p(3.841, 1, boundary=False), 3), round(ratio_p(3.841, 1, boundary=True), 3)
    (0.05, 0.025)
    """
    if statistic <= settings.tie:
        return 1.0
    larger = float(stats.chi2.sf(statistic, df))
    if not boundary:
        return larger
    smaller = float(stats.chi2.sf(statistic, df - 1)) if df > 1 else 0.0
    return 0.5 * (smaller + larger)


@dataclass(frozen=True)
class LeaveOneOut:
    """Each of N experiments predicted by the model fitted to the other ones.

    `each` (N,) is log p(y_l | alpha without l), and `alpha` (N, K) are the maxima without l.
    `leverage` (N,) is the largest share of an experiment in the information. `refitted` (N,) says
    which maxima were searched for; the others are one Newton step. `arrived` (N,) is False where a
    search failed.
    """

    each: Array
    alpha: Array
    leverage: Array
    refitted: Flags
    arrived: Flags

    @property
    def total(self) -> float:
        """The predictive log-likelihood, summed over experiments."""
        return float(self.each.sum())

    @property
    def error(self) -> float:
        """The standard error of the total, sqrt(N var), for experiments drawn at random."""
        return summed_error(self.each)


def summed_error(each: Array) -> float:
    """The standard error of a sum of N independent terms, sqrt(N var); NaN for one term.

    For paired differences of two models it is the error of the difference (Vehtari, Gelman and
    Gabry 2017).

    >>> round(summed_error(np.array([1.0, 2.0, 3.0])), 3)
    1.732
    """
    if each.size < 2:
        return float("nan")
    return math.sqrt(each.size) * float(np.std(each, ddof=1))


def leave_one_out(
    fit: Fit,
    progress: Progress | None = None,
    group: Indices | None = None,
    settings: LeaveOneOutSettings = LEAVE_ONE_OUT,
) -> LeaveOneOut:
    """log p(y_l | alpha_-l) of each experiment, alpha_-l being the maximum of the others; no runs.

    Let s_l be the score and H_l the information of experiment l, and H the information of all
    experiments and priors. One Newton step on the log-likelihood of the others is

        alpha_-l = alpha - (H - H_l)^-1 s_l,

    and log p(y_l) at this point is computed to second order. The maximum is searched for instead
    where the step changes log p(y_l) by more than 0.1, where the experiment has more than half of
    the information in a direction, or where limits matter. Experiments that share parameters, or a
    `group` (N,), are left out together, and count as one experiment here. Cost: 2 F
    evaluations, and about ten for each such search.
    """
    told = progress or Silent()
    group = fit.cluster if group is None else group
    local = _Local.of(fit, group, settings)
    each, alpha, trusted = local.stepped()
    arrived = np.ones(each.size, dtype=bool)
    again = np.flatnonzero(~trusted)
    for done, l in enumerate(again.tolist()):
        told.update(f"refit {done + 1} of {again.size}", done, again.size)
        end = refitted(fit, (group != l).astype(float))
        left = end.fit.scored().summed(group)[0]
        each[l], alpha[l], arrived[l] = left[l], end.fit.alpha, end.arrived
    return LeaveOneOut(each, alpha, local.leverage, ~trusted, arrived)


@dataclass(frozen=True)
class _Local:
    """The log-likelihood of each experiment around alpha, to second order.

    `values` (N,), `scores` (N, F) and `information` (N, F, F) are with respect to the identified
    hyperparameters `moving`. `inside` (F,) says which of them are off their limits. `believed` (F,)
    and `curvature` (F,) are the score and the information of the priors, which do not change when
    an experiment is left out.
    """

    alpha: Array
    hyperparameters: Sequence[Hyperparameter]
    moving: Indices
    inside: Flags
    values: Array
    scores: Array
    information: Array
    believed: Array
    curvature: Array
    settings: LeaveOneOutSettings = LEAVE_ONE_OUT

    @classmethod
    def of(cls, fit: Fit, group: Indices, settings: LeaveOneOutSettings) -> _Local:
        moving, alpha = fit.inference.identified, fit.alpha
        found = fit.scored()
        each, scores = found.summed(group)
        scores = scores[:, moving]
        own = [fit.hyperparameters[k] for k in moving]
        sides = [side_of(value, h) for value, h in zip(alpha[moving], own, strict=True)]
        inside = np.array([side is None for side in sides], dtype=np.bool_)
        information = informations(fit, scores, group)
        believed, curvature = (
            found.score[moving] - scores.sum(axis=0),
            curvatures(own, alpha[moving]),
        )
        return cls(
            alpha, own, moving, inside, each, scores, information, believed, curvature,
            settings,
        )  # fmt: skip

    @cached_property
    def _whole(self) -> Array:
        """The information H (F, F) of all experiments and the priors."""
        return np.asarray(self.information.sum(axis=0) + np.diag(self.curvature))

    @cached_property
    def _whitening(self) -> Array:
        """The matrix W (F, G) with W' H W = 1 over the directions that the data determine."""
        whole = self._whole[np.ix_(self.inside, self.inside)]
        scale = np.sqrt(np.abs(np.diag(whole)))
        known = scale > 0.0
        scale = np.where(known, scale, 1.0)
        values, vectors = np.linalg.eigh(whole / np.outer(scale, scale))
        kept = values > self.settings.determined
        found = np.zeros((self.moving.size, int(kept.sum())))
        found[self.inside] = vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None]
        return found

    @cached_property
    def _share(self) -> Array:
        """The share W' H_l W (N, G, G) of each experiment in the information."""
        w = self._whitening
        return np.asarray(w.T @ self.information @ w)

    @cached_property
    def leverage(self) -> Array:
        """The largest eigenvalue (N,) of each experiment's share in the information."""
        if not self._share.shape[1]:
            return np.zeros(len(self.values))
        return np.asarray(np.linalg.eigvalsh(self._share)[:, -1])

    def stepped(self) -> tuple[Array, Array, Flags]:
        """log p(y_l) after a Newton step (N,), alpha there (N, K), and whether to trust it (N,)."""
        rest = self.scores.sum(axis=0) + self.believed - self.scores
        safe = self.leverage < self.settings.leverage
        share = np.where(safe[:, None, None], self._share, 0.0)
        unit = np.eye(share.shape[1]) - share
        z = np.linalg.solve(unit, (rest @ self._whitening)[:, :, None])[:, :, 0]
        step = z @ self._whitening.T
        change = np.sum(self.scores * step, axis=1)
        change -= 0.5 * np.einsum("lf,lfg,lg->l", step, self.information, step)
        lower, upper = limits_of(self.hyperparameters)
        end = self.alpha[self.moving] + step
        within = np.all((end >= lower) & (end <= upper), axis=1)
        alpha = np.repeat(self.alpha[None], len(self.values), axis=0)
        alpha[:, self.moving] = np.clip(end, lower, upper)
        fine = np.isfinite(change) & (np.abs(change) <= self.settings.trusted)
        return self.values + change, alpha, safe & within & fine & ~self._released(rest)

    def _released(self, rest: Array) -> Flags:
        """Whether a hyperparameter on a limit would leave it without the experiment (N,).

        This is judged by the score, and by the curvature, since the score of a scale at zero is
        zero.
        """
        held = np.flatnonzero(~self.inside).tolist()
        left = self._whole - self.information
        found = np.zeros(len(rest), dtype=bool)
        for k in held:
            h, value = self.hyperparameters[k], self.alpha[self.moving[k]]
            inward = 1.0 if value - h.lower < h.upper - value else -1.0
            curvature = left[:, k, k]
            room = h.upper - h.lower
            gain = np.maximum(inward * rest[:, k], 0.0) ** 2 / (np.abs(curvature) + 1.0 / room**2)
            turned = (curvature < 0.0) & (-curvature * room**2 > self.settings.released)
            found |= (0.5 * gain > self.settings.released) | turned
        return found


def informations(fit: Fit, scores: Array, group: Indices | None = None) -> Array:
    """The information -d2 log p(y_l) / d alpha2 (N, F, F) of each group of experiments.

    `scores` (N, F) are those of the groups, and `group` has the group of each experiment; None
    stands for the clusters.

    It is computed by finite differences of the scores (see `Differences`). The sum over experiments
    is the observed information.
    """
    moving, own = fit.inference.identified, fit.cluster if group is None else group

    def scored(point: Array) -> Array:
        alpha = fit.alpha.copy()
        alpha[moving] = point
        return fit.at(alpha).scored().summed(own)[1][:, moving]

    if not moving.size:
        return np.zeros((len(scores), 0, 0))
    limits, known = limits_of(fit.hyperparameters, moving), np.sum(scores**2, axis=0)
    found = DIFFERENCES.bends(scored, fit.alpha[moving], *limits, known).transpose(1, 0, 2)
    return np.asarray(0.5 * (found + found.transpose(0, 2, 1)))
