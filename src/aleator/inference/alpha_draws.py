"""Random draws of alpha that agree with the experiments, and quantiles of weighted values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import linalg, optimize, special
from scipy.stats import qmc

from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError
from aleator.inference.information import INTERVALS
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.results.values import Estimate, in_order
from aleator.search.interface import Scored


def quantiles(values: Array, weights: Array, probabilities: Array) -> Array:
    """Quantiles (..., P) of values (..., J) with weights (..., J) at P probabilities.

    The cumulative weight of a value is counted to the middle of its own weight; quantiles between
    two values are interpolated linearly. A value that is NaN does not count. The quantile is NaN
    where no value has a weight.

    >>> quantiles(np.array([3.0, 1.0, 2.0]), np.ones(3), np.array([0.5])).tolist()
    [2.0]
    """
    weights = np.broadcast_to(weights, values.shape)
    lead, size = values.shape[:-1], values.shape[-1]
    found = np.full((int(np.prod(lead)), len(probabilities)), np.nan)
    rows = zip(values.reshape(-1, size), weights.reshape(-1, size), strict=True)
    for row, (y, w) in enumerate(rows):
        order = np.argsort(y)
        y, w = y[order], w[order]
        counted = (w > 0.0) & ~np.isnan(y)
        if np.any(counted):
            y, w = y[counted], w[counted]
            reached = np.cumsum(w)
            found[row] = _between(y, (reached - 0.5 * w) / reached[-1], probabilities)
    return found.reshape(*lead, len(probabilities))


def _between(y: Array, reached: Array, probabilities: Array) -> Array:
    """Interpolated quantiles; where a value is infinite, the next larger value itself."""
    if np.all(np.isfinite(y)):
        return np.interp(probabilities, reached, y)
    return y[np.clip(np.searchsorted(reached, probabilities), 0, len(y) - 1)]


END = float(special.ndtri(INTERVALS.ends[1]))
"""The standard normal quantile at the upper end of a 95 % interval: 1.96."""


@dataclass(frozen=True)
class DrawSettings:
    """Settings of the random draws of alpha. The values are chosen by judgement."""

    count: int = 256
    """Number of draws of alpha."""
    wide: float = 1.3
    """Factor by which draws that are weighted afterwards scatter more than the estimates do."""
    steepest: float = 1.5
    """Largest skewness parameter b of an interval. At this value the upper half of the interval is
    19 times as long as the lower half; a more skewed interval is not followed further.
    """
    smallest: float = 1e-9
    """Numerical zero: a smaller skewness parameter counts as zero, smaller eigenvalues of the
    correlation matrix are raised to it, and uniform numbers keep this distance from zero and one.
    """
    tries: int = 8
    """Number of candidates that are drawn for each draw, because those beyond the limits are left
    out.
    """


DRAWING = DrawSettings()


@dataclass(frozen=True, eq=False)
class Estimated:
    """Estimates, standard errors, intervals and correlations of alpha (K,), as a result has them.

    `error` (K,) and `interval` (K, 2) are NaN where the result has none. `correlation` (F, F) is
    that of the hyperparameters with the indices `which` (F,). `limits` (K, 2) are the limits of the
    search. `free` (K,) says which hyperparameters are identified, and `scale` (K,) which are
    scales, such as standard deviations.
    """

    alpha: Array
    error: Array
    interval: Array
    limits: Array
    free: Flags
    scale: Flags
    which: Indices
    correlation: Array


@dataclass(frozen=True, eq=False, repr=False)
class AlphaDraws:
    """Draws (A, K) of alpha with weights (A,) that sum to one; `estimate` (K,) is the maximum.

    `z` (A, K) are the normal variates from which the draws are made. `log_density` (A,) is the
    logarithm of the density of the draws divided by the prior density, zero at the estimate; the
    likelihood is divided by it when the draws are weighted. `fixed` (H,) are the free
    hyperparameters whose uncertainty is unknown: they keep their estimate. `effective` is the
    number of equally weighted draws that would be as precise. `names` (K,) are those of the
    hyperparameters, or empty.

    >>> AlphaDraws.at(np.array([1.0, 0.5])).alpha.tolist()
    [[1.0, 0.5]]
    """

    estimate: Array
    alpha: Array
    weights: Array
    z: Array
    log_density: Array
    fixed: Indices
    names: tuple[str, ...] = ()

    def __repr__(self) -> str:
        size = f"{len(self.alpha)} draws of alpha, as precise as {self.effective:.0f} of one weight"
        return f"{size}\n{self.table().to_string(float_format='{:.4g}'.format)}"

    def table(self) -> pd.DataFrame:
        """A row for each hyperparameter: its estimate, and mean, sd and quantiles of its draws.

        >>> AlphaDraws.at(np.array([1.0])).table().loc[0].tolist()
        [1.0, 1.0, 0.0, 1.0, 1.0]
        """
        mean = self.weights @ self.alpha
        low, high = quantiles(self.alpha.T, self.weights, np.array(INTERVALS.ends)).T
        sd = np.sqrt(self.weights @ (self.alpha - mean) ** 2) * (np.ptp(self.alpha, axis=0) > 0.0)
        columns = {
            "estimate": self.estimate, "mean": mean, "sd": sd, "q0.025": low, "q0.975": high,
        }  # fmt: skip
        return pd.DataFrame(columns, index=[*self.names] or None)

    @classmethod
    def at(cls, alpha: Array) -> AlphaDraws:
        """The estimate as the only draw: alpha is treated as known exactly."""
        one = np.ones(1)
        return cls(alpha, alpha[None], one, np.zeros((1, alpha.size)), 0.0 * one,
                   np.empty(0, np.intp))  # fmt: skip

    @classmethod
    def weighted(cls, estimate: Array, alpha: Array, weights: Array) -> AlphaDraws:
        """Draws alpha (A, K) that were weighted by the likelihood already."""
        return cls(estimate, alpha, weights, np.zeros_like(alpha), np.zeros(len(alpha)),
                   np.empty(0, np.intp))  # fmt: skip

    @property
    def certain(self) -> bool:
        """Whether the estimate is the only draw."""
        return len(self.alpha) == 1

    @property
    def effective(self) -> float:
        """The effective number of draws, 1/sum w^2 (Kish, 1965)."""
        return float(1.0 / np.sum(self.weights**2))

    def fewer(self, most: int) -> AlphaDraws:
        """The first `most` draws, with their weights scaled to sum to one."""
        weights = self.weights[:most]
        return replace(
            self, alpha=self.alpha[:most], weights=weights / weights.sum(), z=self.z[:most],
            log_density=self.log_density[:most],
        )  # fmt: skip

    def reweighted(self, objective: Scored) -> AlphaDraws:
        """The draws, weighted by the likelihood itself instead of its normal approximation.

        The weights are L(alpha_a) prior(alpha_a)/q(alpha_a), where q is the density of the draws.
        Weights are cut at sqrt(A) times their mean (Ionides, 2008). The prior is flat, except for a
        scale whose interval lies within its limits: its prior is 1/alpha, with which the intervals
        of quantiles of a normal sample are exact. A scale near zero has a flat prior, so that the
        data alone decide how plausible zero is. Cost: one evaluation of the likelihood for each
        draw.
        """
        value = np.array([objective(alpha).total for alpha in self.alpha])
        log_weight = np.where(np.isfinite(value), value - self.log_density, -np.inf)
        weights = np.exp(log_weight - log_weight.max())
        weights = np.minimum(weights, weights.mean() * np.sqrt(weights.size))
        return replace(self, weights=weights / weights.sum())


def alpha_draws(
    known: Estimated,
    count: int = DRAWING.count,
    seed: int = 0,
    wide: float = 1.0,
    settings: DrawSettings = DRAWING,
) -> AlphaDraws:
    """Random draws of alpha that reproduce its intervals and correlations, within the limits.

    alpha_k = h_k(z_k), where the z are correlated standard normal variates: a Gaussian copula. The
    function h_k is chosen such that the profile log-likelihood is a parabola in z_k:

        h(z) = alpha + s (exp(b z) - 1)/b,   h(-1.96) and h(1.96) are the ends of the interval.

    For a symmetric interval h is the line alpha + z error. Where one end lies on a limit, the slope
    s is the standard error. A hyperparameter on its limit has h(z) = limit + |z| (other end -
    limit)/1.96 and is independent of the others. Without an interval h is the line; without a
    standard error either, the hyperparameter keeps its estimate. Draws beyond the limits are left
    out. Draws come in pairs z, -z (antithetic) of scrambled Sobol' points with this `seed`. There
    may be fewer than `count` draws where most candidates lie beyond the limits. `wide` multiplies
    z, for draws that are weighted afterwards.
    """
    scales = [_Profiled.of(known, k) for k in range(known.alpha.size)]
    moving = np.array([k for k, scale in enumerate(scales) if scale is not None], dtype=np.intp)
    held = np.array([k for k in np.flatnonzero(known.free) if scales[k] is None], dtype=np.intp)
    if not moving.size:
        return replace(AlphaDraws.at(known.alpha), fixed=held)
    correlation = _correlation(known, moving)
    z = np.zeros((count * settings.tries, known.alpha.size))
    root = wide * np.linalg.cholesky(correlation).T
    z[:, moving] = _paired(len(z), moving.size, seed) @ root
    own = z[:, moving] / wide
    log_density = -0.5 * np.einsum("af,fg,ag->a", own, np.linalg.inv(correlation), own)
    alpha = np.tile(known.alpha, (len(z), 1))
    for k in moving.tolist():
        scale = scales[k]
        assert scale is not None
        alpha[:, k] = scale(z[:, k])
        log_density -= scale.bend * z[:, k]
        if known.scale[k] and scale.whole:
            log_density += np.log(np.maximum(alpha[:, k], np.finfo(float).tiny) / known.alpha[k])
    inside = np.all((alpha >= known.limits[:, 0]) & (alpha <= known.limits[:, 1]), axis=1)
    chosen = np.flatnonzero(inside)[:count]
    weights = np.full(chosen.size, 1.0 / chosen.size)
    return AlphaDraws(known.alpha, alpha[chosen], weights, z[chosen], log_density[chosen], held)


def inverse_prior(known: Estimated) -> Flags:
    """Which hyperparameters (K,) have the prior 1/alpha: scales with an interval in their limits.

    All others have a flat prior (see `AlphaDraws.reweighted`).
    """
    scales = [_Profiled.of(known, k) for k in range(known.alpha.size)]
    whole = np.array([scale is not None and scale.whole for scale in scales], dtype=bool)
    return np.asarray(known.scale & whole)


@dataclass(frozen=True)
class _Profiled:
    """A hyperparameter as a function of a normal variate: estimate + slope (exp(bend z) - 1)/bend.

    `folded` says that |z| takes the place of z, for an estimate on a limit; `whole` says that both
    ends of the interval lie within the limits.
    """

    estimate: float
    slope: float
    bend: float
    folded: bool = False
    whole: bool = False

    @classmethod
    def of(cls, known: Estimated, k: int) -> _Profiled | None:
        """The function of hyperparameter k; None where its uncertainty is unknown."""
        at, error, (low, high) = known.alpha[k], known.error[k], known.limits[k]
        if not known.free[k]:
            return None
        lower, upper = known.interval[k]
        margin = INTERVALS.limit * (high - low)
        if at <= low + margin:
            return cls(at, (upper - at) / END, 0.0, True) if upper > at else None
        if at >= high - margin:
            return cls(at, (lower - at) / END, 0.0, True) if lower < at else None
        down = at - lower if lower > low + margin else np.nan
        up = upper - at if upper < high - margin else np.nan
        if down > 0.0 and up > 0.0:
            bend = float(np.clip(np.log(up / down) / END, -DRAWING.steepest, DRAWING.steepest))
            return cls(at, up / float(_bent(END, bend)), bend, whole=True)
        if not error > 0.0:
            return None
        if up > 0.0 or down > 0.0:
            return cls(at, error, _bend(up / error) if up > 0.0 else -_bend(down / error))
        return cls(at, error, 0.0)

    def __call__(self, z: Array) -> Array:
        """The values of the hyperparameter at normal variates z."""
        return np.asarray(
            self.estimate + self.slope * _bent(np.abs(z) if self.folded else z, self.bend)
        )


def _bent(z: Array | float, bend: float) -> Array:
    return np.asarray(z if abs(bend) < DRAWING.smallest else np.expm1(bend * np.asarray(z)) / bend)


def _bend(reach: float, settings: DrawSettings = DRAWING) -> float:
    """The skewness parameter with which z = 1.96 lies `reach` standard errors above alpha."""
    ends = [float(_bent(END, b)) - reach for b in (-settings.steepest, settings.steepest)]
    if ends[0] >= 0.0 or ends[1] <= 0.0:
        return -settings.steepest if ends[0] >= 0.0 else settings.steepest
    return float(
        optimize.brentq(
            lambda b: float(_bent(END, b)) - reach, -settings.steepest, settings.steepest
        )
    )


def _correlation(known: Estimated, moving: Indices) -> Array:
    """Correlations (G, G) of the varying hyperparameters; one on its limit is uncorrelated."""
    place = {int(k): row for row, k in enumerate(known.which)}
    found = np.eye(moving.size)
    for i, k in enumerate(moving.tolist()):
        for j, l in enumerate(moving.tolist()):
            if i != j and k in place and l in place:
                value = known.correlation[place[k], place[l]]
                found[i, j] = value if np.isfinite(value) else 0.0
    values, vectors = linalg.eigh(found)
    floored = (vectors * np.maximum(values, DRAWING.smallest)) @ vectors.T
    scale = np.sqrt(np.diag(floored))
    return np.asarray(floored / np.outer(scale, scale))


def _paired(count: int, dimensions: int, seed: int) -> Array:
    """Standard normal quasi-random points (count, dimensions), each followed by its negative."""
    half = qmc.Sobol(dimensions, rng=seed).random_base2(int(np.ceil(np.log2(count / 2))))
    z = special.ndtri(np.clip(half, DRAWING.smallest, 1.0 - DRAWING.smallest))
    return np.stack([z, -z], axis=1).reshape(-1, dimensions)[:count]


def estimated(
    alpha: Mapping[str, Estimate],
    names: Sequence[str],
    correlation: Sequence[Sequence[float]],
    hyperparameters: Sequence[Hyperparameter],
) -> Estimated:
    """The `Estimated` values of a stored result; `correlation` (F, F) is that of the F `names`.

    Raises InputsError where alpha lacks a hyperparameter, or where alpha or `names` contain an
    unknown one.
    """
    at = in_order(alpha, hyperparameters)
    place = {h.name: k for k, h in enumerate(hyperparameters)}
    for name in names:
        if name not in place:
            raise InputsError(
                f"the correlations name '{name}', which is no hyperparameter of this law",
                "run `aleator identify` again to write the result anew",
            )
    own = [alpha[h.name] for h in hyperparameters]
    return Estimated(
        at,
        _numbers([e.standard_error for e in own]),
        np.array([_numbers(e.interval or (None, None)) for e in own]).reshape(-1, 2),
        np.column_stack(limits_of(hyperparameters)),
        np.array([h.free for h in hyperparameters], dtype=bool),
        np.array([h.log for h in hyperparameters], dtype=bool),
        np.array([place[name] for name in names], dtype=np.intp),
        np.array([_numbers(row) for row in correlation]).reshape(len(names), len(names)),
    )


def _numbers(values: Sequence[float | None]) -> Array:
    return np.array([np.nan if v is None else float(v) for v in values])
