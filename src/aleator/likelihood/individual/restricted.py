"""The restricted likelihood, for variances from few experiments: locations are integrated out.

Means of laws and values of constants get a flat prior and are integrated out by Laplace's method,

    log L_R(alpha) = log L(alpha) - 1/2 log det H(alpha) + p/2 log 2 pi,

with the information H (p, p) of the p locations (Patterson and Thompson, 1971; Cox and Reid, 1987).
At a linear simulator with normal laws H does not depend on the locations and the integral is exact.
Its maximum over all hyperparameters has then the variances of REML, which are not biased by the
locations that are estimated with them, and the locations of generalized least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array, Indices
from aleator.laws.hyperparameter import Hyperparameter, limits_of
from aleator.search.interface import LogLikelihood, Scored


@dataclass(frozen=True)
class RestrictedSettings:
    """Settings of the differences of scores; `pytest tests/likelihood/test_restricted.py`."""

    step: float = 1e-2
    """The step in standard errors, by outer products of scores. The published maximum of Dyestuff
    is met within 1e-8."""
    bend: float = 0.1
    """The step of the second differences of scores, in standard errors. They are exact for any step
    with a linear simulator and normal laws."""
    longest: float = 1e-2
    """The longest step, over the width of the limits."""


RESTRICTED = RestrictedSettings()


def locations(hyperparameters: tuple[Hyperparameter, ...]) -> Indices:
    """The places of the free locations: means of laws, values of constants, their coefficients."""
    return np.flatnonzero([h.free and h.location for h in hyperparameters])


def restricted(
    scored: Scored,
    alpha: Array,
    hyperparameters: tuple[Hyperparameter, ...],
    settings: RestrictedSettings = RESTRICTED,
    *,
    slope: bool,
) -> LogLikelihood:
    """The restricted log-likelihood at alpha (K,), with its derivative if `slope` is true.

    `scored` is the likelihood with scores. The change by the integration counts once, as a prior
    does. Its derivative by alpha_k is half the sum of the second derivatives of score k along the
    p directions u_m with H = (sum_m u_m u_m')^-1. Cost: 2 p evaluations, or 4 p with the
    derivative. Where the information is not positive definite, the logarithm of the size of its
    determinant counts.
    """
    here, rows = scored(alpha), locations(hyperparameters)
    assert here.scores is not None
    lower, upper = limits_of(hyperparameters)
    longest = settings.longest * (upper - lower)
    size = np.sum(here.scores**2, axis=0)
    with np.errstate(divide="ignore"):
        step = np.minimum(settings.step / np.sqrt(size), longest)

    def moved(along: Array, sign: int) -> Array:
        point = alpha.copy()
        point[rows] += sign * along
        return scored(point).score

    steps = np.diag(step[rows])
    rises = np.array([moved(h, -1) - moved(h, 1) for h in steps])[:, rows]
    information = rises / (2.0 * step[rows, None])
    bend, turned = np.linalg.eigh(0.5 * (information + information.T))
    change = 0.5 * (rows.size * np.log(2.0 * np.pi) - np.sum(np.log(np.abs(bend))))
    found = replace(here, prior=here.prior + float(change))
    if not slope:
        return found
    by = np.zeros(alpha.size)
    for curvature, direction in zip(bend, turned.T, strict=True):
        along = direction / np.sqrt(np.abs(curvature))
        h = min(settings.bend, float(np.min(longest[rows] / np.abs(along))))
        second = moved(h * along, 1) + moved(h * along, -1) - 2.0 * here.score
        by += 0.5 * np.sign(curvature) * second / h**2
    by[[h.is_number for h in hyperparameters]] = 0.0
    own = 0.0 if here.prior_score is None else here.prior_score
    return replace(found, prior_score=own + by)
