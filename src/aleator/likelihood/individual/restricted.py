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
    does. Cost: 2 p evaluations, or 2 p (1 + 2 K) with the derivative. Where the information is not
    positive definite, the logarithm of the size of its determinant counts.
    """
    here, rows = scored(alpha), locations(hyperparameters)
    assert here.scores is not None
    lower, upper = limits_of(hyperparameters)
    size = np.sum(here.scores**2, axis=0)
    with np.errstate(divide="ignore"):
        step = np.minimum(settings.step / np.sqrt(size), settings.longest * (upper - lower))

    def change(point: Array) -> float:
        information = np.array([_bend(scored, point, k, step[k], rows) for k in rows])
        determinant = np.linalg.slogdet(0.5 * (information + information.T))[1]
        return float(0.5 * (rows.size * np.log(2.0 * np.pi) - determinant))

    found = replace(here, prior=here.prior + change(alpha))
    if not slope:
        return found
    by = np.zeros(alpha.size)
    for k in np.flatnonzero([not h.is_number for h in hyperparameters]):
        ahead, behind = alpha.copy(), alpha.copy()
        ahead[k] = min(alpha[k] + step[k], upper[k])
        behind[k] = max(alpha[k] - step[k], lower[k])
        by[k] = (change(ahead) - change(behind)) / (ahead[k] - behind[k])
    own = 0.0 if here.prior_score is None else here.prior_score
    return replace(found, prior_score=own + by)


def _bend(scored: Scored, alpha: Array, place: int, step: float, rows: Indices) -> Array:
    """The derivative (p,) of minus the score of the locations `rows` by that of one `place`."""
    ahead, behind = alpha.copy(), alpha.copy()
    ahead[place] += step
    behind[place] -= step
    return np.asarray((scored(behind).score - scored(ahead).score)[rows] / (2.0 * step))
