"""Probabilities between bounds: what censored values say of the simulated one."""

from __future__ import annotations

import numpy as np

from aleator.observations.model import ObservationModel, Observed, is_bounded
from aleator.types import Array, Flags


def observed(
    model: ObservationModel, lower: Array, upper: Array, eta: Array, scale: Array, exact: Flags
) -> Observed:
    """The log density of exact values (lower == upper), the log probability between bounds.

    `lower` and `upper` (m, 1), `eta` (m, J), `scale` () or (m, 1) or (m, J), `exact` (m,).
    """
    if np.all(exact):
        return model.log_density(upper, eta, scale)
    if not np.any(exact):
        return log_probability(model, lower, upper, eta, scale)
    scale = np.broadcast_to(scale, eta.shape)
    found = Observed(*(np.empty(eta.shape) for _ in range(3)))
    for which in (exact, ~exact):
        part = observed(model, lower[which], upper[which], eta[which], scale[which], exact[which])
        for whole, values in zip(found, part, strict=True):
            whole[which] = values
    return found


def log_probability(
    model: ObservationModel, lower: Array, upper: Array, eta: Array, scale: Array
) -> Observed:
    """log P(lower < y < upper | eta, scale) with derivatives: the model's own, or by its cdf.

    An infinite eta gives the limit.
    """
    # Far enough to be the limit for every bound, near enough to be squared.
    eta = np.clip(eta, -1e140, 1e140)
    if is_bounded(model):
        return model.log_probability(lower, upper, eta, scale)
    return _by_cdf(model, lower, upper, eta, scale)


def _by_cdf(
    model: ObservationModel, lower: Array, upper: Array, eta: Array, scale: Array
) -> Observed:
    """P = F(upper) - F(lower), where F depends on y, eta and the scale by (y - eta)/scale only."""
    below = np.where(np.isneginf(lower), 0.0, model.cdf(lower, eta, scale))
    above = np.where(np.isposinf(upper), 1.0, model.cdf(upper, eta, scale))
    a, b = (lower - eta) / scale, (upper - eta) / scale
    with np.errstate(all="ignore"):
        value = np.log(above - below)
        log_scale = np.log(scale)
        at_a, at_b = (model.log_density(e, eta, scale).value + log_scale for e in (lower, upper))
        return from_ends(value, at_a, at_b, a, b, scale)


def from_ends(value: Array, at_a: Array, at_b: Array, a: Array, b: Array, scale: Array) -> Observed:
    """The derivatives of value = log P(a < u < b) from the log densities of u at the two ends.

    d/d eta = (f(a) - f(b))/(scale P), d/d scale = (a f(a) - b f(b))/(scale P); an end at infinity
    gives nothing.
    """
    with np.errstate(all="ignore"):
        ratio_a = np.where(np.isinf(a), 0.0, np.exp(at_a - value))
        ratio_b = np.where(np.isinf(b), 0.0, np.exp(at_b - value))
        moved = np.where(np.isinf(a), 0.0, a * ratio_a) - np.where(np.isinf(b), 0.0, b * ratio_b)
        return Observed(value, (ratio_a - ratio_b) / scale, moved / scale)


def outward(a: Array, b: Array) -> tuple[Array, Array, Flags]:
    """Ends of the same probability under a symmetric law with b >= |a|, and which were turned."""
    turned = a + b < 0.0
    return np.where(turned, -b, a), np.where(turned, -a, b), turned
