"""The uncertainty of alpha: information matrix, standard errors, intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from aleator.core.types import Array
from aleator.laws.hyperparameter import Hyperparameter, curvatures, limits_of
from aleator.search.interface import Scored


@dataclass(frozen=True)
class IntervalSettings:
    """Settings of intervals and limits. The values are chosen by judgement.

    tail: the probability beyond each end of an interval.
    limit: share of the range between the limits; an estimate closer than this to a limit is on it.
    singular: least eigenvalue of an information matrix with a unit diagonal; with a smaller one the
    matrix is not positive definite.
    widest: the largest standard error, over the width of the limits; with a larger one the
    hyperparameters are not determined, and the matrix counts as not positive definite.
    clusters: where experiments share parameters, the least number of clusters for each
    hyperparameter with a sandwich error (by judgement: Pastes, ten batches and four
    hyperparameters, would have errors of half the size).
    """

    tail: float = 0.025
    limit: float = 1e-6
    singular: float = 1e-12
    widest: float = 100.0
    clusters: int = 5

    @property
    def level(self) -> float:
        """The confidence level of all intervals.

        >>> IntervalSettings().level
        0.95
        """
        return 1.0 - 2.0 * self.tail

    @property
    def ends(self) -> tuple[float, float]:
        """The probabilities at the two ends of an interval.

        >>> IntervalSettings().ends
        (0.025, 0.975)
        """
        return self.tail, 1.0 - self.tail


INTERVALS = IntervalSettings()


@dataclass(frozen=True)
class Differences:
    """Settings of finite differences of scores, with steps chosen by the drop of log-likelihood.

    A step h is right where the drop I h^2/2 of the log-likelihood equals `drop` within a factor of
    `within`. The step is then about a hundredth of a standard error, between 0.003 and 0.03. The
    information of a standard deviation of two units is then within 1e-3 of its closed form
    (`tests/tasks/test_mixtures.py`). No step is longer than `share` of the width of the limits, for
    directions without curvature. At most `tries` steps are tried. A step differs from the last one
    by a factor of at most `farthest` (by judgement), because the drop over a step of a very
    different size says little.
    """

    drop: float = 5e-5
    within: float = 10.0
    share: float = 1e-2
    tries: int = 40
    farthest: float = 1e3

    def bends(
        self,
        scores: Callable[[Array], Array],
        point: Array,
        lower: Array,
        upper: Array,
        known: Array,
    ) -> Array:
        """Derivatives -d scores/d point (F, N, F) of scores (N, F) at `point` (F,), within limits.

        `known` (F,) is a first estimate of the diagonal of the information. Where it is too small,
        for example because the scores of all experiments are zero, shorter steps follow.
        """
        found = []
        for row, longest in enumerate(self.share * (upper - lower)):
            step = float(
                min(longest, (2.0 * self.drop / max(known[row], np.finfo(float).tiny)) ** 0.5)
            )
            for _ in range(self.tries):
                ahead, behind = point.copy(), point.copy()
                ahead[row] = min(point[row] + step, upper[row])
                behind[row] = max(point[row] - step, lower[row])
                apart = ahead[row] - behind[row]
                bend = (scores(behind) - scores(ahead)) / apart
                whole = bool(np.all(np.isfinite(bend)))
                bent = abs(float(bend[:, row].sum())) if whole else np.inf
                off = 0.5 * bent * (0.5 * apart) ** 2 / self.drop
                if 1.0 / self.within < off < self.within or (off < 1.0 and step == longest):
                    break
                least = 1.0 / self.farthest
                factor = self.farthest
                if off > 0.0:
                    factor = float(np.clip(off**-0.5, least, self.farthest))
                step = min(step * factor, longest) if np.isfinite(off) else least * step
            found.append(bend)
        return np.array(found) if found else np.zeros((0, 1, 0))


DIFFERENCES = Differences()


@dataclass(frozen=True)
class Inference:
    """The uncertainty of alpha (K,); NaN where alpha is fixed, on a limit, or not determined.

    `standard_error` is from the observed information H = -d2 log L/d alpha2; `sandwich_error` is
    from H^-1 (sum_l s_l s_l') H^-1 (White, 1982), which stays valid when the model is wrong. A
    prior counts in both with its curvature. `lower` and `upper` are the interval estimate -+ 1.96
    standard errors, cut at the limits. `covariance` (F, F) belongs to the hyperparameters `free`
    (F,), which are free and off their limits. `edm` is the estimated distance to the maximum in
    log-likelihood, 0.5 g' H^-1 g, with the gradient g. `at_bound` (K,) is None, "lower" or "upper".
    `positive` says whether the information is positive definite. `identified` (G,) are all free
    hyperparameters, on their limits or not, and `information` (G, G) is their information.
    """

    standard_error: Array
    sandwich_error: Array
    lower: Array
    upper: Array
    free: NDArray[np.intp]
    covariance: Array
    edm: float
    at_bound: tuple[str | None, ...]
    positive: bool
    identified: NDArray[np.intp]
    information: Array

    @property
    def correlation(self) -> Array:
        """Correlations (F, F) of the free estimates that are off their limits."""
        scale = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(scale, scale))

    def differences(self, alpha: Array, other: Array) -> Array:
        """Differences (K,) of two alphas in standard errors; NaN without a standard error."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((alpha - other) / self.standard_error)

    def apart(self, alpha: Array, other: Array) -> float:
        """The largest difference of two alphas in standard errors."""
        return float(np.nanmax(np.abs(self.differences(alpha, other)), initial=0.0))

    def among(self, alpha: Array, others: Sequence[Array], apart: float) -> bool:
        """Whether alpha is within `apart` standard errors of one of the others."""
        return any(self.apart(alpha, other) < apart for other in others)


def infer(
    objective: Scored,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    *,
    by_scores: bool = False,
) -> Inference:
    """Standard errors and intervals at alpha, from the exact scores.

    The observed information is the central difference of the score. This takes 2 F evaluations, and
    two more for each step that had the wrong size (see `Differences`). A hyperparameter on its
    limit has no standard error, and the errors of the others are conditional on it. With
    `by_scores` the information is the sum of the outer products of the experiments' scores instead,
    which has the same mean (Berndt et al., 1974) and no difference errors. Experiments that share
    parameters count together; there is no sandwich error where these clusters are few.
    """
    at_bound = tuple(side_of(value, h) for value, h in zip(alpha, hyperparameters, strict=True))
    identified = np.flatnonzero([h.free for h in hyperparameters])
    inside = np.array([at_bound[k] is None for k in identified], dtype=bool)
    free = identified[inside]
    here = objective(alpha)
    scores = here.scores
    assert scores is not None
    # A prior counts like another measurement, with its curvature as information.
    independent = here.independent[:, identified]
    told = independent.T @ independent
    told = told + np.diag(curvatures(hyperparameters, alpha)[identified])
    full = told
    if not by_scores:
        own = scores[:, identified]
        full = observed_information(objective, alpha, hyperparameters, identified, own)
    information, varied = full[np.ix_(inside, inside)], told[np.ix_(inside, inside)]
    lower, upper = limits_of(hyperparameters)
    covariance, positive = _inverse(information, (upper - lower)[free])
    sandwich = covariance @ varied @ covariance
    gradient = scores[:, free].sum(axis=0)
    if here.prior_score is not None:
        gradient = gradient + here.prior_score[free]
    nothing = np.full(alpha.size, np.nan)
    standard_error, sandwich_error = nothing.copy(), nothing.copy()
    standard_error[free] = np.sqrt(np.diag(covariance))
    if here.cluster is None or len(independent) >= INTERVALS.clusters * free.size:
        sandwich_error[free] = np.sqrt(np.diag(sandwich))
    half = stats.norm.ppf(0.5 + INTERVALS.level / 2.0) * standard_error
    return Inference(
        standard_error,
        sandwich_error,
        np.maximum(alpha - half, lower),
        np.minimum(alpha + half, upper),
        free,
        covariance,
        0.5 * float(gradient @ covariance @ gradient) if positive else float("nan"),
        at_bound,
        positive,
        identified,
        full,
    )


def observed_information(
    objective: Scored,
    alpha: Array,
    hyperparameters: Sequence[Hyperparameter],
    free: NDArray[np.intp],
    scores: Array,
    differences: Differences = DIFFERENCES,
) -> Array:
    """The information -d2 log L/d alpha2 (F, F), by differences of the score within the limits."""

    def score(point: Array) -> Array:
        moved = alpha.copy()
        moved[free] = point
        return objective(moved).score[None, free]

    limits, known = limits_of(hyperparameters, free), np.sum(scores**2, axis=0)
    information = differences.bends(score, alpha[free], *limits, known)[:, 0]
    return np.asarray(0.5 * (information + information.T))


def side_of(value: float, h: Hyperparameter) -> str | None:
    """The limit on which a free hyperparameter's value lies, "lower" or "upper"; else None."""
    if not h.free:
        return None
    margin = INTERVALS.limit * (h.upper - h.lower)
    if value <= h.lower + margin:
        return "lower"
    return "upper" if value >= h.upper - margin else None


def _inverse(information: Array, width: Array) -> tuple[Array, bool]:
    """The covariance and True; NaN and False where the information is not positive definite."""
    if information.size == 0:
        return information, True
    scale = np.sqrt(np.abs(np.diag(information)))
    scaled = information / np.outer(scale, scale) if np.all(scale > 0.0) else information * np.nan
    if not np.all(np.isfinite(scaled)) or np.linalg.eigvalsh(scaled)[0] <= INTERVALS.singular:
        return np.full_like(information, np.nan), False
    covariance = np.linalg.inv(scaled) / np.outer(scale, scale)
    if np.any(np.diag(covariance) > (INTERVALS.widest * width) ** 2):
        return np.full_like(information, np.nan), False
    return covariance, True
