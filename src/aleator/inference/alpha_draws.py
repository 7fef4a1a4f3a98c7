"""Values of alpha that the experiments leave plausible, and quantiles of points with weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, optimize, special
from scipy.stats import qmc

from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError
from aleator.inference.information import INTERVALS
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.results.values import Estimate, in_order
from aleator.search.interface import Scored


def quantiles(values: Array, weights: Array, probabilities: Array) -> Array:
    """Quantiles (..., P) of values (..., J) with weights (..., J).

    Each value stands in the middle of its weight; between values by interpolation.
    NaN where there is none; a value that is NaN does not count.

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
    """Quantiles by interpolation; beside an infinite value the next value itself."""
    if np.all(np.isfinite(y)):
        return np.interp(probabilities, reached, y)
    return y[np.clip(np.searchsorted(reached, probabilities), 0, len(y) - 1)]


END = float(special.ndtri(INTERVALS.ends[1]))
"""The standard normal variate at which an interval ends."""


@dataclass(frozen=True)
class DrawSettings:
    """How draws of alpha reproduce its intervals; by judgement."""

    count: int = 256
    """Draws of alpha."""
    wide: float = 1.3
    """Width of draws that are weighted afterwards, over that of the law of the estimates."""
    steepest: float = 1.5
    """Bend of a scale beyond which an interval is too skew to be followed: one side 19 times the
    other.
    """
    smallest: float = 1e-9
    """A bend, or an eigenvalue of the correlations, below this is zero; probabilities stay so far
    from zero and one."""
    tries: int = 8
    """Draws that are made for one that lies within the limits."""


DRAWING = DrawSettings()


@dataclass(frozen=True, eq=False)
class Estimated:
    """Estimates, errors, intervals and correlations of alpha (K,), as a result has them.

    `error` (K,), `interval` (K, 2) are NaN where there is none; `which` (F,) are the
    hyperparameters of `correlation` (F, F); `limits` (K, 2); `free` (K,) which are identified,
    and `scale` (K,) which are scales, such as standard deviations.
    """

    alpha: Array
    error: Array
    interval: Array
    limits: Array
    free: Flags
    scale: Flags
    which: Indices
    correlation: Array


@dataclass(frozen=True, eq=False)
class AlphaDraws:
    """Values (A, K) of alpha with weights (A,) that sum to one; `estimate` (K,) is the maximum.

    `z` (A, K) are the normal variates that they are made of. `log_density` (A,) is the logarithm of
    the density of alpha over its prior, up to a constant: what a likelihood is held against.
    `fixed` (H,) are free hyperparameters of whose uncertainty nothing is known: they keep their
    estimate. `effective` is the number of draws of equal weight that are worth as much.

    >>> AlphaDraws.at(np.array([1.0, 0.5])).alpha.tolist()
    [[1.0, 0.5]]
    """

    estimate: Array
    alpha: Array
    weights: Array
    z: Array
    log_density: Array
    fixed: Indices

    @classmethod
    def at(cls, alpha: Array) -> AlphaDraws:
        """The estimate as the only draw, as if alpha were known."""
        one = np.ones(1)
        return cls(alpha, alpha[None], one, np.zeros((1, alpha.size)), 0.0 * one,
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
        """The first `most` of the draws."""
        weights = self.weights[:most]
        return replace(
            self, alpha=self.alpha[:most], weights=weights / weights.sum(), z=self.z[:most],
            log_density=self.log_density[:most],
        )  # fmt: skip

    def reweighted(self, objective: Scored) -> AlphaDraws:
        """The draws weighted by the likelihood itself in place of its approximation.

        Weights L(alpha_a) prior(alpha_a)/q(alpha_a), q the density of the draws, cut at sqrt(A)
        times their mean (Ionides, 2008). The prior is flat, but 1/alpha for a scale whose interval
        is within its limits: of a normal sample quantiles then have exact intervals. Near zero a
        scale has a flat prior, which leaves that zero is as plausible as the data say. Cost: an
        evaluation for each draw.
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
    """Draws of alpha by its intervals and correlations, within the limits.

    alpha_k = h_k(z_k) with correlated standard normal z: a Gaussian copula. h_k is the scale on
    which the profile of the likelihood is taken to be a parabola:

        h(z) = alpha + s (exp(b z) - 1)/b,   h(-1.96), h(1.96) the ends of the interval,

    the line alpha + z error for a symmetric one. Where an end lies on a limit, the slope s is the
    standard error. A hyperparameter on its limit has h(z) = limit + |z| (other end - limit)/1.96,
    independent of the others. Without interval the line is taken; without standard error, too, the
    estimate is held. What leaves the limits is left out: truncation. Draws come in pairs z, -z
    (antithetic), of scrambled Sobol' points of the `seed`. With fewer than the half within the
    limits there may be fewer than `count`. With `wide` variates are so many times as far out, for
    draws that are weighted afterwards.
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
            log_density += np.log(np.maximum(alpha[:, k], np.finfo(float).tiny))
    inside = np.all((alpha >= known.limits[:, 0]) & (alpha <= known.limits[:, 1]), axis=1)
    chosen = np.flatnonzero(inside)[:count]
    weights = np.full(chosen.size, 1.0 / chosen.size)
    return AlphaDraws(known.alpha, alpha[chosen], weights, z[chosen], log_density[chosen], held)


@dataclass(frozen=True)
class _Profiled:
    """alpha of a standard normal variate: `estimate` + `slope` (exp(`bend` z) - 1)/`bend`.

    `folded` takes |z|; `whole` says that both ends of the interval are within the limits.
    """

    estimate: float
    slope: float
    bend: float
    folded: bool = False
    whole: bool = False

    @classmethod
    def of(cls, known: Estimated, k: int) -> _Profiled | None:
        """The scale of hyperparameter k; None if nothing is known of its uncertainty."""
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
        """Values at variates z."""
        return np.asarray(
            self.estimate + self.slope * _bent(np.abs(z) if self.folded else z, self.bend)
        )


def _bent(z: Array | float, bend: float) -> Array:
    return np.asarray(z if abs(bend) < DRAWING.smallest else np.expm1(bend * np.asarray(z)) / bend)


def _bend(reach: float, settings: DrawSettings = DRAWING) -> float:
    """The bend with which 1.96 normal variates reach `reach` standard errors up."""
    ends = [float(_bent(END, b)) - reach for b in (-settings.steepest, settings.steepest)]
    if ends[0] >= 0.0 or ends[1] <= 0.0:
        return -settings.steepest if ends[0] >= 0.0 else settings.steepest
    return float(
        optimize.brentq(
            lambda b: float(_bent(END, b)) - reach, -settings.steepest, settings.steepest
        )
    )


def _correlation(known: Estimated, moving: Indices) -> Array:
    """The correlations (G, G) of the moving variates; none of one that is on its limit."""
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
    """Standard normal points (count, dimensions), each followed by its opposite."""
    half = qmc.Sobol(dimensions, rng=seed).random_base2(int(np.ceil(np.log2(count / 2))))
    z = special.ndtri(np.clip(half, DRAWING.smallest, 1.0 - DRAWING.smallest))
    return np.stack([z, -z], axis=1).reshape(-1, dimensions)[:count]


def estimated(
    alpha: Mapping[str, Estimate],
    names: Sequence[str],
    correlation: Sequence[Sequence[float]],
    hyperparameters: Sequence[Hyperparameter],
) -> Estimated:
    """Estimates, errors, intervals and the `correlation` (F, F) of those with these `names`.

    Raises InputsError where alpha lacks a hyperparameter or has an unknown one, or the names have.
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
