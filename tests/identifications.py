"""Identifications of the problems, and the exact maximum by another method."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from problems import Problem
from scipy import optimize

from aleator import Check, GradientMultistart, Identification, MaximumEntropy, identify
from aleator.core.types import Array
from aleator.moments.densities import Density
from aleator.study import load_study

unjudged = partial(identify, consistency=False, best_law=False)
"""The same without the second verdict and the best possible law, which cost most of a small study:
for tests that look at neither."""


def identified(
    problem: Problem,
    y: Array,
    density: Density | None = None,
    *,
    starts: int = 4,
    samples: int = 0,
    **more: object,
) -> Identification:
    return unjudged(
        problem.simulator,
        problem.table(y),
        problem.inputs,
        outcome="y",
        vectorized=True,
        noise=problem.noise,
        density=density or MaximumEntropy(4),
        search=GradientMultistart(starts),
        verification=Check(samples),
        **more,  # type: ignore[arg-type]
    )


def of_study(path: Path, verification: Check) -> Identification:
    """A study file through the Python API, with another check; nothing is stored."""
    study = load_study(path)
    return unjudged(
        study.runner(),
        study.experiments,
        study.inputs,
        noise=study.noise,
        propagation=study.propagation,
        density=study.density,
        search=study.search,
        verification=verification,
        seed=study.seed,
    )


def estimates(found: Identification) -> Array:
    return np.array([e.estimate for e in found.alpha.values()])


def maximum(
    log_likelihood: Callable[[Array], float], starts: list[list[float]]
) -> tuple[Array, float, Array]:
    """Maximum by Nelder-Mead, its value, and standard errors from second differences."""
    options = {"xatol": 1e-8, "fatol": 1e-10, "maxiter": 20_000, "maxfev": 20_000}
    ends = [
        optimize.minimize(lambda p: -log_likelihood(p), s, method="Nelder-Mead", options=options)
        for s in starts
    ]
    best = min(ends, key=lambda end: end.fun)
    size, h = best.x.size, 1e-4
    steps = h * np.eye(size)
    second = np.array(
        [
            [
                sum(
                    s * t * log_likelihood(best.x + s * steps[i] + t * steps[j])
                    for s in (-1, 1)
                    for t in (-1, 1)
                )
                for j in range(size)
            ]
            for i in range(size)
        ]
    )
    covariance = np.linalg.inv(-second / (4.0 * h**2))
    return best.x, -float(best.fun), np.sqrt(np.diag(covariance))


def assert_maximum(log_likelihood: Callable[[Array], float], alpha: Array, error: Array) -> None:
    """The maximum is less than a twentieth of a standard error (K,) from alpha, on every axis.

    By a parabola through three points a quarter of a standard error apart; NaN is left out.
    """
    top = log_likelihood(alpha)
    for k in np.flatnonzero(np.isfinite(error)):
        move = 0.25 * error[k] * np.eye(alpha.size)[k]
        up, down = log_likelihood(alpha + move), log_likelihood(alpha - move)
        peak = 0.125 * (up - down) / (2.0 * top - up - down)
        assert abs(peak) < 0.05, k


def errors_of(found: Identification) -> Array:
    """Standard errors (K,), NaN where there is none."""
    told = [entry.standard_error for entry in found.alpha.values()]
    return np.array([np.nan if error is None else error for error in told])
