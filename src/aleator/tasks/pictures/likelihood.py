"""Profiles of the likelihood, and its surface over the two estimates that are told apart worst."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from aleator.inference.fit import Fit
from aleator.inference.likelihood_shape import (
    Objective,
    around,
    likelihood_curve,
    likelihood_surface,
    weakest_pair,
)
from aleator.results.values import Estimate
from aleator.tasks.pictures.numbers import PLACES, drawn

ACROSS = 11
"""Points of a side of the surface."""
MOST = 8
"""Hyperparameters that are profiled, the first of them: more are no picture."""
OBSERVATIONS = 3000
"""Observations up to which a curve takes seconds."""


def likelihood_shapes(
    fit: Fit, estimates: Mapping[str, Estimate], told: Callable[[str], None]
) -> dict[str, Any]:
    """`profiles` by hyperparameter, and `surface` over the weakest pair; both below the maximum.

    A profile is that of the interval: it has its ends, and has dropped there as the estimate says.
    Empty where there is no maximum with a curvature, or where observations are too many. By the
    fewest nodes that serve: differences of log-likelihoods hardly depend on these.
    """
    inference = fit.inference
    if not inference.positive or len(fit.table.observations) > OBSERVATIONS:
        return {}
    objective = fit.likelihood.rough().objective()
    profiles = {}
    for k in _shown(fit, estimates):
        h = fit.hyperparameters[k]
        told(h.name)
        estimate = estimates[h.name]
        assert estimate.interval is not None
        assert estimate.drops is not None
        at = around(estimate.interval, float(fit.alpha[k]), h)
        curve = likelihood_curve(objective, fit.alpha, fit.hyperparameters, inference, k, at)
        below = curve.value[at == fit.alpha[k]] - curve.value
        for end, drop in zip(estimate.interval, estimate.drops, strict=True):
            below[at == end] = drop
        profiles[h.name] = {"at": drawn(at, PLACES), "below": drawn(below)}
    return {"profiles": profiles, "surface": _surface(fit, estimates, objective, told)}


def _shown(fit: Fit, estimates: Mapping[str, Estimate]) -> list[int]:
    known = [
        int(k) for k in fit.inference.identified if estimates[fit.hyperparameters[k].name].interval
    ]
    return known[:MOST]


def _surface(
    fit: Fit,
    estimates: Mapping[str, Estimate],
    objective: Objective,
    told: Callable[[str], None],
) -> dict[str, Any] | None:
    free = [int(k) for k in fit.inference.free]
    rows = [r for r, k in enumerate(free) if estimates[fit.hyperparameters[k].name].interval]
    correlation = fit.inference.correlation[np.ix_(rows, rows)]
    weakest = weakest_pair(correlation)
    if weakest is None:
        return None
    first, second = (free[rows[r]] for r in weakest)
    names = [fit.hyperparameters[k].name for k in (first, second)]
    told(" and ".join(names))
    found = likelihood_surface(
        objective, fit.alpha, fit.hyperparameters, fit.inference, (first, second), ACROSS
    )
    return {
        "between": names,
        "correlation": float(correlation[weakest]),
        "first": drawn(found.first, PLACES),
        "second": drawn(found.second, PLACES),
        "below": drawn(np.nanmax(found.value) - found.value),
    }
