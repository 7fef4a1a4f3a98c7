"""Points of each experiment's standard normal variates that stand for its law, and their weights.

Quadrature nodes give means; probabilities and quantiles need points that fill the law.
"""

from __future__ import annotations

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.types import Array

WIDER = 1.3
"""By how much points about an individual law lie farther out than its curvature says."""


def standard_points(count: int, dimensions: int) -> Array:
    """Points (count, s) of the standard normal law: Sobol's, in one dimension midpoints."""
    if dimensions <= 1:
        u = ((np.arange(count) + 0.5) / count)[:, None][:, :dimensions]
    else:
        power = int(np.ceil(np.log2(count)))
        u = qmc.Sobol(dimensions, scramble=False).random_base2(power)[:count] + 0.5 / count
    return np.asarray(special.ndtri(np.clip(u, 1e-12, 1.0 - 1e-12)))


def proposed(mode: Array, information: Array, count: int) -> tuple[Array, Array]:
    """Points xi (B, C J, s) about C modes (B, C, s), half of them of the standard normal law.

    log weights (B, C J) such that sum_j exp(log_weight_j) g(xi_j) is near int g(xi) phi(xi) dxi
    over the J points of each mode (defensive importance sampling: Hesterberg, 1995).
    `information` (B, C, s, s) is the curvature of each individual law at its mode.
    """
    half, (experiments, classes, s) = count // 2, mode.shape
    t = standard_points(half, s)
    root = WIDER * np.linalg.cholesky(np.linalg.inv(information))
    near = mode[:, :, None] + np.einsum("ncst,jt->ncjs", root, t)
    law = np.broadcast_to(t, (experiments, classes, *t.shape))
    xi = np.concatenate([law, near], axis=2)
    log_law = -0.5 * np.sum(xi**2, axis=3)
    away = xi - mode[:, :, None]
    curved = np.einsum("ncjs,ncst,ncjt->ncj", away, information / WIDER**2, away)
    log_det = np.log(np.einsum("ncss->ncs", root)).sum(axis=2)
    log_near = -0.5 * curved - log_det[..., None]
    log_weight = log_law - np.logaddexp(log_law, log_near) + np.log(2.0) - np.log(2.0 * half)
    whole = (experiments, classes * 2 * half)
    return xi.reshape(*whole, s), log_weight.reshape(whole)
