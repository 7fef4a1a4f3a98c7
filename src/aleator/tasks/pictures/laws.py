"""The identified laws as curves with the uncertainty of alpha, and as contours of two."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from scipy import stats

from aleator.inference.decisions.alpha_draws import AlphaDraws
from aleator.inference.decisions.weighted import quantiles
from aleator.laws import Law, Mixture
from aleator.laws.inputs import Inputs
from aleator.tasks.pictures.numbers import PLACES, drawn
from aleator.types import Array

POINTS = 101
ENDS = np.array([0.002, 0.998])
"""Probabilities of a law between which its density is drawn."""
LEVELS = np.array([0.025, 0.975])
FEW = 40
"""Experiments whose laws are averaged where each has its own."""
AROUND = 73
"""Points of a contour."""
MASSES = (0.5, 0.95)
PAIRS = 6


def law_bands(inputs: Inputs, draws: AlphaDraws, count: int) -> dict[str, dict[str, Any]]:
    """`x`, `density`, and `lower` and `upper` ends of 95 % of the densities under plausible laws.

    For each parameter that scatters. Where laws follow covariates it is the mean of those of some
    of the `count` experiments, evenly chosen. The band is that of each x by itself. None of a
    mixture with points, which has no density.
    """
    here = _values(inputs, draws.estimate, count)
    others = [_values(inputs, alpha, count) for alpha in draws.alpha]
    found = {}
    for i in inputs.scattered:
        law, name = [*inputs.laws.values()][i], inputs.names[i]
        if isinstance(law, Mixture) and law.points:
            continue
        low, high = _ends(law, here[i])
        wide = np.array([_ends(law, own[i]) for own in others])
        low = min(low, float(np.quantile(wide[:, 0], 0.25)))
        high = max(high, float(np.quantile(wide[:, 1], 0.75)))
        x = np.linspace(low, high, POINTS)
        density = _density(law, here[i], x)
        each = np.array([_density(law, own[i], x) for own in others])
        if not np.all(np.isfinite(x)) or not np.any(np.isfinite(density)):
            continue
        found[name] = {"x": drawn(x, PLACES), "density": drawn(density)}
        if not draws.certain:
            with np.errstate(invalid="ignore"):
                band = quantiles(each.T, np.broadcast_to(draws.weights, each.T.shape), LEVELS)
            found[name] |= {"lower": drawn(band[:, 0]), "upper": drawn(band[:, 1])}
    return found


def law_contours(inputs: Inputs, alpha: Array) -> list[dict[str, Any]]:
    """Curves that hold 50 % and 95 % of the law of two parameters, of some pairs.

    The images of the circles that hold as much of two standard normal variates, correlated as the
    parameters are. Pairs that are correlated come first. None where laws follow covariates, and of
    a mixture, whose law is no image of one normal variate.
    """
    if inputs.regressed or len(inputs.classes) > 1:
        return []
    matrix = inputs.correlation_matrix(alpha)
    pairs = sorted(combinations(inputs.scattered, 2), key=lambda pair: -abs(matrix[pair]))
    laws = [*inputs.laws.values()]
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    found = []
    for i, j in pairs[:PAIRS]:
        r = float(np.clip(matrix[i, j], -1.0, 1.0))
        turned = np.stack([circle[0], r * circle[0] + np.sqrt(1.0 - r * r) * circle[1]])
        curves = {}
        for mass in MASSES:
            theta = turned * np.sqrt(stats.chi2.ppf(mass, 2))
            x, y = (
                laws[k].standard(alpha[inputs.slices[k]], at).x
                for k, at in zip((i, j), theta, strict=True)
            )
            curves[f"{mass:g}"] = [drawn(x, PLACES), drawn(y, PLACES)]
        found.append({"between": [inputs.names[i], inputs.names[j]], "curves": curves})
    return found


def _values(inputs: Inputs, alpha: Array, count: int) -> tuple[Array, ...]:
    """Of each law the values (k, E) of some experiments: one where all have the same law."""
    chosen = np.unique(np.linspace(0, count - 1, FEW).round().astype(int))
    found = inputs.values(alpha[: inputs.size], slice(0, count))
    return tuple(own[:, None] if own.ndim == 1 else own[:, chosen, 0] for own in found)


def _ends(law: Law, values: Array) -> tuple[float, float]:
    ends = np.array([law.quantile(own, ENDS) for own in values.T])
    return float(ends.min()), float(ends.max())


def _density(law: Law, values: Array, x: Array) -> Array:
    with np.errstate(all="ignore"):
        each = np.array([np.exp(law.log_density(own, x)) for own in values.T])
        return np.asarray(each.mean(axis=0))
