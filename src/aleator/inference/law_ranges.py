"""The range that holds 95 % of each parameter's law and its usual quantities, with intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy import special

from aleator.core.types import Array
from aleator.inference.alpha_draws import AlphaDraws, quantiles
from aleator.inference.factors import LawsByLevel
from aleator.inference.information import INTERVALS, Inference
from aleator.laws.covariates import Table
from aleator.laws.hyperparameter import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.laws.law import Law
from aleator.results.values import LawEnds, LawQuantity, LawRange

ENDS = np.array(INTERVALS.ends)


@dataclass(frozen=True)
class RangeSettings:
    """Settings of the ranges of laws and of their quantities; the values are by judgement."""

    experiments: int = 200
    """The most experiments whose laws are averaged; they are chosen evenly."""
    points: int = 8000
    """About how many values of all these laws together form the mean law: its quantiles are then
    exact to 1e-4 of probability.
    """
    step: float = 1e-3
    """Step of the derivatives of quantities, in standard errors; of a hyperparameter without one,
    relative to it."""


RANGES = RangeSettings()


def law_ranges(
    inputs: Inputs,
    hyperparameters: tuple[Hyperparameter, ...],
    draws: AlphaDraws,
    count: int,
    covariates: Table | None = None,
    inference: Inference | None = None,
) -> dict[str, LawRange]:
    """The 95 % range of each scattering parameter, by name, for `count` experiments.

    q_p = F^-1(p | alpha) for p = 2.5 and 97.5 %, at the estimate; the interval of an end is that of
    the same quantiles of q_p over the `draws` of alpha, made longer where the estimate lies beyond,
    and so are those of the law's quantities (`Law.customary`), whose standard errors follow from
    `inference`. `hyperparameters` (K,) are those of alpha. If a law follows covariates, F is the
    mean of the laws of the experiments; if one of them is a factor of few levels, each level has
    its range too, which takes the `covariates` of the experiments. A law without finite quantiles
    is left out. Cost: milliseconds, with covariates a second.

    >>> from aleator.laws import Normal
    >>> inputs = Inputs({"x": Normal(2.0, 0.5)})
    >>> known = AlphaDraws.at(np.array([2.0, 0.5]))
    >>> found = law_ranges(inputs, inputs.hyperparameters, known, 1)["x"]
    >>> round(found.lower, 3), round(found.upper, 3), found.lower == found.lower_interval[0]
    (1.02, 2.98, True)
    """
    every = _ends(lambda alpha: law_ends(inputs, alpha, count), draws)
    unknown = {hyperparameters[k].name.partition(".")[0] for k in draws.fixed}
    found = {}
    for i, ends in zip(inputs.scattered, every, strict=True):
        name = inputs.names[i]
        if not np.all(np.isfinite(ends[0])):
            continue
        apart, law = LawsByLevel.of(inputs, i, covariates), inputs.law(i)
        known, follows = name not in unknown, _follows(inputs, i)
        own = {}
        if not follows:
            own = _quantities(law, partial(_values, inputs, i), draws, inference, known=known)
        found[name] = LawRange(
            **_told(ends, known=known), quantities=own, level=inputs.levels.get(name),
            follows=follows,
        )  # fmt: skip
        if apart is not None:
            each = _ends(partial(_ends_by_level, apart), draws)
            by_level = {
                level: LawEnds(
                    **_told(each[e], known=known),
                    quantities=_quantities(
                        law, partial(_values_at, apart, e), draws, inference, known=known
                    ),
                )
                for e, level in enumerate(apart.levels)
            }
            found[name] = replace(found[name], factor=apart.factor, at=apart.at, by_level=by_level)
    return found


def _ends(of: Callable[[Array], Array], draws: AlphaDraws) -> Array:
    """Ends (s, 2) at the estimate, then the low and the high ends of their intervals: (s, 3, 2)."""
    each = np.array([of(alpha) for alpha in draws.alpha])
    with np.errstate(invalid="ignore"):
        sure = quantiles(np.moveaxis(each, 0, -1), draws.weights, ENDS)
    return np.stack([of(draws.estimate), sure[..., 0], sure[..., 1]], axis=1)


def _told(ends: Array, *, known: bool) -> dict[str, Any]:
    """The fields of `LawEnds` for ends (3, 2); without intervals if these are not `known`."""
    (lower, upper), *sure = ends.tolist()
    known = known and bool(np.all(np.isfinite(sure)))
    below, above = (
        _with_estimate(end, interval) if known else None
        for end, interval in zip((lower, upper), zip(*sure, strict=True), strict=True)
    )
    return {"lower": lower, "upper": upper, "lower_interval": below, "upper_interval": above}


def _with_estimate(value: float, interval: tuple[float, float]) -> tuple[float, float]:
    """An interval of draws, as wide as it contains the estimate too.

    Draws of an sd whose estimate is its lower limit are all larger.
    """
    return min(interval[0], value), max(interval[1], value)


def _quantities(
    law: Law,
    values: Callable[[Array], Array],
    draws: AlphaDraws,
    inference: Inference | None,
    *,
    known: bool,
) -> dict[str, LawQuantity]:
    """The quantities by which a law is usually told; `values` has its (k,) values at an alpha."""
    if all(h.is_number for h in law.hyperparameters):
        return {}

    def told(alpha: Array) -> Array:
        return np.array([*law.customary(values(alpha)).values()])

    estimate = law.customary(values(draws.estimate))
    each = np.array([told(alpha) for alpha in draws.alpha])
    errors = _standard_errors(told, draws.estimate, inference)
    found = {}
    for q, (name, value) in enumerate(estimate.items()):
        low, high = quantiles(each[:, q], draws.weights, ENDS).tolist()
        sure = known and np.isfinite(low) and np.isfinite(high)
        interval = _with_estimate(value, (low, high)) if sure else None
        error = float(errors[q]) if sure and np.isfinite(errors[q]) else None
        found[name] = LawQuantity(value, interval, error)
    return found


def _standard_errors(
    of: Callable[[Array], Array],
    alpha: Array,
    inference: Inference | None,
    settings: RangeSettings = RANGES,
) -> Array:
    """The standard errors (Q,) of quantities of alpha by the delta method, sqrt(g' C g).

    g are their derivatives by the hyperparameters that have a standard error, by differences. NaN
    where these have none, or where another one moves the quantity.
    """
    unknown = np.full(of(alpha).shape, np.nan)
    if inference is None or not inference.positive:
        return unknown
    size = np.abs(alpha) * settings.step
    size[inference.free] = settings.step * inference.standard_error[inference.free]
    slopes = np.zeros((alpha.size, unknown.size))
    held = np.setdiff1d(inference.identified, inference.free)
    with np.errstate(all="ignore"):
        for k in inference.identified:
            moved = np.where(np.arange(alpha.size) == k, size, 0.0)
            slopes[k] = (of(alpha + moved) - of(alpha - moved)) / (2.0 * size[k])
        free = slopes[inference.free]
        errors = np.sqrt(np.einsum("fq,fg,gq->q", free, inference.covariance, free))
    return np.where(np.any(slopes[held] != 0.0, axis=0), np.nan, errors)


def _values(inputs: Inputs, i: int, alpha: Array) -> Array:
    """The hyperparameters (k,) of a law that is the same for all experiments."""
    own = inputs.values(alpha[: inputs.size], slice(0, 1))[i]
    return own.reshape(len(own), -1)[:, 0]


def _values_at(laws: LawsByLevel, level: int, alpha: Array) -> Array:
    """The hyperparameters (k,) of the law at a level, given by its number."""
    return laws.values(alpha)[:, level]


def _ends_by_level(laws: LawsByLevel, alpha: Array) -> Array:
    """The quantiles (E, 2) of 2.5 and 97.5 % of the laws of E levels."""
    law = laws.inputs.law(laws.i)
    return np.array([law.quantile(own, ENDS) for own in laws.values(alpha).T])


def law_ends(inputs: Inputs, alpha: Array, count: int, settings: RangeSettings = RANGES) -> Array:
    """The quantiles (s, 2) of 2.5 and 97.5 % of the laws of the s scattering parameters."""
    values = inputs.values(alpha[: inputs.size], slice(0, count))
    found = []
    for i in inputs.scattered:
        law, own = inputs.law(i), values[i]
        if not _follows(inputs, i):
            found.append(law.quantile(own[:, 0] if own.ndim > 1 else own, ENDS))
            continue
        kept = np.unique(np.linspace(0, count - 1, settings.experiments).round().astype(int))
        points = settings.points // kept.size
        theta = special.ndtri((np.arange(points) + 0.5) / points)
        at = np.broadcast_to(theta, (kept.size, points))
        found.append(np.quantile(law.standard(own[:, kept], at).x, ENDS, method="hazen"))
    return np.array(found).reshape(-1, 2)


def _follows(inputs: Inputs, i: int) -> bool:
    return any(h.by is not None for h in inputs.law(i).hyperparameters)
