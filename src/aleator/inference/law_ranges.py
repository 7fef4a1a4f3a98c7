"""The range that holds 95 % of each parameter's law, and how sure its two ends are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from aleator.core.types import Array
from aleator.inference.alpha_draws import AlphaDraws, quantiles
from aleator.inference.information import INTERVALS
from aleator.laws.hyperparameter import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.results.values import LawRange

ENDS = np.array(INTERVALS.ends)


@dataclass(frozen=True)
class RangeSettings:
    """Settings of the range of laws that follow covariates. The values are chosen by judgement."""

    experiments: int = 200
    """The most experiments whose laws are averaged; they are chosen evenly."""
    points: int = 8000
    """About how many values of all these laws together form the mean law: its quantiles are then
    exact to 1e-4 of probability.
    """


RANGES = RangeSettings()


def law_ranges(
    inputs: Inputs, hyperparameters: tuple[Hyperparameter, ...], draws: AlphaDraws, count: int
) -> dict[str, LawRange]:
    """The 95 % range of each scattering parameter, by name, for `count` experiments.

    q_p = F^-1(p | alpha) for p = 2.5 and 97.5 %, at the estimate; the interval of an end is that of
    the same quantiles of q_p over the `draws` of alpha. `hyperparameters` (K,) are those of alpha.
    If a law follows covariates, F is the mean of the laws of the experiments. A law without finite
    quantiles is left out. Cost: milliseconds, with covariates a second.

    >>> from aleator.laws import Normal
    >>> inputs = Inputs({"x": Normal(2.0, 0.5)})
    >>> known = AlphaDraws.at(np.array([2.0, 0.5]))
    >>> found = law_ranges(inputs, inputs.hyperparameters, known, 1)["x"]
    >>> round(found.lower, 3), round(found.upper, 3), found.lower == found.lower_interval[0]
    (1.02, 2.98, True)
    """
    here = law_ends(inputs, draws.estimate, count)
    each = np.array([law_ends(inputs, alpha, count) for alpha in draws.alpha])
    with np.errstate(invalid="ignore"):
        sure = quantiles(np.moveaxis(each, 0, -1), draws.weights, ENDS)
    unknown = {hyperparameters[k].name.partition(".")[0] for k in draws.fixed}
    found = {}
    for i, ends, (low, high) in zip(inputs.scattered, here, sure, strict=True):
        name = inputs.names[i]
        if not np.all(np.isfinite(ends)):
            continue
        told = name not in unknown and bool(np.all(np.isfinite([low, high])))
        found[name] = LawRange(
            lower=float(ends[0]),
            upper=float(ends[1]),
            lower_interval=(float(low[0]), float(low[1])) if told else None,
            upper_interval=(float(high[0]), float(high[1])) if told else None,
            level=inputs.levels.get(name),
            follows=_follows(inputs, i),
        )
    return found


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
